"""Markers and constraints of given postures, with their derivatives by the coordinates, one marker at a time.

The kernel of inverse kinematics sums over markers: it returns Σ_m w_m J_mᵀ (p_m − x_m). With w = 1 on one marker alone
and x = p − e_a, that sum is row a of the marker's Jacobian, so the kernel serves here without another one beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.solve import TrackingTasks, allocate_workspace, build_problem
from solver.model import Model

Array = NDArray[np.float64]


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
    points, _, gap, rows = _evaluate(model, tasks, coordinates, None)
    frames, markers, count = *points.shape[:2], coordinates.shape[1]
    entries = 3 * markers
    seen = np.repeat(points, entries, axis=0).reshape(frames, markers, 3, markers, 3)
    weights = np.zeros((frames, markers, 3, markers))
    for m in range(markers):
        weights[:, m, :, m] = 1.0
        for axis in range(3):
            seen[:, m, axis, m, axis] -= 1.0
    _, gradient, _, _ = _evaluate(
        model,
        tasks,
        np.repeat(coordinates, entries, axis=0),
        (seen.reshape(-1, markers, 3), weights.reshape(-1, markers)),
    )
    return LinearisedPostures(points, gradient.reshape(frames, markers, 3, count), gap, rows)


def evaluate_points(model: Model, tasks: TrackingTasks, coordinates: Array) -> tuple[Array, Array]:
    """points (frames, markers, 3) in ground [m], and gap (frames, rows) of the constraints."""
    points, _, gap, _ = _evaluate(model, tasks, coordinates, None)
    return points, gap


def _evaluate(
    model: Model, tasks: TrackingTasks, coordinates: Array, weighted: tuple[Array, Array] | None
) -> tuple[Array, Array, Array, Array]:
    """points, Σ w Jᵀ (p − x), gap and rows; weighted: x (frames, markers, 3) and w (frames, markers)."""
    from solver.inverse_kinematics.information import fill_information  # the compiler takes a while to import

    frames, count, markers = *coordinates.shape, len(tasks.markers)
    problem = build_problem(model, tasks)
    work = allocate_workspace(model, problem)
    number = len(work.system.gap)
    seen, weights = weighted or (np.zeros((frames, markers, 3)), np.zeros((frames, markers)))
    results = (
        np.zeros((frames, count, count)),
        np.zeros((frames, count)),
        np.zeros((frames, markers, 3)),
        np.zeros((frames, number)),
        np.zeros((frames, number, count)),
    )
    at = np.ascontiguousarray(coordinates)
    fill_information(problem, np.ascontiguousarray(seen), np.ascontiguousarray(weights), at, work, results)
    _, gradient, points, gap, rows = results
    return points, gradient, gap, rows
