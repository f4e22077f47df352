"""Messages on files: import, completion, export, replay, verification and signature."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

_SPANS = (
    "force, with its lag, from {force_from_s:.2f} to {force_to_s:.2f} s, markers from {markers_from_s:.2f} to "
    "{markers_to_s:.2f} s"
)


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
    IMPOSSIBLE_VALUE = "import.impossible_value"
    BEFORE_CAPTURE = "import.before_capture"
    SHORT_OVERLAP = "import.short_overlap"
    TIME_UNIT = "import.time_unit"
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


_IMPORT: Mapping[StrEnum, str] = {
    ImportCode.INCOMPLETE_COMMAND: (
        "the import lacks {missing}; give it, or --over to complete a recording from --mocap alone"
    ),
    ImportCode.UNUSED_OPTION: "an import with {option} takes no {unused}; leave out the one or the other",
    ImportCode.WRONG_LABEL_PAIR: "--label {pair} does not name two labels, expected THEIRS=OURS",
    ImportCode.UNKNOWN_LABEL: "{path} has no marker {missing} to rename, only {known}",
    ImportCode.START_OUT_OF_RANGE: (
        "--start is {start}, expected a time from {earliest:.0f} to {latest:.0f}; give the time of the capture"
    ),
    ImportCode.FORCE_FORMAT: "{path} ends in {suffix}, expected force in .csv, .txt, .tsv or .c3d",
    ImportCode.MARKER_FORMAT: "{path} ends in {suffix}, expected markers in .tsv, .trc or .c3d",
    ImportCode.NO_FORCE_COLUMN: "{path} has no column {expected} among {known}; name the column by --force-column",
    ImportCode.SEVERAL_FORCE_COLUMNS: (
        "{path} has the columns {found} among {known}, expected one; name the column by --force-column"
    ),
    ImportCode.FORCE_UNIT: (
        "{path} declares {column} in {unit}, expected {known}; export it in one of them, or give --force-unit if the "
        "declaration is wrong"
    ),
    ImportCode.NO_SCALE: (
        'the configuration has load_cell.source = "{source}" and no scale for the volts of {column}; give --force-unit '
        "N or lbs, or a configuration with capacity_kg and full_scale_v of the DAQ"
    ),
    ImportCode.MARKERS_MISSING: (
        "{path} has no marker {missing}, only {known}; correct the labels of the cuff in the configuration, or rename "
        "markers by --label THEIRS=OURS"
    ),
    ImportCode.NOTHING_VISIBLE: (
        "{path} shows no marker in any frame; export the trajectories that are identified in QTM"
    ),
    ImportCode.SAMPLE_RATE: (
        "{times} give {rate_hz:.3g} Hz, expected {lowest_hz:g} to {highest_hz:g} Hz; check that the times are in "
        "seconds"
    ),
    ImportCode.MARKER_DISTANCE: (
        "the markers of {path} are within {size_mm:.4g} mm of each other, expected {least_mm:g} to {most_mm:g} mm; "
        "give the unit of the file by --mocap-unit"
    ),
    ImportCode.IMPOSSIBLE_VALUE: (
        "{what} has {value:.4g} at {time_s:.3f} s, expected at most {most:g}; correct the value, or cut the file there"
    ),
    ImportCode.BEFORE_CAPTURE: (
        "{files}: the markers begin {before_s:.3g} s before the capture; export from frame 1 on"
    ),
    ImportCode.SHORT_OVERLAP: (
        "{files} have {common_s:.2f} s in common, expected at least half of {expected_s:.2f} s (" + _SPANS + "); check "
        "that both are of the same trial and the lag is in seconds, or cut the longer one"
    ),
    ImportCode.TIME_UNIT: (
        "{files} have {common_s:.2f} s in common, expected at least half of {expected_s:.2f} s (" + _SPANS + "); check "
        "that both are of the same trial; if the times of {times_of} are in {unit}, export them in s"
    ),
    ImportCode.NOT_USABLE: "{files} cannot be used: {reason}",
    ImportCode.FILE_EXISTS: "{path} exists and is not overwritten; move it to another folder",
    ImportCode.PARTIAL_OVERLAP: ("{files} have {common_s:.2f} s in common; the rest is not used: " + _SPANS),
    ImportCode.LAG_ASSUMED: (
        "{files} have no sync line, and neither --lag-sd-s nor sync.lag_sd_s is given: the standard uncertainty of the "
        "lag is taken as {lag_sd_ms:.1f} ms, from half a force sample at {rate_hz:g} Hz; give --lag-sd-s, or import a "
        "bounce"
    ),
    ImportCode.MARKER_FILE: "{text}",
    ImportCode.FORCE_COLUMN: "force from the column {column} of {file}: {least:.4g} to {most:.4g} {unit}",
    ImportCode.CUT_RECORDING: "{path} was cut and its end is unknown; only a complete recording can be completed",
    ImportCode.NO_LIVE_FRAMES: "{path} has no live frame to align the export with; import force and markers instead",
    ImportCode.NO_EDGE: "{path} cannot be completed: {reason}",
    ImportCode.FRAME_RATE: (
        "{file} has {rate_hz:g} frames per second, {path} has {live_rate_hz:g}, expected the same; check that it is "
        "the export of this trial"
    ),
    ImportCode.NOTHING_IN_COMMON: (
        "{file} and {path} have no marker and frame in common; check that it is the export of this trial, from frame 1 "
        "on"
    ),
    ImportCode.OTHER_TRIAL: (
        "the markers of {file} and of {path} are {distance_mm:.0f} mm apart, expected at most {limit_mm:g} mm; check "
        "that it is the export of this trial, from frame 1 on"
    ),
    ImportCode.FRAMES_ADDED: "frames missing in the live stream: {added:.0f} of {frames:.0f} in the export{first}",
    ImportCode.LABELS_ADDED: "markers missing in the live stream: {labels}",
    ImportCode.MARKERS_FILLED: "markers hidden in frames of the live stream, and filled: {filled}",
    ImportCode.FRAMES_KEPT: "frames missing in the export, and kept from the live stream: {frames:.0f}",
}

_EXPORT: Mapping[StrEnum, str] = {
    ExportCode.INCOMPLETE_COMMAND: "the export lacks {missing}; give it, or --osim to export a model with the suit",
    ExportCode.UNUSED_OPTION: "an export with {option} takes no {unused}; leave out the one or the other",
    ExportCode.INCOMPLETE_MODEL_COMMAND: "the export with --osim lacks --output; give the file to write",
    ExportCode.FILL_GAPS_FORMAT: ("--fill-gaps is for --to mot and --to sto; the other formats mark missing values"),
    ExportCode.NO_RECORDING: "{folder} contains no recording (*.mcap); give a session folder",
    ExportCode.NOTHING_WRITTEN: "{reasons}",
    ExportCode.NOT_EXPORTED: "{reason}",
    ExportCode.NO_COMMON_CLOCK: "{file} cannot be exported: {reason}",
    ExportCode.RAW_POSSIBLE: "{file} cannot be exported: {reason}; --to csv writes the raw samples",
    ExportCode.RAW_ONLY: "{file} has no common clock, every stream is exported raw: {reason}",
    ExportCode.NO_CUFF_FORCE: (
        "{file} is a {test} trial of the wearer, without a rope that pulls on a cuff; --to trc writes its markers for "
        "inverse kinematics, --to csv the force of its cord"
    ),
    ExportCode.BOUNCE: "{file} is a bounce: no cuff is loaded",
    ExportCode.NO_DIRECTION: "the direction of the force in {file} is unknown: {reason}",
    ExportCode.CUFF_HIDDEN: (
        "{file} shows the cuff and its anchor together in fewer than {rows:consecutive force sample}; "
        "`station info` shows how long every marker was hidden"
    ),
    ExportCode.ROWS_LEFT_OUT: (
        "the export of {file} leaves out {left_out:.0f} of {rows:row}, because a marker of the cuff or its anchor is "
        "hidden; the rest is in {files:gap-free file}. --fill-gaps writes one file and fills the gaps"
    ),
    ExportCode.ROWS_FILLED: (
        "{file}: direction and point of {hidden:row}, and {lost:row} of lost samples, are interpolated "
        "linearly; the longest gap is {longest_s:.3g} s"
    ),
    ExportCode.INCOMPLETE: "{file} is incomplete, and so is its export: {reasons}",
    ExportCode.MODEL_NOTE: "{text}",
    ExportCode.NO_SAMPLES: "{path} contains no samples to replay",
    ExportCode.NO_SYNC_EDGE: (
        "{path} was imported without a sync line, and a replay needs the sync edge; it can be fitted and exported only"
    ),
}

_CHAIN: Mapping[StrEnum, str] = {
    NumberCode.FILE: "{file} cannot be used ({reason}); write it again with `station report`",
    NumberCode.UNKNOWN: "{file} has no number {id}; the page shows the id of a number when the pointer rests on it",
    NumberCode.NOT_ON_PAGE: "{id} is not on the page",
    NumberCode.NOT_LISTED: "{id} is on the page and not in the file",
    NumberCode.PAGE: "{id} is {found} on the page, expected {expected}",
    NumberCode.RENDERING: "{id} has the text {found}, expected {expected} of its value",
    NumberCode.LEFT_OUT: "{id} is missing: its source gives it",
    NumberCode.NO_SOURCE: "{id} has no source: {pointer} is not in {source}",
    NumberCode.SOURCE: "{id} is {found}, expected {expected} from {source} {pointer}",
    NumberCode.FIGURE: "{id} is another drawing or caption than the one that was written",
    NumberCode.PROVENANCE: "{id} names other recordings or draws than those of {source} {pointer}",
    NumberCode.INPUT: "numbers that depend on it: {numbers}, the first {id}",
    NumberCode.RECOMPUTED: "{id} is {found}, and a new fit of the recordings gives {expected}",
    ChainCode.CHANGED: "{file} has changed since it was recorded: its SHA-256 is not the one in {sums}",
    ChainCode.ADDED: "{file} is not in {sums}: another program added it after the session was recorded",
    ChainCode.JOURNAL_ORDER: (
        "{file} has changed since it was recorded: line {line} does not continue the lines above it. Lines up to "
        "line {line} were changed, removed, inserted or reordered"
    ),
    ChainCode.JOURNAL_CHANGED: (
        "{file} has changed since it was recorded: it has {lines:line} and not the content in {sums}. The last "
        "line was changed or removed"
    ),
    ChainCode.LIST_LINE: "line {line} does not name a file of this folder with its SHA-256",
    ChainCode.LIST_MISSING: "{file} has hashes of its lines, and the list of all hashes of the folder is missing",
    ChainCode.NOT_ADDED: (
        "{file} was not added to {folder}: it is in the list of hashes, or not a file of a folder that has such a list"
    ),
    ChainCode.NOT_A_FOLDER: "{folder} is not a folder; give a session folder",
    ChainCode.NOTHING_TO_VERIFY: "{folder} contains no recording, no {cuffs} and no {report} to verify",
    ChainCode.NOT_REGULAR: "{path} is a folder, a pipe or a device, expected a regular file; replace it",
    ChainCode.BROKEN: "{folder} is not signed, its chain is broken at {link}; see `station verify {folder}`",
    ChainCode.NOT_SIGNED: "{folder} is not signed, ssh-keygen failed: {reason}",
    ChainCode.NO_SIGNERS: "{path} is not a file, expected the list of allowed signers of OpenSSH",
    ChainCode.NO_SSH_KEYGEN: "ssh-keygen is not installed on this computer; install OpenSSH 8.1 or newer",
    ChainCode.SSH_KEYGEN_FAILED: "ssh-keygen cannot be used: {reason}",
}

FILES: Mapping[StrEnum, str] = {**_IMPORT, **_EXPORT, **_CHAIN}
