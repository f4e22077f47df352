"""Masses of a person's arm, and a load in the hand as a body of its own.

A generic model has the masses of another person, sometimes with the load of a trial inside its hand. Scaling by volume
would scale the load as well, and a scaled thorax would take mass off the arm where the whole model's mass is given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from solver.errors import SolverCode
from solver.functions.coordinate import polynomial
from solver.model import NO_COORDINATE, AxisMotion, Body, Joint, Model, ModelError, Placement
from solver.personalisation.anthropometry import ARM_SEGMENTS

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
    return replace(model, bodies=tuple(_times(body, ratios.get(body.name, 1.0)) for body in model.bodies))


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


def _times(body: Body, ratio: float) -> Body:
    return Body(body.name, ratio * body.mass, body.mass_center, ratio * body.inertia)
