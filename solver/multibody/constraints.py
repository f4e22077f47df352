"""Constraints of a model besides its joints: G u̇ + b = 0, and their position errors, which should be zero.

Rows follow the order of Model.constraints: three for a point that is held on another, in the axes of the nearest body
that carries both, and one for a coordinate that is locked or follows another. Equations: Simbody's Constraint::Ball,
PrescribedMotion and CoordinateCoupler. The model is not assembled: b is that of OpenSim also if the error is not zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.model import CoordinateCoupler, CoordinateLock, Model, PointConstraint
from solver.multibody.postures import Postures, point_acceleration, points_in_ground, rates_of_coordinates
from solver.multibody.rotations import cross, rotate
from solver.multibody.tables import tables_of

Array = NDArray[np.float64]


def constraint_rows(model: Model, state: Postures) -> tuple[Array, Array]:
    """G (frames, rows, coordinates) and b (frames, rows)."""
    frames, count = state.coordinates.shape
    rows, biases = [np.zeros((frames, 0, count))], [np.zeros((frames, 0))]
    for constraint in model.constraints:
        if isinstance(constraint, PointConstraint):
            row, bias = _point_rows(model, state, constraint)
        else:
            row, bias = _coordinate_row(model, state, constraint)
        rows.append(row)
        biases.append(bias)
    return np.concatenate(rows, axis=1), np.concatenate(biases, axis=1)


def constraint_gaps(model: Model, state: Postures) -> Array:
    """(frames, rows) position errors of the constraints [m or rad]; for points: from the first to the second."""
    gaps = [np.zeros((len(state.coordinates), 0))]
    for constraint in model.constraints:
        if isinstance(constraint, PointConstraint):
            first = points_in_ground(state, constraint.body_1, constraint.location_1)
            second = points_in_ground(state, constraint.body_2, constraint.location_2)
            gaps.append(rotate(_to_ancestor(model, state, constraint), second - first))
        elif isinstance(constraint, CoordinateLock):
            gaps.append(state.coordinates[:, [constraint.coordinate]] - constraint.value)
        else:
            wanted, _, _ = constraint.function.derivatives(state.coordinates[:, constraint.independent])
            gaps.append((wanted - state.coordinates[:, constraint.dependent])[:, None])
    return np.concatenate(gaps, axis=1)


def _coordinate_row(
    model: Model, state: Postures, constraint: CoordinateLock | CoordinateCoupler
) -> tuple[Array, Array]:
    """Second derivative of the position error, g·q̈ + the rest at q̈ = 0, in terms of u̇."""
    gradient, remainder = np.zeros_like(state.coordinates), np.zeros(len(state.coordinates))
    to_rates, drift = rates_of_coordinates(model, state)
    if isinstance(constraint, CoordinateLock):
        gradient[:, constraint.coordinate] = 1.0
    else:
        leader = constraint.independent
        _, slope, curvature = constraint.function.derivatives(state.coordinates[:, leader])
        gradient[:, leader], gradient[:, constraint.dependent] = slope, -1.0
        remainder = curvature * rotate(to_rates, state.speeds)[:, leader] ** 2
    row = np.einsum("fi,fij->fj", gradient, to_rates)
    return row[:, None], (remainder + (gradient * drift).sum(axis=1))[:, None]


def _point_rows(model: Model, state: Postures, constraint: PointConstraint) -> tuple[Array, Array]:
    """As in Simbody, both bodies are taken at the second point, which matters where the gap is not closed."""
    one, two = constraint.body_1, constraint.body_2
    point = points_in_ground(state, two, constraint.location_2)
    to_ancestor = _to_ancestor(model, state, constraint)
    moves = tables_of(model).moves
    relative = state.screws * (moves[two] - moves[one])[:, None]
    velocity_1, acceleration_1 = _at_point(state, one, point)
    velocity_2, acceleration_2 = _at_point(state, two, point)
    turning = state.angular_velocity[:, _common_ancestor(model, constraint)]
    coriolis = 2.0 * cross(turning, velocity_2 - velocity_1)
    columns = relative[..., 3:] + cross(relative[..., :3], point[:, None])
    rows = to_ancestor @ np.swapaxes(columns, 1, 2)
    return rows, rotate(to_ancestor, acceleration_2 - acceleration_1 - coriolis)


def _at_point(state: Postures, body: int, point: Array) -> tuple[Array, Array]:
    """Velocity and bias acceleration (frames, 3) of the material point of a body that is just at `point` in ground."""
    angular, change = state.angular_velocity[:, body], state.bias_acceleration[:, body]
    velocity = state.origin_velocity[:, body] + cross(angular, point - state.origin_in_ground[:, body])
    return velocity, point_acceleration(change[:, :3], change[:, 3:], angular, velocity, point)


def _to_ancestor(model: Model, state: Postures, constraint: PointConstraint) -> Array:
    """(frames, 3, 3) turns ground vectors into those of the nearest body that carries both of a constraint's bodies."""
    return np.swapaxes(state.rotation_to_ground[:, _common_ancestor(model, constraint)], 1, 2)


def _common_ancestor(model: Model, constraint: PointConstraint) -> int:
    parents = {joint.child: joint.parent for joint in model.joints}
    lineage = [constraint.body_1]
    while lineage[-1] in parents:
        lineage.append(parents[lineage[-1]])
    body = constraint.body_2
    while body not in lineage:
        body = parents[body]
    return body
