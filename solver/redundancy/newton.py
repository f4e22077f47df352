"""Newton's method on the conditions of optimality of one small problem, from a guess of its multipliers.

    minimise  ½ Σ q a² + ½ v·R v   subject to   M a + R v − t = (0, s),   lower ≤ a ≤ upper,   s and λ in the cone

v = (y, λ) are the multipliers of the equality rows and, where there is a cone, of its three rows, the last ones. R
stands for unbounded unknowns that reduction.py eliminated; v·R v / 2 is their effort. Stationarity makes a function of
v alone, a = Mᵀ v / q kept within its bounds. What remains are the equalities, and λ = projection of λ − s onto the
cone: equations with kinks, for which Newton's method still converges fast (semismooth; Qi & Sun, Math. Program. 58,
1993). From a neighbour's v it needs two or three steps and ends at rounding errors; from afar it may go astray.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled
from solver.dense import columns_times, copy, divide, dot, factor, rows_times_rows
from solver.redundancy.cone import Ray, project, project_rows
from solver.redundancy.workspace import FrameWorkspace

Array = NDArray[np.float64]

NEWTON_GOAL = 1e-11
MOST_STEPS = 12
SHORTEST_STEP = 0.05


@compiled
def newton(
    q: Array,
    M: Array,
    R: Array,
    t: Array,
    equalities: int,
    lower: Array,
    upper: Array,
    work: FrameWorkspace,
    a: Array,
    v: Array,
) -> float:
    """Improve v; returns the size of what is left of the errors (infinite if it went astray), and a with it."""
    loose, error, old, change, matrix = work.loose, work.error, work.old, work.change, work.matrix
    size, ray = conditions(q, M, R, t, equalities, lower, upper, v, a, loose, error)
    for _ in range(MOST_STEPS):
        if size <= NEWTON_GOAL:
            break
        rows_times_rows(M, loose, R, work.weighted, matrix)
        if equalities < len(t):
            project_rows(matrix, equalities, ray)
        if not factor(matrix, work.order):
            return np.inf
        divide(matrix, work.order, error)
        copy(error, change)
        copy(v, old)
        length, before = 1.0, size
        while True:
            for i in range(len(v)):
                v[i] = old[i] - length * change[i]
            size, ray = conditions(q, M, R, t, equalities, lower, upper, v, a, loose, error)
            if size < before or length < SHORTEST_STEP:
                break
            length *= 0.5
    return size


@compiled
def conditions(
    q: Array,
    M: Array,
    R: Array,
    t: Array,
    equalities: int,
    lower: Array,
    upper: Array,
    v: Array,
    a: Array,
    loose: Array,
    error: Array,
) -> tuple[float, Ray]:
    """Fill a of v, loose (1/q where a is within its bounds, else 0) and the rows' errors; gives their size, and λ − s.

    An equality's error is its gap, the cone's λ − projection of (λ − s).
    """
    columns_times(M, v, a)
    for i in range(len(q)):
        free = a[i] / q[i]
        a[i] = min(max(free, lower[i]), upper[i])
        loose[i] = 1.0 / q[i] if a[i] == free else 0.0
    for i in range(len(t)):
        error[i] = dot(M[i], a) + dot(R[i], v) - t[i]
    ray = (0.0, 0.0, 0.0)
    if equalities < len(t):
        p = equalities
        ray = (v[p] - error[p], v[p + 1] - error[p + 1], v[p + 2] - error[p + 2])
        near = project(ray)
        for i in range(3):
            error[p + i] = v[p + i] - near[i]
    return sqrt(dot(error, error)), ray
