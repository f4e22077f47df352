"""Newton's method on the optimality conditions of the problem of one frame (reduced_problem.py), from a guess of v.

Stationarity makes a a function of v alone, a = Mᵀ v / q clamped to its bounds. What remains are the equalities, and
λ = projection of λ − s onto the cone: equations with kinks, for which Newton's method still converges fast (semismooth;
Qi & Sun, Math. Program. 58, 1993). From the previous frame's v it needs two or three steps and ends at round-off; from
a distant v it may diverge.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled
from solver.dense import columns_times, copy, divide, factor, inner_product, rows_times_rows
from solver.redundancy.cone import Ray, project, project_rows
from solver.redundancy.effort import activation, activation_per_slope
from solver.redundancy.reduced_problem import FrameProblem
from solver.redundancy.workspace import NewtonWorkspace

Array = NDArray[np.float64]

NEWTON_GOAL = 1e-11  # norm of the errors at which it stops
MOST_STEPS = 12
SHORTEST_STEP = 0.05  # of step halving


@compiled
def newton(problem: FrameProblem, work: NewtonWorkspace, a: Array, v: Array) -> float:
    """Improve v and fill a; returns the norm of the remaining errors, infinite if a step cannot be computed."""
    (matrix, order), free_inverse, error, previous, change = work
    size, ray = optimality_errors(problem, a, v, free_inverse, error)
    for _ in range(MOST_STEPS):
        if size <= NEWTON_GOAL:
            break
        rows_times_rows(problem.M, free_inverse, problem.R, matrix)
        if problem.equalities < len(problem.t):
            project_rows(matrix, problem.equalities, ray)
        if not factor(matrix, order):
            return np.inf
        divide(matrix, order, error)
        copy(error, change)
        copy(v, previous)
        length, before = 1.0, size
        while True:
            for i in range(len(v)):
                v[i] = previous[i] - length * change[i]
            size, ray = optimality_errors(problem, a, v, free_inverse, error)
            if size < before or length < SHORTEST_STEP:
                break
            length *= 0.5
    return size


@compiled
def optimality_errors(
    problem: FrameProblem, a: Array, v: Array, free_inverse: Array, error: Array
) -> tuple[float, Ray]:
    """Fill a from v, error with the errors of the rows and free_inverse with 1/q where a is between its bounds, else 0;
    returns the norm of the errors, and λ − s.

    The error of an equality is its residual, that of the cone λ − projection of (λ − s).
    """
    q, M, R, t, p, lower, upper, exponent = problem
    columns_times(M, v, a)
    for i in range(len(q)):
        free = activation(q[i], a[i], exponent)
        a[i] = min(max(free, lower[i]), upper[i])
        free_inverse[i] = activation_per_slope(q[i], a[i], exponent) if a[i] == free else 0.0
    for i in range(len(t)):
        error[i] = inner_product(M[i], a) + inner_product(R[i], v) - t[i]
    ray = (0.0, 0.0, 0.0)
    if p < len(t):
        ray = (v[p] - error[p], v[p + 1] - error[p + 1], v[p + 2] - error[p + 2])
        near = project(ray)
        for i in range(3):
            error[p + i] = v[p + i] - near[i]
    return sqrt(inner_product(error, error)), ray
