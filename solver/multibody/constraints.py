"""Constraints of a model besides its joints: G u̇ + b = 0, and their position errors, which should be zero.

Rows follow the order of Model.constraints: those between two bodies as below, and one for a coordinate
that is locked or prescribed or follows others. Equations: Simbody's PrescribedMotion and CoordinateCoupler. The model
is not assembled: b is that of OpenSim also if the error is not zero.

Between two bodies, as in Simbody:

    point     three rows in the axes of the nearest body that carries both (Constraint::Ball)
    weld      three cosines between axes of the two frames that should be perpendicular, then as a point (Weld)
    distance  one row along the line from the first to the second point (Rod)
    line      two rows, perpendicular to the line, in the axes of its body (PointOnLine)

Where a point of one body is held, both bodies are taken at the second point, which matters if the gap is not closed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.constraint import (
    BodyConstraint,
    ConstantDistanceConstraint,
    CoordinateCoupler,
    CoordinateLock,
    CoordinatePrescription,
    PointOnLineConstraint,
    WeldConstraint,
)
from solver.model import Array, Model
from solver.multibody.body_tables import pack_bodies
from solver.multibody.postures import (
    Postures,
    cross,
    point_acceleration,
    points_in_ground,
    rates_of_coordinates,
    rotate,
    wrench_about_origin,
)


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


def body_rows(model: Model, state: Postures, constraint: BodyConstraint) -> tuple[Array, Array]:
    """G (frames, rows, coordinates) and b (frames, rows) of one constraint."""
    if isinstance(constraint, ConstantDistanceConstraint):
        return _distance_row(model, state, constraint)
    if isinstance(constraint, PointOnLineConstraint):
        across = _across(constraint.direction)
        rows, bias = _rows_at_point(model, state, constraint, constraint.body_1)
        return across @ rows, bias @ across.T
    rows, bias = _rows_at_point(model, state, constraint, _common_ancestor(model, constraint))
    if not isinstance(constraint, WeldConstraint):
        return rows, bias
    turning, change = _turning_rows(model, state, constraint)
    return np.concatenate([turning, rows], axis=1), np.concatenate([change, bias], axis=1)


def body_gaps(model: Model, state: Postures, constraint: BodyConstraint) -> Array:
    """(frames, rows) position errors of one constraint: from the first place to the second."""
    first = points_in_ground(state, constraint.body_1, constraint.location_1)
    gap = points_in_ground(state, constraint.body_2, constraint.location_2) - first
    if isinstance(constraint, ConstantDistanceConstraint):
        length: Array = np.linalg.norm(gap, axis=1, keepdims=True)
        return length - constraint.distance
    if isinstance(constraint, PointOnLineConstraint):
        return rotate(_to_body(state, constraint.body_1), gap) @ _across(constraint.direction).T
    gap = rotate(_to_body(state, _common_ancestor(model, constraint)), gap)
    if not isinstance(constraint, WeldConstraint):
        return gap
    one, two = _axes(state, constraint)
    return np.concatenate([(one * two).sum(axis=2), gap], axis=1)


def body_wrenches(model: Model, state: Postures, constraint: BodyConstraint) -> Array:
    """(frames, rows, 6) moment about the ground origin and force whose power is a row's rate, on the second body, and
    the opposite on the first. A multiplier λ loads the bodies with −λ times these.
    """
    point = points_in_ground(state, constraint.body_2, constraint.location_2)
    if isinstance(constraint, ConstantDistanceConstraint):
        line = point - points_in_ground(state, constraint.body_1, constraint.location_1)
        directions = (line / np.linalg.norm(line, axis=1, keepdims=True))[:, None]
    elif isinstance(constraint, PointOnLineConstraint):
        directions = _across(constraint.direction) @ _to_body(state, constraint.body_1)
    else:
        directions = _to_body(state, _common_ancestor(model, constraint))
    wrenches = wrench_about_origin(point[:, None], directions)
    if not isinstance(constraint, WeldConstraint):
        return wrenches
    first, second = _axes(state, constraint)
    normal = cross(second, first)
    return np.concatenate([np.concatenate([normal, np.zeros_like(normal)], axis=-1), wrenches], axis=1)


def _rows_at_point(model: Model, state: Postures, constraint: BodyConstraint, observer: int) -> tuple[Array, Array]:
    """Velocity of the second point relative to the first body, and its change, in the axes of the observing body."""
    one, two = constraint.body_1, constraint.body_2
    point = points_in_ground(state, two, constraint.location_2)
    to_observer = _to_body(state, observer)
    moves = pack_bodies(model).moves
    relative = state.screws * (moves[two] - moves[one])[:, None]
    velocity_1, acceleration_1 = _at_point(state, one, point)
    velocity_2, acceleration_2 = _at_point(state, two, point)
    coriolis = 2.0 * cross(state.angular_velocity[:, observer], velocity_2 - velocity_1)
    rows = to_observer @ np.swapaxes(_columns(relative, point), 1, 2)
    return rows, rotate(to_observer, acceleration_2 - acceleration_1 - coriolis)


def _turning_rows(model: Model, state: Postures, weld: WeldConstraint) -> tuple[Array, Array]:
    """d/dt of the cosines a₂·a₁ of axes that turn with the bodies: (w₂ − w₁)·(a₂ × a₁), and its change."""
    one, two = weld.body_1, weld.body_2
    first, second = _axes(state, weld)
    normal = cross(second, first)
    moves = pack_bodies(model).moves
    relative = state.screws[..., :3] * (moves[two] - moves[one])[:, None]
    turning_1, turning_2 = (state.angular_velocity[:, body][:, None] for body in (one, two))
    change = cross(cross(turning_2, second), first) - cross(cross(turning_1, first), second)
    bias = state.bias_acceleration[:, two, :3] - state.bias_acceleration[:, one, :3]
    return normal @ np.swapaxes(relative, 1, 2), rotate(normal, bias) + ((turning_2 - turning_1) * change).sum(axis=2)


def _distance_row(model: Model, state: Postures, rod: ConstantDistanceConstraint) -> tuple[Array, Array]:
    first = points_in_ground(state, rod.body_1, rod.location_1)
    second = points_in_ground(state, rod.body_2, rod.location_2)
    length = np.linalg.norm(second - first, axis=1, keepdims=True)
    along = (second - first) / length
    moves = pack_bodies(model).moves
    columns = _columns(state.screws * moves[rod.body_2][:, None], second)
    columns -= _columns(state.screws * moves[rod.body_1][:, None], first)
    velocity_1, acceleration_1 = _at_point(state, rod.body_1, first)
    velocity_2, acceleration_2 = _at_point(state, rod.body_2, second)
    velocity = velocity_2 - velocity_1
    lengthening = (velocity * along).sum(axis=1, keepdims=True)
    turning = ((velocity**2).sum(axis=1, keepdims=True) - lengthening**2) / length
    bias = ((acceleration_2 - acceleration_1) * along).sum(axis=1, keepdims=True) + turning
    return along[:, None] @ np.swapaxes(columns, 1, 2), bias


def _columns(screws: Array, point: Array) -> Array:
    """(frames, coordinates, 3) velocity of the material point at `point` (frames, 3) per unit of each speed."""
    return np.asarray(screws[..., 3:] + cross(screws[..., :3], point[:, None]))


def _at_point(state: Postures, body: int, point: Array) -> tuple[Array, Array]:
    """Velocity and bias acceleration (frames, 3) of the material point of a body that is just at `point` in ground."""
    angular, change = state.angular_velocity[:, body], state.bias_acceleration[:, body]
    velocity = state.origin_velocity[:, body] + cross(angular, point - state.origin_in_ground[:, body])
    return velocity, point_acceleration(change[:, :3], change[:, 3:], angular, velocity, point)


def _to_body(state: Postures, body: int) -> Array:
    """(frames, 3, 3) turns ground vectors into those of a body."""
    return np.swapaxes(state.rotation_to_ground[:, body], 1, 2)


def _axes(state: Postures, weld: WeldConstraint) -> tuple[Array, Array]:
    """Axes y, z, x of the first frame and x, y, z of the second (frames, 3 axes, 3), in ground."""
    first = state.rotation_to_ground[:, weld.body_1] @ weld.rotation_1
    second = state.rotation_to_ground[:, weld.body_2] @ weld.rotation_2
    return np.swapaxes(first[..., [1, 2, 0]], 1, 2), np.swapaxes(second, 1, 2)


def _across(direction: Array) -> Array:
    """(2, 3) the two unit vectors perpendicular to a line that Simbody takes."""
    first = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def _common_ancestor(model: Model, constraint: BodyConstraint) -> int:
    """The nearest body that carries both bodies of a constraint."""
    parents = {joint.child: joint.parent for joint in model.joints}
    lineage = [constraint.body_1]
    while lineage[-1] in parents:
        lineage.append(parents[lineage[-1]])
    body = constraint.body_2
    while body not in lineage:
        body = parents[body]
    return body
