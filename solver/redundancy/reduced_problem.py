"""The reduced redundancy problem of a frame, its outcome codes and solutions, as the compiled solver reads them.

    minimise  1/p Σ q aᵖ + ½ v·R v   subject to   M a + R v − t = (0, s),   lower ≤ a ≤ upper,   s and λ in the cone

with the exponent p, 2 or 3. n activations a, m rows and their multipliers v = (y, λ). The first `equalities` rows are
equalities; the last three are the cone's, if there is a cone. R stands for the unbounded unknowns that reduction.py
eliminated: v·R v / 2 is their effort.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.int8]
Number = TypeVar("Number", float, Array)

SOLVED, INFEASIBLE, NOT_CONVERGED, BEYOND_RATE = 0, 1, 2, 3
"""Outcome codes. BEYOND_RATE: infeasible within the activation-rate bounds, solved without them."""
VIOLATION_LIMIT = 1e-8
"""Largest error of the optimality conditions of a SOLVED problem."""


def reachable(a: Number, rise: Number, fall: Number) -> tuple[Number, Number]:
    """Activations that one interval at no and at full excitation leads to from a (Thelen 2003).

    NaN where infinity is multiplied by zero; this and infinity are no limits.
    """
    pace = 0.5 + 1.5 * a
    return a - fall * a * pace, a + rise * (1.0 - a) / pace


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


class ActivationRates(NamedTuple):
    """How activations may change from one frame to the next, as compiled code reads it.

    rise, fall  (n,) interval between frames over the time constants of activation and deactivation; infinite where the
                unknown may take any value within its bounds in every frame
    widest      (2, n) least and greatest a in any frame
    """

    rise: Array
    fall: Array
    widest: Array


class WarmStart(NamedTuple):
    """Where the next frame starts: bounds (scenarios, 2, n) lower and upper, multipliers (scenarios, m) as a guess."""

    bounds: Array
    multipliers: Array


class SequenceSolution(NamedTuple):
    """a (scenarios, frames, n), v (scenarios, frames, m) and outcome codes (scenarios, frames)."""

    a: Array
    v: Array
    codes: Codes
