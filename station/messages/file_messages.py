"""Messages on files: import, completion, export, replay, verification and signature."""

from __future__ import annotations

from documents.message import Code

_SPANS = (
    "force, with its lag, from {force_from_s:.2f} to {force_to_s:.2f} s, markers from {markers_from_s:.2f} to "
    "{markers_to_s:.2f} s"
)


class ImportCode(Code, prefix="import."):
    """Reason why files are not imported or do not complete a recording, and notes on what was written."""

    INCOMPLETE_COMMAND = "the import lacks {missing}; give it, or --over to complete a recording from --mocap alone"
    UNUSED_OPTION = "an import with {option} takes no {unused}; leave out the one or the other"
    WRONG_LABEL_PAIR = "--label {pair} does not name two labels, expected THEIRS=OURS"
    UNKNOWN_LABEL = "{path} has no marker {missing} to rename, only {known}"
    START_OUT_OF_RANGE = (
        "--start is {start}, expected a time from {earliest:.0f} to {latest:.0f}; give the time of the capture"
    )
    FORCE_FORMAT = "{path} ends in {suffix}, expected force in .csv, .txt, .tsv or .c3d"
    MARKER_FORMAT = "{path} ends in {suffix}, expected markers in .tsv, .trc or .c3d"
    NO_FORCE_COLUMN = "{path} has no column {expected} among {known}; name the column by --force-column"
    SEVERAL_FORCE_COLUMNS = (
        "{path} has the columns {found} among {known}, expected one; name the column by --force-column"
    )
    FORCE_UNIT = (
        "{path} declares {column} in {unit}, expected {known}; export it in one of them, or give --force-unit if the "
        "declaration is wrong"
    )
    NO_SCALE = (
        'the configuration has load_cell.source = "{source}" and no scale for the volts of {column}; give --force-unit '
        "N or lbs, or a configuration with capacity_kg and full_scale_v of the DAQ"
    )
    MARKERS_MISSING = (
        "{path} has no marker {missing}, only {known}; correct the labels of the cuff in the configuration, or rename "
        "markers by --label THEIRS=OURS"
    )
    NOTHING_VISIBLE = "{path} shows no marker in any frame; export the trajectories that are identified in QTM"
    SAMPLE_RATE = (
        "{times} give {rate_hz:.3g} Hz, expected {lowest_hz:g} to {highest_hz:g} Hz; check that the times are in "
        "seconds"
    )
    MARKER_DISTANCE = (
        "the markers of {path} are within {size_mm:.4g} mm of each other, expected {least_mm:g} to {most_mm:g} mm; "
        "give the unit of the file by --mocap-unit, or export in mm"
    )
    MARKERS_CLOSE = (
        "import.markers_close",
        "{one} and {other} of {path} are {distance_mm:.3g} mm apart, expected at least {least_mm:g} mm; give the unit "
        "of the file by --mocap-unit, or export in mm",
    )
    IMPOSSIBLE_VALUE = (
        "{what} has {value:.4g} at {time_s:.3f} s, expected at most {most:g}; correct the value, or cut the file there"
    )
    BEFORE_CAPTURE = "{files}: the markers begin {before_s:.3g} s before the capture; export from frame 1 on"
    SHORT_OVERLAP = (
        "{files} have {common_s:.2f} s in common, expected at least half of {expected_s:.2f} s (" + _SPANS + "); check "
        "that both are of the same trial and the lag is in seconds, or cut the longer one"
    )
    TIME_UNIT = (
        "{files} have {common_s:.2f} s in common, expected at least half of {expected_s:.2f} s (" + _SPANS + "); check "
        "that both are of the same trial; if the times of {times_of} are in {unit}, export them in s"
    )
    NOT_USABLE = "{files} cannot be used: {reason}"
    NOT_WRITTEN = "{path} could not be written: {reason}; check the disk and run the command again"
    FILE_EXISTS = "{path} exists and is not overwritten; move it to another folder"
    PARTIAL_OVERLAP = "{files} have {common_s:.2f} s in common; the rest is not used: " + _SPANS
    LAG_ASSUMED = (
        "{files} have no sync line, and neither --lag-sd-s nor sync.lag_sd_s is given: the standard uncertainty of the "
        "lag is taken as {lag_sd_ms:.1f} ms, from half a force sample at {rate_hz:g} Hz; give --lag-sd-s, or import a "
        "bounce"
    )
    MARKER_FILE = "{reason}"
    FORCE_COLUMN = "force from the column {column} of {file}: {least:.4g} to {most:.4g} {unit}"

    CUT_RECORDING = (
        "completion.cut_recording",
        "{path} was cut and its end is unknown; only a complete recording can be completed",
    )
    NO_LIVE_FRAMES = (
        "completion.no_live_frames",
        "{path} has no live frame to align the export with; import force and markers instead",
    )
    NO_EDGE = "completion.no_edge", "{path} cannot be completed: {reason}"
    FRAME_RATE = (
        "completion.frame_rate",
        "{file} has {rate_hz:g} frames per second, {path} has {live_rate_hz:g}, expected the same; check that it is "
        "the export of this trial",
    )
    NOTHING_IN_COMMON = (
        "completion.nothing_in_common",
        "{file} and {path} have no marker and frame in common; check that it is the export of this trial, from frame 1 "
        "on",
    )
    OTHER_TRIAL = (
        "completion.other_trial",
        "the markers of {file} and of {path} are {distance_mm:.0f} mm apart, expected at most {limit_mm:g} mm; check "
        "that it is the export of this trial, from frame 1 on",
    )
    FRAMES_ADDED = (
        "completion.frames_added",
        "frames missing in the live stream: {added:.0f} of {frames:.0f} in the export{first}",
    )
    LABELS_ADDED = "completion.labels_added", "markers missing in the live stream: {labels}"
    MARKERS_FILLED = "completion.markers_filled", "markers hidden in frames of the live stream, and filled: {filled}"
    FRAMES_KEPT = "completion.frames_kept", "frames missing in the export, and kept from the live stream: {frames:.0f}"


class ExportCode(Code, prefix="export."):
    """Reason why a recording is not exported or not replayed, and notes on what was written."""

    INCOMPLETE_COMMAND = "the export lacks {missing}; give it, or --osim to export a model with the suit"
    UNUSED_OPTION = "an export with {option} takes no {unused}; leave out the one or the other"
    INCOMPLETE_MODEL_COMMAND = "the export with --osim lacks --output; give the file to write"
    FILL_GAPS_FORMAT = "--fill-gaps is for --to mot and --to sto; the other formats mark missing values"
    NO_RECORDING = "{folder} contains no recording (*.mcap); give a session folder"
    NOTHING_WRITTEN = "{reasons}"
    NOT_EXPORTED = "{reason}"
    NO_COMMON_CLOCK = "{file} cannot be exported: {reason}"
    RAW_POSSIBLE = "{file} cannot be exported: {reason}; --to csv writes the raw samples"
    RAW_ONLY = "{file} has no common clock, every stream is exported raw: {reason}"
    NO_CUFF_FORCE = (
        "{file} is a {test} trial of the wearer, without a rope that pulls on a cuff; --to trc writes its markers for "
        "inverse kinematics, --to csv the force of its cord"
    )
    BOUNCE = "{file} is a bounce: no cuff is loaded"
    NO_DIRECTION = "the direction of the force in {file} is unknown: {reason}"
    CUFF_HIDDEN = (
        "{file} shows the cuff and its anchor together in fewer than {rows:consecutive force sample}; "
        "`station info` shows how long every marker was hidden"
    )
    ROWS_LEFT_OUT = (
        "the export of {file} leaves out {left_out:.0f} of {rows:row}, because a marker of the cuff or its anchor is "
        "hidden; the rest is in {files:gap-free file}. --fill-gaps writes one file and fills the gaps"
    )
    ROWS_FILLED = (
        "{file}: direction and point of {hidden:row}, and {lost:row} of lost samples, are interpolated "
        "linearly; the longest gap is {longest_s:.3g} s"
    )
    INCOMPLETE = "{file} is incomplete, and so is its export: {reasons}"
    MODEL_NOTE = "{reason}"

    NO_SAMPLES = "replay.no_samples", "{path} contains no samples to replay"
    NO_SYNC_EDGE = (
        "replay.no_sync_edge",
        "{path} was imported without a sync line, and a replay needs the sync edge; it can be fitted and exported only",
    )


class NumberCode(Code, prefix="number."):
    """Reason why a number of the report does not agree with its source."""

    FILE = "{path} cannot be used ({reason}); write it again with `station report`"
    UNKNOWN = "{file} has no number {id}; the page shows the id of a number when the pointer rests on it"
    NOT_ON_PAGE = "{id} is not on the page"
    NOT_LISTED = "{id} is on the page and not in the file"
    PAGE = "{id} is {found} on the page, expected {expected}"
    RENDERING = "{id} has the text {found}, expected {expected} of its value"
    NO_SOURCE = "{id} has no source: {pointer} is not in {source}"
    LEFT_OUT = "{id} is missing: its source gives it"
    SOURCE = "{id} is {found}, expected {expected} from {source} {pointer}"
    FIGURE = "{id} is another drawing or caption than the one that was written"
    PROVENANCE = "{id} names other recordings or draws than those of {source} {pointer}"
    INPUT = "numbers that depend on it: {numbers}, the first {id}"
    RECOMPUTED = "{id} is {found}, and a new fit of the recordings gives {expected}"


class ChainCode(Code, prefix="chain."):
    """Reason why a folder is not verified or signed, and remarks on its files."""

    CHANGED = "{file} has changed since it was recorded: its SHA-256 is not the one in {sums}"
    ADDED = "{file} is not in {sums}: another program added it after the session was recorded"
    JOURNAL_ORDER = (
        "{file} has changed since it was recorded: line {line} does not continue the lines above it. Lines up to "
        "line {line} were changed, removed, inserted or reordered"
    )
    JOURNAL_CHANGED = (
        "{file} has changed since it was recorded: it has {lines:line} and not the content in {sums}. The last "
        "line was changed or removed"
    )
    LIST_LINE = "line {line} does not name a file of this folder with its SHA-256"
    LIST_MISSING = "{file} has hashes of its lines, and the list of all hashes of the folder is missing"
    NOT_ADDED = (
        "{file} was not added to {folder}: it is in the list of hashes, or not a file of a folder that has such a list"
    )
    NOTHING_TO_VERIFY = "{folder} contains no recording, no {cuffs} and no {report} to verify"
    NOT_REGULAR = "{path} is a folder, a pipe or a device, expected a regular file; replace it"
    BROKEN = (
        "signature.chain_broken",
        "{folder} is not signed, its chain is broken at {link}; see `station verify {folder}`",
    )
    NOT_SIGNED = "signature.not_signed", "{folder} is not signed, ssh-keygen failed: {reason}"
    NO_SIGNERS = "signature.no_signers", "{path} is not a file, expected the list of allowed signers of OpenSSH"
    NO_SSH_KEYGEN = (
        "signature.no_ssh_keygen",
        "ssh-keygen is not installed on this computer; install OpenSSH 8.1 or newer",
    )
    SSH_KEYGEN_FAILED = "signature.ssh_keygen_failed", "ssh-keygen cannot be used: {reason}"
