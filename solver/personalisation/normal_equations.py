"""Normal equations of a body's parameters with the postures eliminated; estimate.py has the equations.

Derivatives by the coordinates come from the kernel of inverse kinematics. The kernel of inverse kinematics sums over
markers: it returns Σ_m w_m J_mᵀ (p_m − x_m). With w = 1 on one marker alone and x = p − e_a, that sum is row a of the
marker's Jacobian, so the kernel serves here without another one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.linearise import LinearisedFrames
from solver.inverse_kinematics.solve import TrackingTasks, allocate_workspace, build_problem, linearise_frames
from solver.model import Array, Model
from solver.multibody.postures import postures

Body = Callable[[Array], tuple[Model, TrackingTasks]]

DIFFERENCE = 1e-5  # of ln(factor)
DAMPING = 1e-9  # of the markers' weights, m²/rad²; holds what no marker sees
REGULARISATION = 1e-13  # of rows of the constraints that depend on each other


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
    matrix = np.einsum("fia,fib->ab", reduced, reduced, optimize=True)
    matrix += np.einsum("fka,fk,fkb->ab", pulled, stiffness, pulled, optimize=True)
    gradient = np.einsum("fia,fi->a", reduced, share * residual.reshape(frames, -1))
    gradient += np.einsum("fka,fk->a", pulled, stiffness * away)
    return matrix, gradient


def parameter_derivatives(body: Body, parameters: Array, coordinates: Array, factors: int) -> tuple[Array, Array]:
    """Of points (frames, markers, 3, parameters) and gaps (frames, rows, parameters) at fixed postures: by the factors
    as central differences, by the offsets as rotations of the bodies.
    """
    skeleton, tasks = body(parameters)
    rotation = postures(skeleton, coordinates, np.zeros_like(coordinates)).rotation_to_ground
    frames, markers = len(coordinates), len(tasks.markers)
    points = np.zeros((frames, markers, 3, len(parameters)))
    for m, marker in enumerate(tasks.markers):
        first = factors + 3 * m
        points[:, m, :, first : first + 3] = rotation[:, marker.body]
    gaps = np.zeros((frames, evaluate_points(skeleton, tasks, coordinates)[1].shape[1], len(parameters)))
    for k in range(factors):
        step = DIFFERENCE * (np.arange(len(parameters)) == k)
        above, below = (evaluate_points(*body(parameters + side), coordinates) for side in (step, -step))
        points[..., k] = (above[0] - below[0]) / (2.0 * DIFFERENCE)
        gaps[..., k] = (above[1] - below[1]) / (2.0 * DIFFERENCE)
    return points, gaps


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
    _, _, points, gap, rows = _evaluate(model, tasks, coordinates)
    frames, markers, count = *points.shape[:2], coordinates.shape[1]
    entries = 3 * markers
    seen = np.repeat(points, entries, axis=0).reshape(frames, markers, 3, markers, 3)
    weights = np.zeros((frames, markers, 3, markers))
    for m in range(markers):
        weights[:, m, :, m] = 1.0
        for axis in range(3):
            seen[:, m, axis, m, axis] -= 1.0
    gradient = _evaluate(
        model,
        tasks,
        np.repeat(coordinates, entries, axis=0),
        (seen.reshape(-1, markers, 3), weights.reshape(-1, markers)),
    ).gradient
    return LinearisedPostures(points, gradient.reshape(frames, markers, 3, count), gap, rows)


def linearise_constraints(model: Model, coordinates: Array) -> tuple[Array, Array]:
    """gap (frames, rows) of the constraints, and rows (frames, rows, coordinates) its derivatives."""
    found = _evaluate(model, TrackingTasks((), np.zeros(0)), coordinates)
    return found.gap, found.rows


def evaluate_points(model: Model, tasks: TrackingTasks, coordinates: Array) -> tuple[Array, Array]:
    """points (frames, markers, 3) in ground [m], and gap (frames, rows) of the constraints."""
    found = _evaluate(model, tasks, coordinates)
    return found.points, found.gap


def _evaluate(
    model: Model, tasks: TrackingTasks, coordinates: Array, weighted: tuple[Array, Array] | None = None
) -> LinearisedFrames:
    """Points, gap and rows; with x (frames, markers, 3) and w (frames, markers) also Σ w Jᵀ (p − x)."""
    problem = build_problem(model, tasks)
    return linearise_frames(problem, allocate_workspace(model, problem), coordinates, weighted)
