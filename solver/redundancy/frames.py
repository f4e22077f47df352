"""Frame after frame of many scenarios, each from its neighbour's solution; compiled.

Newton's method from the multipliers of the frame before nearly always arrives. Where it does not, an interior point
converges and Newton's method finishes, so that a solution does not depend on the starting point.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.dense import copy
from solver.redundancy.interior_point import INFEASIBLE, NOT_CONVERGED, SOLVED, VIOLATION_LIMIT, interior_point
from solver.redundancy.newton import NEWTON_GOAL, conditions, newton
from solver.redundancy.workspace import FrameWorkspace

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

BEYOND_RATE = 3
"""Outcome beside those of the interior point: infeasible within the bounds of the frame before, solved without them."""

EFFORT_SHARE = 1e-6  # of effort against violation, where a problem is infeasible


@compiled_for_python
def solve_frames(
    q: Array,
    M: Array,
    R: Array,
    t: Array,
    equalities: int,
    rise: Array,
    fall: Array,
    reach: Array,
    guess: Array,
    work: FrameWorkspace,
    a: Array,
    v: Array,
    codes: Codes,
) -> None:
    """The problem of newton.py in each frame; q (n,), M (frames, m, n) and R (frames, m, m) are common to all
    scenarios, t (scenarios, frames, m) is not. The first `equalities` rows are no cone's.

    a in [0, 1] changes no faster than activation dynamics let it: rise and fall (n,) are the interval over the time
    constants. reach (scenarios, 2, n), the next frame's bounds, and guess (scenarios, m), its multipliers, are read
    and left behind. Fills a (scenarios, frames, n), v (scenarios, frames, m) and codes (scenarios, frames); where
    INFEASIBLE, a violates rows by as little as possible.
    """
    for scenario in range(t.shape[0]):
        (lower, upper), v0 = reach[scenario], guess[scenario]
        for frame in range(t.shape[1]):
            a1, v1 = a[scenario, frame], v[scenario, frame]
            copy(v0, v1)
            code = _solve_frame(q, M[frame], R[frame], t[scenario, frame], equalities, lower, upper, work, a1, v1)
            codes[scenario, frame] = code
            if code in (SOLVED, BEYOND_RATE):
                _reach(rise, fall, a1, lower, upper)
                copy(v1, v0)
            else:
                _widen(lower, upper)


@compiled
def _solve_frame(
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
) -> int:
    """Within the bounds, else within 0 and 1, which then stay in lower and upper, else missing rows by little."""
    for attempt in range(2):
        if attempt:
            _widen(lower, upper)
        code = _solve(q, M, R, t, equalities, lower, upper, work, a, v)
        if code != INFEASIBLE:
            return BEYOND_RATE if attempt and code == SOLVED else code
    _miss_by_little(q, M, R, t, equalities, lower, upper, work, a, v)
    return INFEASIBLE


@compiled
def _miss_by_little(
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
) -> None:
    """Leave the cone along its axis as little as possible; if there is none, or leaving it is not enough, miss
    equalities as well.

    What is missed is one more eliminated unknown of a row, in R, of weight 1 against the effort's share.
    """
    cost, own, code = work.cost, work.own, INFEASIBLE
    for i in range(len(q)):
        cost[i] = EFFORT_SHARE * q[i]
    for i in range(len(t)):
        for j in range(len(t)):
            own[i, j] = R[i, j] / EFFORT_SHARE
    if equalities < len(t):
        own[equalities, equalities] += 0.5
        code = _solve(cost, M, own, t, equalities, lower, upper, work, a, v)
    if code == INFEASIBLE:
        for i in range(equalities):
            own[i, i] += 0.5
        _solve(cost, M, own, t, equalities, lower, upper, work, a, v)
    for i in range(len(v)):
        v[i] /= EFFORT_SHARE


@compiled
def _solve(
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
) -> int:
    """One problem, v being a guess. The code rests on the errors of a and v as they are returned."""
    for is_near in (False, True):
        left = newton(q, M, R, t, equalities, lower, upper, work, a, v)
        if left <= (VIOLATION_LIMIT if is_near else NEWTON_GOAL):
            return SOLVED
        if not is_near:
            if interior_point(q, M, R, t, equalities, lower, upper, work, v) == INFEASIBLE:
                return INFEASIBLE
            copy(v, work.found)
    copy(work.found, v)
    left, _ = conditions(q, M, R, t, equalities, lower, upper, v, a, work.loose, work.error)
    return SOLVED if left <= VIOLATION_LIMIT else NOT_CONVERGED


@compiled
def _widen(lower: Array, upper: Array) -> None:
    for i in range(len(lower)):
        lower[i], upper[i] = 0.0, 1.0


@compiled
def _reach(rise: Array, fall: Array, a: Array, lower: Array, upper: Array) -> None:
    """What activations can become in one interval at no or full excitation."""
    for i in range(len(a)):
        pace = 0.5 + 1.5 * a[i]
        lower[i] = max(a[i] - fall[i] * a[i] * pace, 0.0)
        upper[i] = min(a[i] + rise[i] * (1.0 - a[i]) / pace, 1.0)
