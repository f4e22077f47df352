"""Codes of messages on files: import, completion, export, replay, verification and signature."""

from __future__ import annotations

from enum import StrEnum


class ImportCode(StrEnum):
    """Reason why files are not imported or do not complete a recording, and notes on what was written."""

    INCOMPLETE_COMMAND = "import.incomplete_command"
    UNUSED_OPTION = "import.unused_option"
    WRONG_LABEL_PAIR = "import.wrong_label_pair"
    UNKNOWN_LABEL = "import.unknown_label"
    START_OUT_OF_RANGE = "import.start_out_of_range"
    FORCE_FORMAT = "import.force_format"
    MARKER_FORMAT = "import.marker_format"
    NO_FORCE_COLUMN = "import.no_force_column"
    SEVERAL_FORCE_COLUMNS = "import.several_force_columns"
    FORCE_UNIT = "import.force_unit"
    NO_SCALE = "import.no_scale"
    MARKERS_MISSING = "import.markers_missing"
    NOTHING_VISIBLE = "import.nothing_visible"
    SAMPLE_RATE = "import.sample_rate"
    MARKER_DISTANCE = "import.marker_distance"
    BEFORE_CAPTURE = "import.before_capture"
    SHORT_OVERLAP = "import.short_overlap"
    NOT_USABLE = "import.not_usable"
    FILE_EXISTS = "import.file_exists"
    PARTIAL_OVERLAP = "import.partial_overlap"
    LAG_ASSUMED = "import.lag_assumed"
    MARKER_FILE = "import.marker_file"
    FORCE_COLUMN = "import.force_column"

    CUT_RECORDING = "completion.cut_recording"
    NO_LIVE_FRAMES = "completion.no_live_frames"
    NO_EDGE = "completion.no_edge"
    FRAME_RATE = "completion.frame_rate"
    NOTHING_IN_COMMON = "completion.nothing_in_common"
    OTHER_TRIAL = "completion.other_trial"
    FRAMES_ADDED = "completion.frames_added"
    LABELS_ADDED = "completion.labels_added"
    MARKERS_FILLED = "completion.markers_filled"
    FRAMES_KEPT = "completion.frames_kept"


class ExportCode(StrEnum):
    """Reason why a recording is not exported or not replayed, and notes on what was written."""

    INCOMPLETE_COMMAND = "export.incomplete_command"
    UNUSED_OPTION = "export.unused_option"
    INCOMPLETE_MODEL_COMMAND = "export.incomplete_model_command"
    FILL_GAPS_FORMAT = "export.fill_gaps_format"
    NO_RECORDING = "export.no_recording"
    NOTHING_WRITTEN = "export.nothing_written"
    NOT_EXPORTED = "export.not_exported"
    NO_COMMON_CLOCK = "export.no_common_clock"
    RAW_POSSIBLE = "export.raw_possible"
    RAW_ONLY = "export.raw_only"
    NO_CUFF_FORCE = "export.no_cuff_force"
    BOUNCE = "export.bounce"
    NO_DIRECTION = "export.no_direction"
    CUFF_HIDDEN = "export.cuff_hidden"
    ROWS_LEFT_OUT = "export.rows_left_out"
    ROWS_FILLED = "export.rows_filled"
    INCOMPLETE = "export.incomplete"
    MODEL_NOTE = "export.model_note"

    NO_SAMPLES = "replay.no_samples"
    NO_SYNC_EDGE = "replay.no_sync_edge"


class NumberCode(StrEnum):
    """Reason why a number of the report does not agree with its source."""

    FILE = "number.file"
    UNKNOWN = "number.unknown"
    NOT_ON_PAGE = "number.not_on_page"
    NOT_LISTED = "number.not_listed"
    PAGE = "number.page"
    RENDERING = "number.rendering"
    NO_SOURCE = "number.no_source"
    LEFT_OUT = "number.left_out"
    SOURCE = "number.source"
    FIGURE = "number.figure"
    PROVENANCE = "number.provenance"
    INPUT = "number.input"
    RECOMPUTED = "number.recomputed"


class ChainCode(StrEnum):
    """Reason why a folder is not verified or signed, and remarks on its files."""

    CHANGED = "chain.changed"
    ADDED = "chain.added"
    JOURNAL_ORDER = "chain.journal_order"
    JOURNAL_CHANGED = "chain.journal_changed"
    LIST_LINE = "chain.list_line"
    LIST_MISSING = "chain.list_missing"
    NOT_ADDED = "chain.not_added"
    NOT_A_FOLDER = "chain.not_a_folder"
    NOTHING_TO_VERIFY = "chain.nothing_to_verify"
    NOT_REGULAR = "chain.not_regular"
    BROKEN = "signature.chain_broken"
    NOT_SIGNED = "signature.not_signed"
    NO_SIGNERS = "signature.no_signers"
    NO_SSH_KEYGEN = "signature.no_ssh_keygen"
    SSH_KEYGEN_FAILED = "signature.ssh_keygen_failed"
