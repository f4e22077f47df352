"""Codes of everything that a fit reports: stable names for programs. Their text is in fitting/results/sentences.py.

A code never changes its meaning. New codes may be added; a code that is no longer used stays, so that old files open.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum


class Verdict(StrEnum):
    """Which quantities are identified: the quantity, then after a dot the reason."""

    IDENTIFIED = "identified"
    GIVEN = "given"
    NO_STATIC = "stiffness_not_identified.no_static_trial"
    FEW_LOADS = "stiffness_not_identified.few_loads"
    ONLY_ROSE = "stiffness_not_identified.load_only_rose"
    STIFFNESS_UNCERTAIN = "stiffness_not_identified.wide_interval"
    STIFFNESS_NOT_CONVERGED = "stiffness_not_identified.not_converged"
    NO_DYNAMIC = "damping_not_identified.no_dynamic_trial"
    LAG = "damping_not_identified.lag"
    DAMPING_UNCERTAIN = "damping_not_identified.noise"
    NEGATIVE = "damping_not_identified.negative"
    DAMPING_NOT_CONVERGED = "damping_not_identified.not_converged"
    FRICTION = "damping_not_identified.friction"
    SCALE = "stiffness_and_damping_not_identified.gain_error"
    SKIN = "stiffness_and_damping_not_identified.skin_motion"
    NOT_UNLOADED = "migration_not_identified.not_unloaded"
    MIGRATED_BEFORE = "migration_not_identified.unusable_trial_before"

    @property
    def quantities(self) -> tuple[str, ...]:
        """Those that are not identified, also if there is a figure."""
        named, is_unidentified, _ = self.partition("_not_identified.")
        return tuple(named.split("_and_")) if is_unidentified else ()


class CauseCode(StrEnum):
    """A fault of the rig, or a property of the cuff beyond a spring and a damper."""

    TARE = "cause.tare_with_weight"
    ZERO_DRIFT = "cause.zero_drift"
    DISPLACEMENT_ZERO = "cause.displacement_zero"
    PULL_DIRECTION = "cause.pull_direction"
    LOOSE_MARKER = "cause.loose_anchor_marker"
    SKIN = "cause.skin_motion"
    GAIN = "cause.gain_error"
    LOADS = "cause.other_loads"
    PULLEY = "cause.pulley_friction"
    STIFFENING = "cause.stiffening"
    SOFTENING = "cause.softening"
    FRICTION = "cause.friction"
    STANDARD_LINEAR_SOLID = "cause.standard_linear_solid"
    CREEP = "cause.creep"
    SLIP = "cause.slip"


class FindingCode(StrEnum):
    """The figure of a check D1 to D8; D7 and D8 have two."""

    START = "start_from_static_zero"
    STIFFNESS_RATIO = "dynamic_over_static_stiffness"
    CURVATURE = "curvature"
    HARMONICS = "harmonics"
    DAMPING_POWER = "damping_over_frequency"
    ANGLE = "angle_of_pulls"
    UNLOADED_FORCE = "unloaded_force_between_records"
    UNLOADED_POSITION = "unloaded_place_between_records"
    FORCE_NOISE = "force_noise_swing_over_rest"
    MARKER_CORRELATION = "marker_noise_correlation"


class NoteCode(StrEnum):
    """A remark on the figures of a donning."""

    STOPPED_LOADING = "note.stopped_loading"
    STOPPED_UNLOADING = "note.stopped_unloading"
    STOPPED_SWINGING = "note.stopped_swinging"
    SLIPS_AGAIN = "note.slips_again"
    FRICTION_OR_MOVED = "note.friction_or_moved"
    SLIP_OR_FRICTION = "note.slip_or_friction"
    FRICTION_OR_CREEP = "note.friction"
    ONLY_ROSE = "note.load_only_rose"
    STATIC_STIFFNESS_USED = "note.static_stiffness_used"
    STIFFNESS_RATIO = "note.dynamic_over_static_stiffness"
    DAMPING_INTERVAL = "note.damping_interval_holds_zero"
    MIGRATION_INTERVAL = "note.migration_interval_wide"
    MIGRATED_BEFORE = "note.migration_before_unknown"
    MIXED_ORIGIN = "note.simulated_and_other_recordings"
    NOT_CALIBRATED = "note.not_calibrated"
    CREEPS = "note.creep"
    YIELDS = "note.yields_under_load"
    STIFFENS = "note.stiffening"
    SOFTENS = "note.softening"
    SHORT_HOLDS = "note.short_holds"
    ZERO_DRIFT = "note.zero_drift_removed"
    NO_ROPE = "note.direction_of_pull_unknown"
    PUBLISHED_DAMPING = "note.published_damping"
    KNOWN_MASS = "note.known_mass"
    KNOWN_MASS_ZERO_DRIFT = "note.known_mass_zero_drift"
    KNOWN_MASS_GAIN_DRIFT = "note.known_mass_gain_drift"
    NO_SHIFT = "note.assessed_without_migration"


EXPLAINED_BY: Mapping[StrEnum, tuple[Verdict, ...]] = {
    NoteCode.STOPPED_LOADING: (
        Verdict.FEW_LOADS,
        Verdict.ONLY_ROSE,
        Verdict.STIFFNESS_UNCERTAIN,
        Verdict.STIFFNESS_NOT_CONVERGED,
        Verdict.NOT_UNLOADED,
    ),
    NoteCode.STOPPED_UNLOADING: (Verdict.ONLY_ROSE, Verdict.NOT_UNLOADED),
    NoteCode.STOPPED_SWINGING: (Verdict.NO_DYNAMIC, Verdict.DAMPING_UNCERTAIN, Verdict.DAMPING_NOT_CONVERGED),
}
"""A trial that ended before its last step → verdicts that follow from it."""


class RejectionCode(StrEnum):
    """Why a recording is not used: it is unusable, or another recording replaces it."""

    RECORDED_AGAIN = "rejected.recorded_again"
    NOT_ACCEPTED = "rejected.not_accepted"
    SET_ASIDE = "rejected.set_aside"
    OTHER_TRIAL = "rejected.other_trial"
    DAMAGED = "rejected.damaged"
    UNREADABLE = "rejected.unreadable"
    IS_BOUNCE = "rejected.is_bounce"
    IS_WEARER_TRIAL = "rejected.is_wearer_trial"
    NO_CUFF = "rejected.no_cuff"
    NO_BOUNCE = "rejected.no_bounce"
    NO_BODY = "rejected.no_body"
    EMG_NO_CLOCK = "rejected.emg_without_clock"
    OTHER_MARKERS = "rejected.other_markers"
    NO_SAMPLES = "rejected.no_samples"
    NUMBERS_GO_BACK = "rejected.numbers_go_back"
    NO_OVERLAP = "rejected.no_overlap"
    NO_FRAMES = "rejected.no_frames"
    MISSING_MARKERS = "rejected.missing_markers"
    SYNC_NOT_FINITE = "rejected.sync_not_finite"
    SYNC_NEVER_RISES = "rejected.sync_never_rises"
    SYNC_RISES_AGAIN = "rejected.sync_rises_again"
    SYNC_INVERTED = "rejected.sync_inverted"
    SYNC_STARTS_HIGH = "rejected.sync_starts_high"
    FORCE_NOT_FINITE = "rejected.force_not_finite"
    FORCE_MISSING = "rejected.force_missing"
    FORCE_SATURATED = "rejected.force_saturated"
    FORCE_CONSTANT = "rejected.force_constant"
    FORCE_STUCK_MOVING = "rejected.force_stuck_while_moving"
    FORCE_STUCK_QUIET = "rejected.force_stuck_without_noise"
    FORCE_POLARITY = "rejected.force_polarity"
    STEPS_APART = "rejected.steps_apart"
    ZERO_DRIFT = "rejected.zero_drift"
    ANCHOR_HIDDEN = "rejected.anchor_hidden"
    ANCHOR_COLLINEAR = "rejected.anchor_collinear"
    CUFF_HIDDEN = "rejected.cuff_hidden_at_start"
    MARKERS_HIDDEN = "rejected.markers_hidden"
    MARKERS_FROZEN = "rejected.markers_frozen"
    DISPLACEMENT_UNIT = "rejected.displacement_unit"
    NO_MOTION = "rejected.no_motion"
    FEW_LOADS = "rejected.few_loads"
    NOT_UNLOADED = "rejected.not_unloaded"
    SHORT = "rejected.short"
    NO_SWING = "rejected.no_swing"
    FEW_CYCLES = "rejected.few_cycles"
    FEW_SAMPLES = "rejected.few_samples_per_cycle"
    SWING_HIDDEN = "rejected.swing_hidden"
    SMALL_MOTION = "rejected.small_motion"
    SLIPS_ON = "rejected.slips_throughout"
    INDISTINCT = "rejected.stiffness_and_damping_indistinct"
    BOUNCE_FEW_CYCLES = "rejected.bounce_few_cycles"
    BOUNCE_FEW_SAMPLES = "rejected.bounce_few_samples_per_cycle"
    BOUNCE_HIDDEN = "rejected.bounce_marker_hidden"
    BOUNCE_STILL = "rejected.bounce_marker_still"
    BOUNCE_GAPS = "rejected.bounce_gaps"
    BOUNCE_POLARITY = "rejected.bounce_polarity"
    BOUNCE_NOT_CONVERGED = "rejected.bounce_not_converged"


class TrialNoteCode(StrEnum):
    """A remark on a single trial: its subject, then after a dot the remark."""

    DAMAGED = "recording.damaged"
    INCOMPLETE = "recording.incomplete"
    ASSIGNED = "recording.assigned"
    WINDOW = "recording.window"
    FORCE_LOST = "force.samples_lost"
    FORCE_MISSING = "force.missing"
    ZERO_DRIFT = "force.zero_drift"
    FRAMES_LOST = "markers.frames_lost"
    MARKERS_HIDDEN = "markers.hidden"
    GHOSTS = "markers.ghosts"
    LOOSE_MARKER = "markers.loose_anchor_marker"
    SKIN = "markers.skin_motion"
    LEAN = "markers.lean"
    TURNS = "markers.cuff_turns"
    SYNC_CERTIFICATE = "sync.certificate"
    SYNC_BOUNCES = "sync.edge_bounces"
    SYNC_DIPS = "sync.low_during_capture"
    SYNC_SPIKES = "sync.high_beside_capture"
    SYNC_EARLY = "sync.early_edge"
    SYNC_BEFORE_FRAMES = "sync.edge_before_first_frame"
    SYNC_LOW = "sync.low_at_start"
    SYNC_NO_STOP = "sync.no_stop_edge"
    SYNC_SHORT = "sync.short_pulse"
    SYNC_ARRIVAL = "sync.aligned_by_arrival"
    SYNC_CONTRADICTION = "sync.stop_edge_contradicts_frames"
    SYNC_MISSING_FRAMES = "sync.frames_missing_at_end"
    CLOCKS_OR_FRAMES = "sync.clock_ratio_or_missing_frames"
    CLOCKS_OPEN = "sync.clock_ratio_open"
    EMG_HOST_CLOCK = "emg.aligned_by_host_clock"
    EMG_NO_SYNC = "emg.no_sync_line"
    EMG_LEFT_OUT = "emg.left_out"
    ANOTHER_LINE = "pull.another_line"
    TURNED = "pull.motion_turned"
    LOAD_FALLS = "weights.load_falls"
    NO_WEIGHT = "weights.none_hung_on"
    WEIGHT_GAIN = "weights.gain_error"
    PULLEY = "weights.pulley_friction"
    WRONG_LOAD = "weights.wrong_load"
    FEW_WEIGHTS = "weights.some_not_hung_on"
    ONE_BRANCH = "weights.single_unloading_branch"
    START_LEFT_OUT = "swing.start_left_out"
    POLARITY = "swing.polarity"
    SMALL_MOTION = "swing.small_motion"
    DISAGREES = "swing.cross_check_disagrees"
    CHECK_NOT_CONVERGED = "swing.cross_check_not_converged"
    COLOURED = "swing.marker_noise_correlated"
    NOT_CONVERGED = "swing.not_converged"
    BOUNCE_GAIN = "bounce.gain_error"
    BOUNCES_NOT_CONVERGED = "bounce.spread_not_converged"
    BOUNCE_TARED = "bounce.tared_with_weight"


class FitErrorCode(StrEnum):
    """Why a file of the session, a reading of a known mass, a cuff or EMG cannot be used."""

    PROTOCOL_UNREADABLE = "protocol_file.unreadable"
    PROTOCOL_NOT_TOML = "protocol_file.not_toml"
    PROTOCOL_INVALID = "protocol_file.invalid"
    PROTOCOL_NO_RECORDING = "protocol_file.no_such_recording"
    PROTOCOL_OUTSIDE = "protocol_file.step_outside_trial"
    CUFFS_UNREADABLE = "cuffs_file.unreadable"
    CUFFS_NOT_JSON = "cuffs_file.not_json"
    CUFFS_MISSING = "cuffs_file.no_cuffs"
    CUFFS_FORMAT = "cuffs_file.unknown_format"
    CUFFS_NAME = "cuffs_file.name_is_path"
    CUFFS_INVALID = "cuffs_file.invalid"
    CHECKS_UNREADABLE = "mass_checks.unreadable"
    CHECKS_INVALID = "mass_checks.invalid_line"
    CHECK_SHORT = "mass_checks.few_samples"
    NOT_IDENTIFIED = "cuff.not_identified"
    CUFF_IMPOSSIBLE = "cuff.impossible_value"
    CUFF_KEY = "cuff.unknown_key"
    CUFF_NAME = "cuff.no_name"
    CUFF_TWICE = "cuff.name_twice"
    EMG_RATE = "emg.rate_too_low"
    EMG_SHORT = "emg.too_short"
    EMG_BAND = "emg.band_above_half_the_rate"
    EMG_NO_CHANNEL = "emg.no_usable_channel"
    EMG_MVC_SHORT = "emg.mvc_too_short"
    EMG_OTHER_TIME = "emg.no_common_time"


class TensorCode(StrEnum):
    """Why there is no stiffness or damping in three dimensions."""

    NO_ROPE = "tensor.no_rope_markers"
    ROPE_HIDDEN = "tensor.rope_hidden"
    ROPE_HIDDEN_IN_HOLD = "tensor.rope_hidden_in_a_hold"
    ONE_LINE = "tensor.pulls_along_one_line"
    ONE_PLANE = "tensor.pulls_in_one_plane"
    EQUAL_LOADS = "tensor.equal_loads"
    NOT_POSITIVE = "tensor.not_positive"
    NO_SWING = "tensor.no_swing"
    NOT_CONVERGED = "tensor.not_converged"


class GainMistake(StrEnum):
    """A common mistake in the scale of the load cell."""

    CAPACITY_DOUBLED = "gain_mistake.capacity_doubled"
    CAPACITY_HALVED = "gain_mistake.capacity_halved"
    CAPACITY_TENFOLD = "gain_mistake.capacity_tenfold"
    CAPACITY_TENTH = "gain_mistake.capacity_tenth"
    CAPACITY_25_LB = "gain_mistake.cell_of_25_lb"
    POUNDS_FOR_KILOGRAMS = "gain_mistake.pounds_for_kilograms"
    KILOGRAMS_FOR_POUNDS = "gain_mistake.kilograms_for_pounds"
    NEWTONS_FOR_POUNDS = "gain_mistake.newtons_for_pounds"
    POUNDS_FOR_NEWTONS = "gain_mistake.pounds_for_newtons"
    NEWTONS_FOR_KILOGRAMS = "gain_mistake.newtons_for_kilograms"
    KILOGRAMS_FOR_NEWTONS = "gain_mistake.kilograms_for_newtons"
    UNKNOWN = "gain_mistake.unknown"


class FitOutcome(StrEnum):
    """How an iteration ended.

    CONVERGED      its convergence criterion was met
    NOT_CONVERGED  it reached its limit of rounds while its parameters still changed
    NO_SOLUTION    it left the range in which the law describes a cuff, for example with a negative stiffness
    """

    CONVERGED = "converged"
    NOT_CONVERGED = "not_converged"
    NO_SOLUTION = "no_solution"


NEGLIGIBLE = 0.01
"""Standard errors by which a parameter may change in the last round of a converged fit."""


def worst(outcomes: Iterable[FitOutcome]) -> FitOutcome:
    """The outcome of a fit in several parts, all of which must converge."""
    found = set(outcomes)
    return next(
        (outcome for outcome in (FitOutcome.NO_SOLUTION, FitOutcome.NOT_CONVERGED) if outcome in found), CONVERGED
    )


CONVERGED = FitOutcome.CONVERGED


class Standing(StrEnum):
    """Comparison of a file with the hash recorded when it was written, or of a figure with the fit."""

    AS_RECORDED = "as recorded"
    CHANGED = "changed since"
    MISSING = "missing"
    ADDED = "added since"
    BY_HAND = "given by hand"
    UNRECORDED = "no hash recorded"

    @property
    def is_break(self) -> bool:
        """Whether this breaks the chain of hashes from the report to the recordings."""
        return self in (Standing.CHANGED, Standing.MISSING, Standing.ADDED)
