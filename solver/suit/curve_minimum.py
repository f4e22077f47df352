"""Where a cost curve over the rest length is lowest, and how far one may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

KEPT_REDUCTION = 0.9  # of the best one, within the permissible error of the rest length
NOWHERE = np.nan


@dataclass(frozen=True)
class CurveMinimum:
    """The best rest length [m], the normalised cost there, and the full width [m] in which 90 % of the saving is kept.

    All NaN where the best of the lengths tried is the first or the last; the width also where it goes beyond them.
    """

    rest_length: float
    cost: float
    width: float


def find_minimum(rest_lengths: Array, cost: Array) -> CurveMinimum:
    """The lowest point of a cubic spline through the cost (rest lengths,) at the lengths tried (rest lengths,) [m]."""
    from scipy.interpolate import CubicSpline  # slow to import, and needed only here

    best = int(np.argmin(cost))
    if np.isnan(cost).any() or best in {0, len(cost) - 1}:
        return CurveMinimum(NOWHERE, NOWHERE, NOWHERE)
    spline = CubicSpline(rest_lengths, cost)
    flat = spline.derivative().roots(extrapolate=False)
    length = float(flat[np.argmin(spline(flat))])
    lowest = float(spline(length))
    edges = spline.solve(1 - KEPT_REDUCTION * (1 - lowest), extrapolate=False)
    before, after = edges[edges < length], edges[edges > length]
    is_kept = before.size and after.size and lowest < 1
    return CurveMinimum(length, lowest, float(after.min() - before.max()) if is_kept else NOWHERE)
