"""Codes of what a fit says: stable names for programs. Their sentences are in fitting/results/rendering.py.

A code keeps its meaning for ever. A new one may be added; one that is no longer given stays, so that old files open.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class Verdict(StrEnum):
    """What was and was not identified: the quantity, then after a dot the reason."""

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
    SCALE = "stiffness_and_damping_not_identified.gain_error"
    SKIN = "stiffness_and_damping_not_identified.skin_motion"
    NOT_UNLOADED = "migration_not_identified.not_unloaded"
    MIGRATED_BEFORE = "migration_not_identified.unusable_trial_before"


DOUBTED: Mapping[Verdict, tuple[str, ...]] = {
    Verdict.LAG: ("damping",),
    Verdict.DAMPING_UNCERTAIN: ("damping",),
    Verdict.NEGATIVE: ("damping",),
    Verdict.DAMPING_NOT_CONVERGED: ("damping",),
    Verdict.SCALE: ("stiffness", "damping"),
    Verdict.SKIN: ("stiffness", "damping"),
}
"""Verdict → the quantities that it calls not identified, though there is a figure."""


class CauseCode(StrEnum):
    """What may be wrong with a rig, or richer in a cuff than a spring and a damper."""

    TARE = "cause.tare_with_weight"
    ZERO_DRIFT = "cause.zero_drift"
    DISPLACEMENT_ZERO = "cause.displacement_zero"
    PULL_DIRECTION = "cause.pull_direction"
    LOOSE_MARKER = "cause.loose_anchor_marker"
    SKIN = "cause.skin_motion"
    GAIN = "cause.gain_error"
    PULLEY = "cause.pulley_friction"
    STIFFENING = "cause.stiffening"
    SOFTENING = "cause.softening"
    FRICTION = "cause.friction"
    STANDARD_LINEAR_SOLID = "cause.standard_linear_solid"
    CREEP = "cause.creep"
    SLIP = "cause.slip"


class FindingCode(StrEnum):
    """The number that a check D1 to D8 gives; D7 and D8 give two."""

    START = "start_from_static_zero"
    STIFFNESS_RATIO = "dynamic_over_static_stiffness"
    CURVATURE = "curvature"
    HARMONICS = "harmonics"
    DAMPING_POWER = "damping_over_frequency"
    ANGLE = "angle_of_pulls"
    UNLOADED_FORCE = "unloaded_force_between_records"
    UNLOADED_PLACE = "unloaded_place_between_records"
    FORCE_NOISE = "force_noise_swing_over_rest"
    MARKER_MEMORY = "marker_noise_correlation"


class NoteCode(StrEnum):
    """What a reader should know before believing a figure."""

    SLIPS_AGAIN = "note.slips_again"
    RUBS_OR_MOVED = "note.friction_or_moved"
    SLIP_OR_FRICTION = "note.slip_or_friction"
    RUBS = "note.friction"
    ONLY_ROSE = "note.load_only_rose"
    STATIC_STIFFNESS_USED = "note.static_stiffness_used"
    STIFFNESS_RATIO = "note.dynamic_over_static_stiffness"
    DAMPING_INTERVAL = "note.damping_interval_holds_zero"
    MIGRATED_BEFORE = "note.migration_before_unknown"
    MIXED_ORIGIN = "note.simulated_and_other_recordings"
    CREEPS = "note.creep"
    YIELDS = "note.yields_under_load"
    STIFFENS = "note.stiffening"
    SOFTENS = "note.softening"
    ZERO_DRIFT = "note.zero_drift_removed"
    KNOWN_MASS = "note.known_mass"
    KNOWN_MASS_ZERO_DRIFT = "note.known_mass_zero_drift"
    KNOWN_MASS_GAIN_DRIFT = "note.known_mass_gain_drift"
    NO_SHIFT = "note.assessed_without_migration"
