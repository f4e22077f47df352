"""Constraints of a model besides its joints: G u̇ + b = 0, and their position errors, which should be zero.

Rows follow the order of Model.constraints: those between two bodies as in body_constraints.py, and one for a coordinate
that is locked or prescribed or follows others. Equations: Simbody's PrescribedMotion and CoordinateCoupler. The model
is not assembled: b is that of OpenSim also if the error is not zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.constraint import CoordinateCoupler, CoordinateLock, CoordinatePrescription
from solver.model import Model
from solver.multibody.body_constraints import body_gaps, body_rows, body_wrenches
from solver.multibody.postures import Postures, rates_of_coordinates
from solver.multibody.rotations import rotate

Array = NDArray[np.float64]


def is_held(model: Model) -> NDArray[np.bool_]:
    """(coordinates,) whether a lock, a prescription or a coupler determines the coordinate."""
    held = np.zeros(len(model.coordinates), dtype=bool)
    for constraint in model.constraints:
        if isinstance(constraint, CoordinateLock | CoordinatePrescription):
            held[constraint.coordinate] = True
        elif isinstance(constraint, CoordinateCoupler):
            held[constraint.dependent] = True
    return held


def constraint_rows(model: Model, state: Postures) -> tuple[Array, Array]:
    """G (frames, rows, coordinates) and b (frames, rows)."""
    frames, count = state.coordinates.shape
    rows, biases = [np.zeros((frames, 0, count))], [np.zeros((frames, 0))]
    for constraint in model.constraints:
        if isinstance(constraint, CoordinateLock | CoordinatePrescription | CoordinateCoupler):
            row, bias = _coordinate_row(model, state, constraint)
        else:
            row, bias = body_rows(model, state, constraint)
        rows.append(row)
        biases.append(bias)
    return np.concatenate(rows, axis=1), np.concatenate(biases, axis=1)


def constraint_gaps(model: Model, state: Postures) -> Array:
    """(frames, rows) position errors of the constraints [m or rad]; of axes that should be perpendicular: cosines."""
    gaps = [np.zeros((len(state.coordinates), 0))]
    for constraint in model.constraints:
        if isinstance(constraint, CoordinateLock):
            gaps.append(state.coordinates[:, [constraint.coordinate]] - constraint.value)
        elif isinstance(constraint, CoordinatePrescription):
            prescribed, _, _ = constraint.function.derivatives(state.time)
            gaps.append((state.coordinates[:, constraint.coordinate] - prescribed)[:, None])
        elif isinstance(constraint, CoordinateCoupler):
            gap = -state.coordinates[:, constraint.dependent]
            for independent, function in zip(constraint.independents, constraint.functions, strict=True):
                gap += function.derivatives(state.coordinates[:, independent])[0]
            gaps.append(gap[:, None])
        else:
            gaps.append(body_gaps(model, state, constraint))
    return np.concatenate(gaps, axis=1)


def constraint_wrenches(model: Model, state: Postures) -> Array:
    """(frames, rows, bodies, 6) moment about the ground origin and force on each body of what a row holds, in ground.

    A multiplier λ loads the bodies with −λ times these; a row of coordinates loads no body. Rows as in constraint_rows.
    """
    rows = [np.zeros((len(state.coordinates), 0, len(model.bodies), 6))]
    for constraint in model.constraints:
        if isinstance(constraint, CoordinateLock | CoordinatePrescription | CoordinateCoupler):
            held = np.zeros((len(state.coordinates), 1, len(model.bodies), 6))
        else:
            wrenches = body_wrenches(model, state, constraint)
            held = np.zeros((*wrenches.shape[:2], len(model.bodies), 6))
            held[:, :, constraint.body_2] += wrenches
            held[:, :, constraint.body_1] -= wrenches
        rows.append(held)
    return np.concatenate(rows, axis=1)


def _coordinate_row(
    model: Model, state: Postures, constraint: CoordinateLock | CoordinatePrescription | CoordinateCoupler
) -> tuple[Array, Array]:
    """Second derivative of the position error, g·q̈ + the rest at q̈ = 0, in terms of u̇."""
    gradient, remainder = np.zeros_like(state.coordinates), np.zeros(len(state.coordinates))
    to_rates, drift = rates_of_coordinates(model, state)
    if isinstance(constraint, CoordinateLock | CoordinatePrescription):
        gradient[:, constraint.coordinate] = 1.0
        if isinstance(constraint, CoordinatePrescription):
            _, _, curvature = constraint.function.derivatives(state.time)
            remainder -= curvature
    else:
        rates = rotate(to_rates, state.speeds)
        gradient[:, constraint.dependent] = -1.0
        for independent, function in zip(constraint.independents, constraint.functions, strict=True):
            _, slope, curvature = function.derivatives(state.coordinates[:, independent])
            gradient[:, independent] += slope
            remainder += curvature * rates[:, independent] ** 2
    row = np.einsum("fi,fij->fj", gradient, to_rates)
    return row[:, None], (remainder + (gradient * drift).sum(axis=1))[:, None]
