"""Checks of a person's body: masses, sizes, marker places, postures."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from recordings.standard_gravity import g
from solver.inverse_kinematics.solve import InverseKinematics
from solver.model import CoordinateLock, Model
from solver.personalisation.anthropometry import ARM_SEGMENTS
from solver.personalisation.estimate import BodyEstimate, EstimateOutcome
from solver.personalisation.segment_masses import (
    HAND,
    UPPER_ARM,
    TendonChange,
    mass_ratios,
    segment_masses,
    upper_arm_length,
    usual_masses,
)
from solver.scaling_findings import ScalingFinding, largest_motion
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.kinematics.marker_checks import Finding
from station.messages.kinematics_messages import PersonCode
from station.messages.message import Figures, Message

Array = NDArray[np.float64]

MOST_DEVIATIONS = 3.5
"""Of a marker's offset, over the three axes together, before it is a finding."""
BEYOND_RANGE = np.radians(20.0)
MOST_BODY_WEIGHTS = 5.0
"""Of the force in the joint. Instrumented shoulders measured up to 2 (docs/validation.md), and models have shown up to
2.1 times the measured peak (docs/motion.md).
"""
SWAYING, MOVING = 0.02, 0.10
"""m, that a marker goes in a static pose: more than postural sway; and no pose."""


class PersonError(StationError):
    """No body is made of what was given."""


class WrongTrials(PersonError):
    """The command names files that are not the trials of one person."""

    exit_code = WRONG_USAGE


def refuse(code: StrEnum, **figures: float | str) -> PersonError:
    return PersonError(Message(code, figures))


def scaling_finding(finding: ScalingFinding) -> Finding:
    figures: Figures = {"muscle": finding.muscle, "figure": finding.figure, "surface": finding.surface}
    return Message(finding.code, {**figures, "jump_mm": 1e3 * finding.figure})


def tendon_finding(change: TendonChange) -> Finding:
    shortest, longest = change.before
    figures: Figures = {
        "muscle": change.muscle,
        "change_mm": 1e3 * change.change,
        "shortest": shortest,
        "longest": longest,
    }
    return Message(PersonCode.TENDON_CHANGED, figures)


def lock_findings(model: Model) -> list[Finding]:
    locks = [c.coordinate for c in model.constraints if isinstance(c, CoordinateLock)]
    names = ", ".join(model.coordinate_names[lock] for lock in locks)
    return [Message(PersonCode.LOCKS_REMOVED, {"coordinates": names})] if locks else []


def mass_findings(model: Model) -> list[Finding]:
    """Segments of a model whose mass is unusual beside that of its upper arm."""
    codes = {HAND: PersonCode.HAND_MASS}
    return [
        Message(codes.get(segment, PersonCode.SEGMENT_MASS), {"segment": segment, "ratio": ratio})
        for segment, ratio in mass_ratios(model).items()
    ]


def ensure_model_mass_fits(model: Model, total: float) -> None:
    """Raises PersonError where a model of a given total mass [kg] has an upper arm as no person of its length."""
    masses = segment_masses(model)
    if UPPER_ARM not in masses:
        return
    fraction = ARM_SEGMENTS[UPPER_ARM].mass_fraction
    lowest, highest = (fraction * mass for mass in usual_masses(upper_arm_length(model)))
    if not lowest <= masses[UPPER_ARM] <= highest:
        figures = {"mass_kg": total, "segment_kg": masses[UPPER_ARM], "lowest_kg": lowest, "highest_kg": highest}
        raise refuse(PersonCode.MODEL_MASS_DOES_NOT_FIT, **figures)


def pose_findings(labels: Sequence[str], observed: Array) -> list[Finding]:
    """Of a static pose (frames, labels, 3) [m]. Raises PersonError where the person moves."""
    label, moved = largest_motion(labels, observed)
    figures: Figures = {"marker": label, "range_mm": 1e3 * moved, "highest_mm": 1e3 * MOVING}
    if moved > MOVING:
        raise PersonError(Message(PersonCode.POSE_MOVES, figures))
    return [Message(PersonCode.POSE_SWAYS, figures)] if moved > SWAYING else []


def ensure_mass_fits(body_mass: float, upper_arm: float) -> None:
    """Raises PersonError for a body mass [kg] that does not occur with an upper arm of this length [m]."""
    lowest, highest = usual_masses(upper_arm)
    if not lowest <= body_mass <= highest:
        figures = {"mass_kg": body_mass, "upper_arm_m": upper_arm, "lowest_kg": lowest, "highest_kg": highest}
        raise refuse(PersonCode.MASS_DOES_NOT_FIT, **figures)


def joint_force_findings(trial: str, force: Array, body_mass: float) -> list[Finding]:
    """Of the joint force (frames,) [N] of a trial, empty where it was not evaluated; body_mass in kg."""
    weights = float(np.nanmax(force, initial=0.0)) / (g * body_mass)
    if weights <= MOST_BODY_WEIGHTS:
        return []
    figures: Figures = {"trial": trial, "percent": 100 * weights, "highest_percent": 100 * MOST_BODY_WEIGHTS}
    return [Message(PersonCode.LARGE_JOINT_FORCE, figures)]


def estimate_findings(estimate: BodyEstimate, trials: Sequence[str]) -> list[Finding]:
    """Convergence, frames, markers far from their places, and postures."""
    found: list[Finding] = []
    if estimate.outcome is not EstimateOutcome.CONVERGED:
        found.append(Message(PersonCode.NOT_CONVERGED, {"steps": estimate.steps}))
    for trial, solution in zip(trials, estimate.postures, strict=True):
        found += _posture_findings(estimate.model, trial, solution)
    deviations = np.linalg.norm(estimate.offsets / estimate.priors.errors.offset[:, None], axis=1)
    for marker, offset, deviation in zip(estimate.tasks.markers, estimate.offsets, deviations, strict=True):
        if deviation > MOST_DEVIATIONS:
            far = 1e3 * float(np.linalg.norm(offset))
            found.append(
                Message(
                    PersonCode.MARKER_FAR_OFF,
                    {"marker": marker.name, "offset_mm": far, "deviations": float(deviation)},
                )
            )
    return found


def _posture_findings(model: Model, trial: str, solution: InverseKinematics) -> list[Finding]:
    found: list[Finding] = []
    if solution.unsolved:
        figures: dict[str, float | str] = {"trial": trial, "frames": solution.unsolved, "all": len(solution.outcomes)}
        found.append(Message(PersonCode.UNSOLVED_FRAMES, figures))
    with np.errstate(invalid="ignore"):
        medians = np.nanmedian(solution.coordinates, axis=0)
    for coordinate, value in zip(model.coordinates, medians, strict=True):
        lowest, highest = coordinate.range
        is_angle = coordinate.motion == "rotation"
        if is_angle and not lowest - BEYOND_RANGE <= value <= highest + BEYOND_RANGE:
            figures = {"trial": trial, "coordinate": coordinate.name, "value_deg": float(np.degrees(value))}
            figures |= {"lowest_deg": float(np.degrees(lowest)), "highest_deg": float(np.degrees(highest))}
            found.append(Message(PersonCode.COORDINATE_OUT_OF_RANGE, figures))
    return found
