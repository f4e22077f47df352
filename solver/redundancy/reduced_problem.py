"""The reduced redundancy problem, its outcome codes and its solutions, as the compiled solver reads and fills them.

    minimise  1/p Σ q aᵖ + ½ v·R v   subject to   M a + R v − t = (0, s),   lower ≤ a ≤ upper,   s and λ in the cone

with the exponent p, 2 or 3. n activations a, m rows and their multipliers v = (y, λ). The first `equalities` rows are
equalities; the last three are the cone's, if there is a cone. R stands for the unbounded unknowns that reduction.py
eliminated: v·R v / 2 is their effort.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

SOLVED, INFEASIBLE, NOT_CONVERGED, BEYOND_RATE = 0, 1, 2, 3
"""Outcome codes. BEYOND_RATE: infeasible within the activation-rate bounds, solved without them."""
VIOLATION_LIMIT = 1e-8
"""Largest error of the optimality conditions of a SOLVED problem."""


class FrameProblem(NamedTuple):
    """The problem of one frame: q (n,), M (m, n), R (m, m), t (m,), lower and upper (n,), exponent p."""

    q: Array
    M: Array
    R: Array
    t: Array
    equalities: int
    lower: Array
    upper: Array
    exponent: int


class SequenceProblem(NamedTuple):
    """The problems of all frames and scenarios, which share q, M, R and the exponent and differ in t.

    q (n,), M (frames, m, n), R (frames, m, m), t (scenarios, frames, m)
    rise, fall  (n,) interval between frames over the time constants of activation and deactivation; infinite where the
                unknown may take any value within its bounds in every frame
    widest      (2, n) least and greatest a in any frame
    """

    q: Array
    M: Array
    R: Array
    t: Array
    equalities: int
    rise: Array
    fall: Array
    widest: Array
    exponent: int


class WarmStart(NamedTuple):
    """Where the next frame starts: bounds (scenarios, 2, n) lower and upper, multipliers (scenarios, m) as a guess."""

    bounds: Array
    multipliers: Array


class SequenceSolution(NamedTuple):
    """a (scenarios, frames, n), v (scenarios, frames, m) and outcome codes (scenarios, frames)."""

    a: Array
    v: Array
    codes: Codes
