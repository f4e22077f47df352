"""Frame after frame of many scenarios, each from its neighbour's solution; compiled.

Newton's method from the multipliers of the frame before nearly always arrives. Where it does not, an interior point
finds its way and Newton's method finishes, so that a solution never shows where it came from.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.sharing.interior_point import VIOLATION_LIMIT, interior_point
from solver.sharing.newton import NEWTON_GOAL, conditions, newton

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

SOLVED, INFEASIBLE, NOT_CONVERGED, BEYOND_RATE = 0, 1, 2, 3
"""What became of a problem. BEYOND_RATE: solved without the bounds that the frame before sets, infeasible in them."""

EFFORT_SHARE = 1e-6  # of effort against violation, where a problem is infeasible


@compiled_for_python
def solve_in_turn(
    q: Array,
    M: Array,
    R: Array,
    t: Array,
    equalities: int,
    rise: Array,
    fall: Array,
    reach: Array,
    guess: Array,
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
    nothing, everything = np.zeros(len(q)), np.ones(len(q))
    for scenario in range(t.shape[0]):
        (lower, upper), v0 = reach[scenario], guess[scenario]
        for frame in range(t.shape[1]):
            rows, own, target = M[frame], R[frame], t[scenario, frame]
            a1, v1 = a[scenario, frame], v[scenario, frame]
            v1[:] = v0
            code = _solve(q, rows, own, target, equalities, lower, upper, a1, v1)
            if code == INFEASIBLE:
                code = _solve(q, rows, own, target, equalities, nothing, everything, a1, v1)
                code = BEYOND_RATE if code == SOLVED else code
            if code == INFEASIBLE:
                _violate_least(q, rows, own, target, equalities, nothing, everything, a1, v1)
            codes[scenario, frame] = code
            if code in (SOLVED, BEYOND_RATE):
                _reach(rise, fall, a1, lower, upper)
                v0[:] = v1
            else:
                lower[:], upper[:] = 0.0, 1.0


@compiled
def _solve(
    q: Array, M: Array, R: Array, t: Array, equalities: int, lower: Array, upper: Array, a: Array, v: Array
) -> int:
    """One problem, v being a guess. The code rests on the errors of a and v as they are returned."""
    if newton(q, M, R, t, equalities, lower, upper, a, v) <= NEWTON_GOAL:
        return SOLVED
    if not interior_point(q, M, R, t, equalities, lower, upper, v):
        return INFEASIBLE
    found = v.copy()
    left = newton(q, M, R, t, equalities, lower, upper, a, v)
    if not left <= VIOLATION_LIMIT:
        v[:] = found
        left, _ = conditions(q, M, R, t, equalities, lower, upper, v, a, np.empty(len(q)), np.empty(len(t)))
    return SOLVED if left <= VIOLATION_LIMIT else NOT_CONVERGED


@compiled
def _violate_least(
    q: Array, M: Array, R: Array, t: Array, equalities: int, lower: Array, upper: Array, a: Array, v: Array
) -> None:
    """The cone may be left along its axis: one more eliminated unknown in R, of weight 1 against the effort's share. If
    that is not enough, or there is no cone, the equalities may be missed as well.
    """
    cheap, loose = EFFORT_SHARE * q, R / EFFORT_SHARE
    code = INFEASIBLE
    if equalities < len(t):
        loose[equalities, equalities] += 0.5
        code = _solve(cheap, M, loose, t, equalities, lower, upper, a, v)
    if code == INFEASIBLE:
        for i in range(equalities):
            loose[i, i] += 0.5
        _solve(cheap, M, loose, t, equalities, lower, upper, a, v)
    v /= EFFORT_SHARE


@compiled
def _reach(rise: Array, fall: Array, a: Array, lower: Array, upper: Array) -> None:
    """What activations can become in one interval at no or full excitation."""
    for i in range(len(a)):
        pace = 0.5 + 1.5 * a[i]
        lower[i] = max(a[i] - fall[i] * a[i] * pace, 0.0)
        upper[i] = min(a[i] + rise[i] * (1.0 - a[i]) / pace, 1.0)
