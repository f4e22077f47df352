"""Checks of a motion and its loads.

Coordinates without data, steps that are uneven, a filter with a low cut-off, coordinates against a coupler, lock or
prescription or far out of range, and loads that are off. None is an error: OpenSim's tools take such a motion as it
is. Notes name the coordinates, the greatest value first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver.model import Model
from solver.motion import Kinematics
from solver.motion_splines import held_by_constraints
from solver.multibody.constraints import is_held
from solver.multibody.external_loads import ExternalForce
from station.messages.codes import AssessmentCode
from station.messages.message import Message

Array = NDArray[np.float64]

ANGLE_TOLERANCE = np.radians(1.0)
"""Of data against a coupler, lock or prescription: above what rounding and a filter change, below what matters."""
DISTANCE_TOLERANCE = 5e-3  # m
FULL_TURN = 2 * np.pi
RANGES_OUTSIDE, LEAST_OUTSIDE, MOST_OUTSIDE = 10.0, 1.0, 100.0
"""A translation is beyond its range by more than 10 times its width, but at least 1 m and at most 100 m, so that a
sprint along a track is not. Ranges without a limit, ±99999.9 in OpenSim's files, count as ±100 m."""
LEAST_CUTOFF = 4.0
"""Cut-off in mean frequencies of the angles. Walking, of about 1.2 Hz, is filtered at 6 Hz (Winter, Biomechanics and
Motor Control of Human Movement), the arm lifts of the published study, of 0.2 to 0.5 Hz, at 3 Hz."""
FINDINGS = {
    "without_data": (AssessmentCode.WITHOUT_DATA, "coordinates"),
    "resampled_from_s": (AssessmentCode.RESAMPLED, "steps"),
    "low_cutoff": (AssessmentCode.LOW_CUTOFF, "frequencies"),
    "violates_constraint": (AssessmentCode.VIOLATES_CONSTRAINT, "coordinates"),
    "beyond_range": (AssessmentCode.BEYOND_RANGE, "coordinates"),
    "translation_beyond_range": (AssessmentCode.TRANSLATION_BEYOND_RANGE, "coordinates"),
    "no_load_applied": (AssessmentCode.NO_LOAD_APPLIED, "file"),
}
"""Code of the finding of a note, and the figure that the note is in its sentence."""
UNITS = {"rotation": "rad", "translation": "m", "coupled": "rad or m"}


def motion_checks(model: Model, kinematics: Kinematics) -> dict[str, str]:
    """Notes by name, those of FINDINGS: steps, frequencies, or "coordinate value unit, …"; none without findings.

    A coordinate violates its constraint by the largest difference from what the constraint gives. An angle is beyond
    its range [rad] if it is more than a full turn outside, as degrees that were read as radians are; a translation [m]
    if it is as far outside as millimetres that were read as metres are.
    """
    held = is_held(model)
    expected = held_by_constraints(model, kinematics).positions
    differences = np.abs(kinematics.positions - expected).max(axis=0)
    is_distance = np.array([coordinate.motion == "translation" for coordinate in model.coordinates])
    tolerance = np.where(is_distance, DISTANCE_TOLERANCE, ANGLE_TOLERANCE)
    steps = kinematics.steps
    notes = {
        "without_data": ", ".join(kinematics.missing),
        "resampled_from_s": "" if steps is None else f"{steps[0]:.6g} to {steps[1]:.6g}",
        "low_cutoff": _low_cutoff(model, kinematics),
        "violates_constraint": _listed(model, differences, held & (differences > tolerance)),
        "beyond_range": _beyond_range(model, kinematics.positions, ~held & ~is_distance),
        "translation_beyond_range": _beyond_range(model, kinematics.positions, ~held & is_distance),
    }
    return {name: note for name, note in notes.items() if note}


def load_checks(path: Path | None, loads: Sequence[ExternalForce]) -> dict[str, str]:
    """Note no_load_applied, the name of the file, if a file of external loads was given and applies none."""
    return {} if path is None or loads else {"no_load_applied": path.name}


def motion_findings(notes: Mapping[str, str]) -> list[Message[AssessmentCode]]:
    """A finding for each of the notes of motion_checks and load_checks."""
    return [Message(code, {figure: notes[name]}) for name, (code, figure) in FINDINGS.items() if name in notes]


def _low_cutoff(model: Model, kinematics: Kinematics) -> str:
    """Cut-off and mean frequency where the filter removes a part of the motion; "" for less than one period.

    The mean frequency is the RMS of the speeds of all rotations over that of their angles about the mean, after the
    filter: noise does not raise it. A part of a period has no frequency: of a ramp it would be any.
    """
    is_angle = np.array([coordinate.motion == "rotation" for coordinate in model.coordinates])
    angles, speeds = kinematics.positions[:, is_angle], kinematics.speeds[:, is_angle]
    amplitude = np.sqrt(((angles - angles.mean(axis=0)) ** 2).sum())
    if kinematics.cutoff is None or not amplitude:
        return ""
    frequency = float(np.sqrt((speeds**2).sum()) / amplitude / (2 * np.pi))
    has_period = frequency * (kinematics.time[-1] - kinematics.time[0]) >= 1
    is_low = has_period and kinematics.cutoff < LEAST_CUTOFF * frequency
    return f"cut-off {kinematics.cutoff:g} Hz, mean frequency of the angles {frequency:.2g} Hz" if is_low else ""


def _beyond_range(model: Model, positions: Array, is_checked: NDArray[np.bool_]) -> str:
    """Of rotations and translations; a coordinate that mixes them has no unit, and so no limit."""
    kinds = np.array([coordinate.motion for coordinate in model.coordinates])
    low, high = np.array([coordinate.range for coordinate in model.coordinates]).T
    is_distance = kinds == "translation"
    low, high = (np.where(is_distance, limit.clip(-MOST_OUTSIDE, MOST_OUTSIDE), limit) for limit in (low, high))
    farthest = np.clip(RANGES_OUTSIDE * (high - low), LEAST_OUTSIDE, MOST_OUTSIDE)
    tolerance = np.where(is_distance, farthest, FULL_TURN)
    least, greatest = positions.min(axis=0), positions.max(axis=0)
    below, above = low - least, greatest - high
    is_outside = (np.maximum(below, above) > tolerance) & (kinds != "coupled")
    return _listed(model, np.where(below > above, least, greatest), is_checked & is_outside)


def _listed(model: Model, values: Array, is_listed: NDArray[np.bool_]) -> str:
    found = sorted(np.flatnonzero(is_listed), key=lambda index: -abs(values[index]))
    return ", ".join(
        f"{model.coordinate_names[index]} {values[index]:.3g} {UNITS[model.coordinates[index].motion]}"
        for index in found
    )
