"""Coordinates of a motion that contradict the model: against a coupler, lock or prescription, or far out of range.

Neither is an error: OpenSim's tools take such a motion as it is. Notes name the coordinates, the greatest value first.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from solver.model import Model
from solver.motion import Kinematics
from solver.motion_splines import held_by_constraints
from solver.multibody.constraints import is_held

Array = NDArray[np.float64]

ANGLE_TOLERANCE = np.radians(1.0)
"""Of data against a coupler, lock or prescription: above what rounding and a filter change, below what matters."""
DISTANCE_TOLERANCE = 5e-3  # m
FULL_TURN = 2 * np.pi
UNITS = {"rotation": "rad", "translation": "m", "coupled": "rad or m"}


def motion_checks(model: Model, kinematics: Kinematics) -> dict[str, str]:
    """Notes violates_constraint and beyond_range, each "coordinate value unit, …"; none where nothing is found.

    A coordinate violates its constraint by the largest difference from what the constraint gives. An angle is beyond
    its range [rad] if it is more than a full turn outside, as degrees that were read as radians are.
    """
    held = is_held(model)
    expected = held_by_constraints(model, kinematics).positions
    differences = np.abs(kinematics.positions - expected).max(axis=0)
    is_distance = np.array([coordinate.motion == "translation" for coordinate in model.coordinates])
    tolerance = np.where(is_distance, DISTANCE_TOLERANCE, ANGLE_TOLERANCE)
    notes = {
        "violates_constraint": _listed(model, differences, held & (differences > tolerance)),
        "beyond_range": _beyond_range(model, kinematics.positions, ~held),
    }
    return {name: note for name, note in notes.items() if note}


def describe_motion_checks(notes: Mapping[str, str]) -> list[str]:
    """A sentence for each of the notes of motion_checks."""
    sentences = []
    if "violates_constraint" in notes:
        sentences.append(
            "Coordinates whose data differ from what their coupler, lock or prescription gives, with the largest "
            f"difference: {notes['violates_constraint']}. Leave their columns out of the motion, and the constraint "
            "gives their values."
        )
    if "beyond_range" in notes:
        sentences.append(
            f"Angles more than a full turn outside their range: {notes['beyond_range']}. If the file of the motion is "
            "in degrees, its header should have inDegrees=yes."
        )
    return sentences


def _beyond_range(model: Model, positions: Array, is_free: NDArray[np.bool_]) -> str:
    is_angle = np.array([coordinate.motion == "rotation" for coordinate in model.coordinates])
    low, high = np.array([coordinate.range for coordinate in model.coordinates]).T
    least, greatest = positions.min(axis=0), positions.max(axis=0)
    below, above = low - least, greatest - high
    is_outside = np.maximum(below, above) > FULL_TURN
    return _listed(model, np.where(below > above, least, greatest), is_free & is_angle & is_outside)


def _listed(model: Model, values: Array, is_listed: NDArray[np.bool_]) -> str:
    found = sorted(np.flatnonzero(is_listed), key=lambda index: -abs(values[index]))
    return ", ".join(
        f"{model.coordinate_names[index]} {values[index]:.3g} {UNITS[model.coordinates[index].motion]}"
        for index in found
    )
