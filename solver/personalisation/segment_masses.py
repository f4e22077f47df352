"""Parameters of a person that markers do not show: masses of the arm and tendon slack lengths.

Masses of a person's arm, and a load in the hand as a body of its own. A generic model has the masses of another person,
sometimes with the load of a trial inside its hand. Scaling by volume would scale the load as well, and a scaled thorax
would take mass off the arm where the whole model's mass is given.

Tendon slack lengths with which a person's own motions stay in the active range of the muscles. A scaled generic muscle
can be too short or too long for a motion that the person made by his own force: below half of its optimal length a
fibre gives no active force, and far above it is pulled passively (Zajac 1989, Crit. Rev. Biomed. Eng. 17:359). Tendon
slack length is the least known of the parameters (Garner and Pandy 2003, Ann. Biomed. Eng. 31:207, fit it so that
fibres work in their range). Here it changes as little as brings the fibre into a range, FIBRE_RANGE by default, and
only in muscles that leave it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.model import (
    NO_COORDINATE,
    Array,
    AxisMotion,
    Body,
    Joint,
    Model,
    ModelError,
    Muscle,
    Placement,
    with_mass_ratios,
)
from solver.personalisation.anthropometry import ARM_SEGMENTS
from solver.scaling import FIBRE_RANGE, LARGEST_JUMP, muscle_ranges

HAND: Final = "hand"
LOAD: Final = "held_load"

UPPER_ARM: Final = "upper arm"
REFERENCE_LENGTH: Final = 0.278
"""m, from shoulder to elbow centre, of persons of REFERENCE_MASS: means of the men and women of de Leva (1996)."""
REFERENCE_MASS: Final = 67.5  # kg
MASS_EXPONENT: Final = 1.97
"""Of body mass over upper arm length in ANSUR II (acromion-radiale length), both sexes with equal weight."""
MASS_DEVIATION: Final = 0.153
"""Standard deviation of ln(body mass) about that."""
MOST_DEVIATIONS: Final = 4.0  # none of 6,068 persons is farther off
USUAL_RATIO: Final = 1.5
"""Of a segment's mass over the expected one, either way, before it is a finding."""


def segment_masses(model: Model) -> dict[str, float]:
    """Mass [kg] of each of ARM_SEGMENTS that the model has."""
    masses = {body.name: body.mass for body in model.bodies}
    return {
        name: sum(masses[body] for body in segment.bodies)
        for name, segment in ARM_SEGMENTS.items()
        if masses.keys() >= set(segment.bodies)
    }


def mass_ratios(model: Model) -> Mapping[str, float]:
    """Mass of each arm segment over the expected one, where it is unusual (USUAL_RATIO); expected of the person whose
    upper arm the model has.
    """
    found = segment_masses(model)
    if UPPER_ARM not in found:
        return {}
    body_mass = found[UPPER_ARM] / ARM_SEGMENTS[UPPER_ARM].mass_fraction
    ratios = {name: mass / (ARM_SEGMENTS[name].mass_fraction * body_mass) for name, mass in found.items()}
    return {name: ratio for name, ratio in ratios.items() if not 1.0 / USUAL_RATIO <= ratio <= USUAL_RATIO}


def usual_masses(upper_arm: float) -> tuple[float, float]:
    """Lowest and highest body mass [kg] that occurs with an upper arm of this length [m]: MOST_DEVIATIONS from the mean
    of ln(mass).
    """
    mean = REFERENCE_MASS * (upper_arm / REFERENCE_LENGTH) ** MASS_EXPONENT
    factor = float(np.exp(MOST_DEVIATIONS * MASS_DEVIATION))
    return mean / factor, mean * factor


def upper_arm_length(model: Model) -> float:
    """Distance [m] from the centre of the shoulder to that of the elbow. ModelError where there is no such pair."""
    humerus = model.body_index("humerus")
    shoulder = [joint for joint in model.joints if joint.child == humerus]
    elbow = [joint for joint in model.joints if joint.parent == humerus]
    if not (shoulder and elbow):
        raise ModelError(
            f"the humerus of {model.name} should have a joint at either end and has not", SolverCode.UNKNOWN_NAME
        )
    ends = shoulder[0].frame_in_child.translation, elbow[0].frame_in_parent.translation
    return float(np.linalg.norm(ends[0] - ends[1]))


def set_arm_masses(model: Model, body_mass: float) -> Model:
    """The model with the arm of a person of body_mass [kg]: segment masses of de Leva (1996), shared by the bodies of a
    segment as before; mass centres and radii of gyration stay.
    """
    ratios: dict[str, float] = {}
    for name, mass in segment_masses(model).items():
        segment = ARM_SEGMENTS[name]
        ratios |= dict.fromkeys(segment.bodies, segment.mass_fraction * body_mass / mass)
    return with_mass_ratios(model, ratios)


def hold_load(model: Model, mass: float) -> Model:
    """The model with a point mass [kg], the body `held_load`, welded to the hand at the hand's mass centre.

    Raises ModelError for a model without a hand, or one that holds a load already.
    """
    if any(body.name == LOAD for body in model.bodies):
        raise ModelError(
            f"the model {model.name} holds a load already; remove the body {LOAD}", SolverCode.LOAD_PRESENT
        )
    hand = model.body_index(HAND)
    load = Body(LOAD, mass, np.zeros(3), np.zeros((3, 3)))
    still = AxisMotion(np.vstack([np.eye(3), np.eye(3)]), np.full(6, NO_COORDINATE), (polynomial([0.0]),) * 6)
    grip = Placement(np.eye(3), model.bodies[hand].mass_center)
    joint = Joint(f"{LOAD}_joint", hand, len(model.bodies), grip, Placement(np.eye(3), np.zeros(3)), still)
    return replace(model, bodies=(*model.bodies, load), joints=(*model.joints, joint))


@dataclass(frozen=True)
class TendonChange:
    """A tendon whose slack length changed by `change` [m]; before: shortest and longest normalised fibre length."""

    muscle: str
    change: float
    before: tuple[float, float]


def fit_tendons(model: Model, motions: Sequence[Array]) -> tuple[Model, tuple[TendonChange, ...]]:
    """The model with such tendons. motions: postures (frames, coordinates) of the person's own lifts.

    A fibre that goes through more than the whole range is centred in it. A muscle whose path jumps is left as it is,
    because the length on one side of the jump is wrong.
    """
    ranges = [muscle_ranges(model, coordinates) for coordinates in motions]
    shortest = np.min([found.shortest for found in ranges], axis=0)
    longest = np.max([found.longest for found in ranges], axis=0)
    jumps = np.max([found.jump for found in ranges], axis=0) > LARGEST_JUMP
    muscles, changes = [], []
    for muscle, low, high, is_torn in zip(model.muscles, shortest, longest, jumps, strict=True):
        wanted = 0.0 if is_torn else _slack_change(muscle, float(low), float(high))
        change = max(wanted, -muscle.tendon_slack_length)
        if change:
            muscles.append(replace(muscle, tendon_slack_length=muscle.tendon_slack_length + change))
            changes.append(TendonChange(muscle.name, change, (float(low), float(high))))
        else:
            muscles.append(muscle)
    return replace(model, muscles=tuple(muscles)), tuple(changes)


def _slack_change(muscle: Muscle, low: float, high: float) -> float:
    """Change of the slack length [m] that moves a fibre's range, low to high, into FIBRE_RANGE; 0 if it is there."""
    lowest, highest = FIBRE_RANGE
    if low >= lowest and high <= highest:
        return 0.0
    if high - low > highest - lowest:
        middle = 0.5 * (lowest + highest - low - high)
        return _along(muscle, low) - _along(muscle, low + middle)
    if low < lowest:
        return _along(muscle, low) - _along(muscle, lowest)
    return _along(muscle, high) - _along(muscle, highest)


def _along(muscle: Muscle, fibre: float) -> float:
    """Part of the path that a fibre of this normalised length takes, along the tendon [m]."""
    height = np.sin(muscle.pennation_at_optimal)
    return muscle.optimal_fiber_length * float(np.sqrt(max(fibre**2 - height**2, 0.0)))
