"""Normal equations of a body's parameters with the postures eliminated; estimate.py has the equations.

Derivatives by the coordinates come from the kernel of inverse kinematics, which differentiates the gap of every point
constraint: of a marker that is joined to the origin of ground, the gap is the place and its derivatives the Jacobian.

At fixed postures, places and gaps are linear in the scale factors: the rotations of the bodies do not depend on them,
and each translation between two frames grows with one factor. So the derivative by ln(factor) is the factor times the
change when the factor of the generic body is doubled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.gauss_newton import Problem
from solver.inverse_kinematics.solve import TrackingTasks, allocate_workspace, build_problem, linearise_frames
from solver.model import GROUND, Array, Model
from solver.multibody.postures import postures

Body = Callable[[Array], tuple[Model, TrackingTasks]]

DAMPING = 1e-9  # of the markers' weights, m²/rad²; holds what no marker sees
REGULARISATION = 1e-13  # of rows of the constraints that depend on each other
NO_TASKS = TrackingTasks((), np.zeros(0))


class Share(NamedTuple):
    """Frames of a trial that count, and the weight of each."""

    frames: NDArray[np.int64]
    weight: float


def normal_equations(
    body: Body, parameters: Array, observed: Array, coordinates: Array, frame_weights: Array, factors: int
) -> tuple[Array, Array]:
    """Matrix (parameters, parameters) and gradient (parameters,) of frames of any number of trials.

    body makes skeleton and tasks of parameters; observed (frames, markers, 3) [m]; coordinates (frames, coordinates)
    the optimum of inverse kinematics; frame_weights (frames,). Parameters are `factors` logarithms of scale factors,
    offsets, and the targets of the coordinate tasks in their order.
    """
    skeleton, tasks = body(parameters)
    found = linearise_postures(skeleton, tasks, coordinates)
    is_seen = np.asarray(np.isfinite(observed).all(axis=2))
    weights = np.where(is_seen, tasks.weights, 0.0)
    root = np.sqrt(weights)[..., None]
    residual = root * np.where(is_seen[..., None], found.points - np.nan_to_num(observed), 0.0)
    frames, count = coordinates.shape
    pulls, away = _pulls(skeleton, tasks, coordinates)
    stiffness = pulls * weights.sum(axis=1)[:, None]  # inverse kinematics divides by the weights that are seen
    points, gaps = parameter_derivatives(body, parameters, coordinates, factors)
    points = (root[..., None] * points).reshape(frames, -1, len(parameters))
    jacobian = (root[..., None] * found.jacobian).reshape(frames, -1, count)
    targets = _target_derivatives(skeleton, tasks, len(parameters))
    forces = np.swapaxes(jacobian, 1, 2) @ points - stiffness[..., None] * targets
    bounds = build_problem(skeleton, tasks).bounds
    # A coordinate that is locked, or clamped at an end of its range, does not move.
    is_held = bounds.is_locked | (coordinates <= bounds.lowest) | (coordinates >= bounds.highest)
    moved = _posture_derivatives(is_held, found, jacobian, forces, gaps, stiffness)
    share = np.sqrt(frame_weights)[:, None]
    reduced, pulled = share[..., None] * (points + jacobian @ moved), moved - targets
    stiffness *= share**2
    rows = np.concatenate([reduced, np.sqrt(stiffness)[..., None] * pulled], axis=1).reshape(-1, len(parameters))
    left = np.concatenate([share * residual.reshape(frames, -1), np.sqrt(stiffness) * away], axis=1).ravel()
    return rows.T @ rows, rows.T @ left


def parameter_derivatives(body: Body, parameters: Array, coordinates: Array, factors: int) -> tuple[Array, Array]:
    """Of points (frames, markers, 3, parameters) and gaps (frames, rows, parameters) at fixed postures: by the factors
    from bodies of double size, by the offsets as rotations of the bodies.
    """
    skeleton, tasks = body(parameters)
    rotation = postures(skeleton, coordinates, np.zeros_like(coordinates)).rotation_to_ground
    frames, markers = len(coordinates), len(tasks.markers)
    points = np.zeros((frames, markers, 3, len(parameters)))
    for m, marker in enumerate(tasks.markers):
        first = factors + 3 * m
        points[:, m, :, first : first + 3] = rotation[:, marker.body]
    generic, *doubled = (
        linearise_frames(problem, allocate_workspace(skeleton, problem), coordinates)
        for problem in _generic_and_doubled(body, len(parameters), factors)
    )
    gaps = np.zeros((*generic.gap.shape, len(parameters)))
    for k, found in enumerate(doubled):
        points[..., k] = np.exp(parameters[k]) * (found.points - generic.points)
        gaps[..., k] = np.exp(parameters[k]) * (found.gap - generic.gap)
    return points, gaps


@lru_cache(maxsize=1)  # of all steps of an iteration
def _generic_and_doubled(body: Body, parameters: int, factors: int) -> tuple[Problem, ...]:
    """Problem of the generic body, and of those with one of its factors doubled."""
    return tuple(build_problem(*body(logarithms)) for logarithms in np.log(2.0) * np.eye(factors + 1, parameters, -1))


def _pulls(skeleton: Model, tasks: TrackingTasks, coordinates: Array) -> tuple[Array, Array]:
    """Weights (coordinates,) of the coordinates' own tasks, and how far they are from their targets."""
    pulls, targets = np.zeros(coordinates.shape[1]), np.zeros(coordinates.shape[1])
    for name, weight in tasks.coordinate_weights.items():
        index = skeleton.coordinate_index(name)
        pulls[index], targets[index] = weight, float(np.asarray(tasks.coordinate_targets[name]))
    return pulls, coordinates - targets


def _target_derivatives(skeleton: Model, tasks: TrackingTasks, parameters: int) -> Array:
    """(coordinates, parameters) of the targets, which are the last parameters."""
    derivatives = np.zeros((len(skeleton.coordinates), parameters))
    first = parameters - len(tasks.coordinate_targets)
    for place, name in enumerate(tasks.coordinate_targets):
        derivatives[skeleton.coordinate_index(name), first + place] = 1.0
    return derivatives


def _posture_derivatives(
    is_held: NDArray[np.bool_], found: LinearisedPostures, jacobian: Array, forces: Array, gaps: Array, stiffness: Array
) -> Array:
    """dq/dθ (frames, coordinates, parameters) at the optimum of inverse kinematics, to Gauss–Newton's order; forces
    (frames, coordinates, parameters) are the derivatives of its gradient by θ.
    """
    frames, rows, count = found.rows.shape
    free = (~is_held).astype(np.float64)
    jacobian, constraint = jacobian * free[:, None], found.rows * free[:, None]
    matrix = np.zeros((frames, count + rows, count + rows))
    matrix[:, :count, :count] = np.swapaxes(jacobian, 1, 2) @ jacobian
    scale = np.trace(matrix, axis1=1, axis2=2)
    diagonal = np.arange(count)
    matrix[:, diagonal, diagonal] += stiffness + DAMPING * scale[:, None] + (1.0 - free) * scale[:, None]
    matrix[:, :count, count:] = np.swapaxes(constraint, 1, 2)
    matrix[:, count:, :count] = constraint
    along = count + np.arange(rows)
    matrix[:, along, along] = -REGULARISATION
    known = np.concatenate([free[..., None] * forces, gaps], axis=1)
    solved: Array = -np.linalg.solve(matrix, known)
    return solved[:, :count] * free[..., None]


@dataclass(frozen=True, eq=False)
class LinearisedPostures:
    """points (frames, markers, 3) in ground [m];  jacobian (frames, markers, 3, coordinates) per rate of a coordinate;
    gap (frames, rows) of the constraints;  rows (frames, rows, coordinates) its derivatives.
    """

    points: Array
    jacobian: Array
    gap: Array
    rows: Array


def linearise_postures(model: Model, tasks: TrackingTasks, coordinates: Array) -> LinearisedPostures:
    """At postures (frames, coordinates) [rad or m]."""
    problem = build_problem(model, NO_TASKS)
    (frames, count), entries, joined = coordinates.shape, 3 * len(tasks.markers), problem.constraints
    bodies = [*((marker.body, GROUND) for marker in tasks.markers), *joined.body]
    places = [*((marker.location, np.zeros(3)) for marker in tasks.markers), *joined.location]
    joined = joined._replace(
        body=np.array(bodies, dtype=np.int64).reshape(-1, 2), location=np.array(places).reshape(-1, 2, 3)
    )
    problem = problem._replace(constraints=joined)
    found = linearise_frames(problem, allocate_workspace(model, problem), coordinates)
    return LinearisedPostures(
        found.gap[:, :entries].reshape(frames, -1, 3),
        found.rows[:, :entries].reshape(frames, -1, 3, count),
        found.gap[:, entries:],
        found.rows[:, entries:],
    )


def linearise_constraints(model: Model, coordinates: Array) -> tuple[Array, Array]:
    """gap (frames, rows) of the constraints, and rows (frames, rows, coordinates) its derivatives."""
    problem = build_problem(model, NO_TASKS)
    found = linearise_frames(problem, allocate_workspace(model, problem), coordinates)
    return found.gap, found.rows
