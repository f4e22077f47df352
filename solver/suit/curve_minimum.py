"""Minimum of a cost curve over the rest length, and its permissible error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

KEPT_REDUCTION = 0.9  # of the best one, within the permissible error of the rest length
NOWHERE = np.nan


@dataclass(frozen=True)
class CurveMinimum:
    """The best rest length [m], the normalised cost there, and the full width [m] in which 90 % of the saving is kept.

    All NaN where the best of the lengths tried is the first or the last; the width also where it goes beyond them.
    edge is −1 where it is the first, 1 where it is the last, 0 otherwise.
    """

    rest_length: float
    cost: float
    width: float
    edge: int = 0


def find_minimum(rest_lengths: Array, cost: Array) -> CurveMinimum:
    """The lowest point of a cubic spline through the cost (rest lengths,) at the lengths tried (rest lengths,) [m]."""
    edge = edge_of_minimum(cost)
    if edge or np.isnan(cost).any():
        return CurveMinimum(NOWHERE, NOWHERE, NOWHERE, edge)
    spline = scipy.interpolate.CubicSpline(rest_lengths, cost)
    flat = spline.derivative().roots(extrapolate=False)
    length = float(flat[np.argmin(spline(flat))])
    lowest = float(spline(length))
    edges = spline.solve(1 - KEPT_REDUCTION * (1 - lowest), extrapolate=False)
    before, after = edges[edges < length], edges[edges > length]
    is_kept = before.size and after.size and lowest < 1
    return CurveMinimum(length, lowest, float(after.min() - before.max()) if is_kept else NOWHERE)


def edge_of_minimum(cost: Array) -> int:
    """−1 if the first cost (rest lengths,) is the least, 1 if the last is, 0 otherwise or if a cost is unknown."""
    best = int(np.argmin(cost))
    if np.isnan(cost[best]):
        return 0
    return -1 if best == 0 else int(best == len(cost) - 1)
