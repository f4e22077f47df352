"""Codes of the station's messages: stable names for programs. The sentences are in station/messages/sentences.py.

A code keeps its meaning for ever. A new one may be added; one that is no longer used stays, so that old files open.
The part of a code before its dot is the kind of the event in the recording, the part after it is the reason.
"""

from __future__ import annotations

from enum import StrEnum


class TrialCode(StrEnum):
    """State of a trial, the reason of its end, and what a reader of its recording should know."""

    OPENING = "opening"
    ARMED = "armed"
    CAPTURE_RUNNING = "capture_running"
    RECORDING = "recording"

    CAPTURE_ENDED = "capture_ended"
    CAPTURE_ENDED_RENUMBERED = "capture_ended.frames_renumbered"
    CAPTURE_ENDED_NO_FRAMES = "capture_ended.no_frames"
    CAPTURE_REPLACED = "capture_replaced"
    DURATION_REACHED = "duration_reached"
    OPERATOR_STOP = "operator_stop"
    CANCELLED = "cancelled"
    DEVICE_LOST = "device_lost"
    DEVICE_SILENT = "device_lost.silent"
    NO_SYNC_EDGE_LOW = "no_sync_edge.low"
    NO_SYNC_EDGE_HIGH = "no_sync_edge.high"
    NO_SYNC_EDGE_NO_SAMPLES = "no_sync_edge.no_samples"
    NO_SYNC_EDGE_FELL = "no_sync_edge.fell"
    WRONG_POLARITY = "wrong_polarity"
    DISK_NEARLY_FULL = "disk_nearly_full"
    WRITE_FAILED = "write_failed"
    NOT_STARTED = "not_started"
    RECORDER_KILLED = "recorder_killed"
    UNREADABLE = "unreadable"

    SECOND_START = "sync_double_edge"
    EMPTY_CAPTURE = "empty_capture"
    END_MISSING = "end_missing"
    NO_STOP_EDGE = "no_stop_edge"
    CLOCK_SET_BACK = "clock_set_back"
    OVERWRITTEN = "overloaded.samples_overwritten"
    LATE = "overloaded.samples_late"
    STATION_PAUSED = "station_paused"
    GLITCH_UP = "sync_glitch.up"
    GLITCH_DOWN = "sync_glitch.down"


class RefusalCode(StrEnum):
    """Reason why a trial is not started."""

    CANCELLED_OPENING = "refused.cancelled"
    SIMULATED_DEVICES = "refused.simulated_devices"
    MIXED_ORIGIN = "refused.mixed_origin"
    FOLDER_NOT_MADE = "refused.folder_not_made"
    FOLDER_READ_ONLY = "refused.folder_read_only"
    DISK_FULL = "refused.disk_full"
    FOLDER_IN_USE = "refused.folder_in_use"
    NO_LOCKS = "refused.no_locks"
    PATH_TOO_LONG = "refused.path_too_long"
    RECORDER_ENDED = "refused.recorder_ended"


class KinematicsCode(StrEnum):
    """Reasons why markers do not fit a model, and findings on postures."""

    NONE_IN_COMMON = "markers.none_in_common"
    SEVERAL_PERSONS = "markers.several_persons"
    NO_SUCH_PREFIX = "markers.no_such_prefix"
    MARKERS_MISSING = "markers.too_few"
    WRONG_SIZE = "markers.wrong_size"
    ONE_IN_COMMON = "markers.one_in_common"
    MIRRORED = "markers.mirrored"
    NO_FIT = "markers.no_fit"
    TILTED = "markers.tilted"
    EXCHANGED = "markers.exchanged"
    FAR = "markers.far_off"
    NEVER_SEEN = "markers.never_seen"
    UNKNOWN_SET = "marker_set.unknown"
    WRONG_SET = "marker_set.unreadable"
    NO_BODY = "marker_set.no_body"
    WITHOUT_PLACE = "marker_set.without_place"
    ELSEWHERE = "marker_set.other_body"
    WRONG_FACTOR = "scale.factor"
    WRONG_MANUAL_FACTOR = "scale.manual_factor"
    OTHER_RANGE = "setup.time_range_overridden"
    RANGE_NOT_COVERED = "markers.range_not_covered"
    NOT_HELD = "posture.not_held"
    NOT_CONVERGED = "posture.not_converged"
    GAP_OPEN = "posture.gap_open"
    NO_MARKERS = "posture.no_markers"


class CheckCode(StrEnum):
    """Result of one check of the bench."""

    ANSWERS = "device.answers"
    ANSWERS_SIMULATED = "device.answers_simulated"
    NO_ANSWER = "device.no_answer"
    DEVICE_ERROR = "device.error"
    RATE = "stream.rate"
    NO_CAPTURE = "stream.no_capture"
    AT_REST = "force.at_rest"
    SATURATED = "force.saturated"
    LOADED = "force.loaded"
    CALIBRATION_VALID = "calibration.valid"
    CALIBRATION_DUE = "calibration.due"
    CALIBRATION_IN_FUTURE = "calibration.in_future"
    CALIBRATION_UNKNOWN = "calibration.unknown"
    SYNC_LOW = "sync.low"
    SYNC_HIGH = "sync.high"
    LABELS_PRESENT = "markers.present"
    LABELS_MISSING = "markers.missing"
    DISK = "disk.free"
    MASS_RIGHT = "mass.right"
    MASS_WRONG = "mass.wrong"
    MASS_WITHOUT_ZERO = "mass.zero_missing"


class JournalCode(StrEnum):
    """Reason why session.jsonl cannot be read or written."""

    UNREADABLE = "journal.unreadable"
    WRONG_LINE = "journal.wrong_line"
    NOT_WRITTEN = "journal.not_written"
    NO_REASON = "journal.no_reason"


class CueCode(StrEnum):
    """Instruction of the guide during a trial."""

    EMPTY_HOOK = "cue.empty_hook"
    ADD_WEIGHT = "cue.add_weight"
    REMOVE_WEIGHT = "cue.remove_weight"
    WRONG_FORCE = "cue.wrong_force"
    STATIC_DONE = "cue.static_done"
    FIRST_LEVEL = "cue.first_level"
    HOLD = "cue.hold"
    NEXT_LEVEL = "cue.next_level"
    STAND_STILL = "cue.stand_still"
    PULL_SPRING = "cue.pull_spring"
    BOUNCE = "cue.bounce"
    KEEP_SWINGING = "cue.keep_swinging"
    LET_REST = "cue.let_rest"
    SWING_DONE = "cue.swing_done"
    HOLD_POSE = "cue.hold_pose"
    POSE_DONE = "cue.pose_done"
    RAISE_ARM = "cue.raise_arm"
    LOWER_ARM = "cue.lower_arm"
    MOTION_DONE = "cue.motion_done"
    MOVE_UNCOUNTED = "cue.move_uncounted"
    CONTRACT = "cue.contract"


class AlarmCode(StrEnum):
    """A force limit was exceeded."""

    OVERLOAD = "alarm.overload"
    FORCE = "alarm.force"
    FORCE_RATE = "alarm.force_rate"


class CommandCode(StrEnum):
    """Reason why a command of the operator is refused."""

    NO_SUBJECT = "setup.no_subject"
    WRONG_SUBJECT = "setup.subject"
    WRONG_NUMBER = "setup.number"
    NO_CUFF_CHOSEN = "setup.no_cuff"
    UNKNOWN_CUFF = "setup.unknown_cuff"
    WRONG_MASSES = "setup.masses"
    NO_BODY = "setup.no_body"
    MASSES_NOT_NUMBERS = "setup.masses_not_numbers"
    OTHER_PLAN = "session.other_plan"
    NO_PLAN = "session.no_plan"
    NO_SESSION = "session.none"
    COMPLETE = "session.complete"
    SUMMARY_RUNNING = "session.summary_running"
    NOTHING_TO_SKIP = "command.nothing_to_skip"
    TRIAL_RUNNING = "command.trial_running"
    UNDECIDED = "command.undecided"
    NO_TRIAL = "command.no_trial"
    NO_MARK_YET = "command.no_mark_yet"
    UNKNOWN_MARK = "command.unknown_mark"
    NO_FORCE = "command.no_force"
    NOTHING_TO_DECIDE = "command.nothing_to_decide"
    NOTHING_TO_UNDO = "command.nothing_to_undo"
    UNKNOWN_RECORDING = "command.unknown_recording"
    BOUNCE_NOT_ASSIGNABLE = "command.bounce_not_assignable"
    NOT_IN_PLAN = "command.not_in_plan"
    NOT_NOW = "command.not_now"
    NOT_WHILE_RUNNING = "command.not_while_running"
    BEING_RECORDED = "command.being_recorded"
    TOO_LATE = "command.too_late"
    WAITS_FOR_DECISION = "command.waits_for_decision"
    REASON_MISSING = "command.reason_missing"
    NOTHING_TO_REDO = "command.nothing_to_redo"
    BOUNCE_NOT_DONNED = "command.bounce_not_donned"
    LOSES_MIGRATION = "command.loses_migration"
    UNKNOWN_COMMAND = "command.unknown"
    UNEXPECTED_ARGUMENT = "command.unexpected_argument"
    UNKNOWN_KEY = "command.unknown_key"
    NEW_SESSION = "session.subject_missing"


class ReasonCode(StrEnum):
    """Reason to repeat a trial, or to doubt it."""

    NOT_ACCEPTED = "reason.not_accepted"
    LOST_SAMPLES = "reason.lost_samples"
    UNUSABLE = "reason.unusable"
    NO_STATIC_RESULT = "reason.no_static_result"
    NO_DYNAMIC_RESULT = "reason.no_dynamic_result"
    SLIPPED = "reason.slipped"
    OUTLIER = "reason.outlier"
    ZERO_DRIFT = "reason.zero_drift"
    NOT_USED = "reason.not_used"
    FIT_FAILED = "reason.fit_failed"
    FIT_KILLED = "reason.fit_killed"
    MARKERS_HIDDEN = "reason.markers_hidden"
    POSE_MOVES = "reason.pose_moves"
    CYCLES_MISSING = "reason.cycles_missing"
    EMG_UNUSABLE = "reason.emg_unusable"
    NO_EMG_CLOCK = "reason.no_emg_clock"


class TerminalCode(StrEnum):
    """Messages of a session between and during trials."""

    CAPTURE_NOT_RECORDED = "terminal.capture_not_recorded"
    PAUSED = "terminal.paused"
    START = "terminal.start"
    DECIDE = "terminal.decide"
    DECIDE_OR_REDON = "terminal.decide_or_redon"
    REDO_ADVISED = "terminal.redo_advised"
    REDON_ADVISED = "terminal.redon_advised"
    PAUSE_AFTER_TRIAL = "terminal.pause_after_trial"
    PAUSE_AFTER_DECISION = "terminal.pause_after_decision"
    MARKED = "terminal.marked"
    SUMMARY_STARTED = "terminal.summary_started"
    TRIALS_LEFT = "terminal.trials_left"
    REPORT_MISSING = "terminal.report_missing"
    SUMMARY_FAILED = "terminal.summary_failed"
    COMPLETE = "terminal.complete"


class VerdictCode(StrEnum):
    """Headline of the verdict on a recording, by its grade."""

    GOOD = "verdict.good"
    DOUBTFUL = "verdict.doubtful"
    BAD = "verdict.bad"


class ServeCode(StrEnum):
    """Reason why the console does not start."""

    CANNOT_LISTEN = "serve.cannot_listen"


class AssessmentCode(StrEnum):
    """A finding of an assessment: comparison of cuffs, choice, uncertainty, limits."""

    NO_CHOICE = "choice.unknown"
    ONLY_CUFF = "choice.only_cuff"
    LEAST_EFFORT = "choice.least_effort"
    EQUIVALENT = "choice.equivalent"
    NOT_COMPARED = "comparison.unknown"
    WITHOUT_INTERVAL = "comparison.without_interval"
    DIFFERENT = "comparison.different"
    NOT_RELEVANT = "comparison.not_relevant"
    NOT_DISTINGUISHED = "comparison.not_distinguished"
    BEST_REST_LENGTH = "rest_length.best"
    OUTSIDE_RANGE = "rest_length.outside_range"
    NO_INTERVALS = "intervals.none"
    NO_COVARIANCE = "intervals.no_covariance"
    INTERVALS = "intervals.computed"
    INTERVALS_UNVERIFIED = "intervals.unverified"
    INTERVALS_TOTAL = "intervals.total"
    PEOPLE_UNSOLVED = "intervals.people_unsolved"
    CORD_FORCE = "cord.force"
    MIGRATION_COST = "cord.migration_cost"
    MIGRATION_COST_OPEN = "cord.migration_cost.not_distinguished"
    MIGRATION_COST_ALONE = "cord.migration_cost.without_interval"
    RESERVES_SMALL = "reserves.small"
    RESERVES_LARGE = "reserves.large"
    RESERVES_LARGE_AT = "reserves.large.at_coordinates"
    RESIDUALS_LARGE = "residuals.large"
    RATE_EXCEEDED = "frames.beyond_activation_rate"
    INFEASIBLE = "frames.infeasible"
    INFEASIBLE_WITHOUT_CONE = "frames.infeasible.without_cone"
    NOT_CONVERGED = "frames.not_converged"
    NOT_FINITE = "frames.not_finite"
    PATH_NOT_CONVERGED = "muscles.path_not_converged"
    CURVE_NOT_CONVERGED = "muscles.curve_not_converged"
    FIBER_NOT_CONVERGED = "muscles.fiber_not_converged"
    NEGATIVE_MIGRATION = "cuffs.negative_migration"
    NO_GLENOID = "model.no_glenoid"
    NO_ARM_SEGMENTS = "model.no_arm_segments"
    LEFT_OUT = "model.left_out"
    WITHOUT_DATA = "motion.without_data"
    RANGE_NOT_COVERED = "motion.range_not_covered"
    ROW_COUNTS = "motion.row_counts"
    VIOLATES_CONSTRAINT = "motion.violates_constraint"
    BEYOND_RANGE = "motion.beyond_range"
    TRANSLATION_BEYOND_RANGE = "motion.translation_beyond_range"
    RADIANS_AS_DEGREES = "motion.radians_as_degrees"
    RESAMPLED = "motion.resampled"
    LOW_CUTOFF = "motion.low_cutoff"
    NO_LOAD_APPLIED = "loads.none_applied"
    LOAD_FAR_FROM_BODY = "loads.far_from_body"


class DecisionCode(StrEnum):
    """Which cuff to choose, as solver.suit.decision.DecisionOutcome; FIT_ONLY: the total uncertainty is not known.
    NO_PEOPLE: nor can it be, because people are not drawn with elastic tendons.
    """

    CHOOSE = "decision.choose"
    EQUIVALENT = "decision.equivalent"
    EQUIVALENT_AND_WORSE = "decision.equivalent_and_worse"
    UNDECIDED = "decision.undecided"
    ONLY_CUFF = "decision.only_cuff"
    UNKNOWN = "decision.unknown"
    FIT_ONLY = "decision.fit_only"
    NO_PEOPLE = "decision.no_people"
    CUBES_AGREE = "decision.cubes_agree"
    CUBES_DIFFER = "decision.cubes_differ"
    SETTLE_FIT = "settle.fit"
    SETTLE_DONNING = "settle.donning"
    SETTLE_BODY = "settle.body"
    SETTLE_MUSCLES = "settle.muscles"
    SETTLE_MOTION = "settle.motion"
    SETTLE_UNKNOWN = "settle.unknown"


class InputCode(StrEnum):
    """Reason why files do not make an assessment, a suit or a sweep."""

    UNKNOWN_CUFF = "input.unknown_cuff"
    CUFF_NAMED_RIGID = "input.cuff_named_rigid"
    RICHER_LAW = "input.richer_law"
    OUTPUT_IS_FILE = "input.output_is_file"
    ONE_ARM_CUFF = "input.one_arm_cuff"
    NO_CUFFS_FILE = "input.no_cuffs_file"
    CONDITION_WITHOUT_CUFFS = "input.condition_without_cuffs"
    TABLE_FORMAT = "input.table_format"
    BUDGET = "input.budget"
    PEOPLE_FAILED = "input.people_failed"
    NO_PEOPLE = "input.no_people"
    NO_GLENOID_TO_KEEP = "input.no_glenoid_to_keep"
    NO_ARM_OF_SUBJECT = "input.no_arm_of_subject"
    DONNING_SPREAD = "input.donning_spread"
    EMG_UNREADABLE = "emg.unreadable"
    EMG_COLUMNS = "emg.columns"
    EMG_MUSCLE = "emg.unknown_muscle"
    EMG_NUMBER = "emg.number"
