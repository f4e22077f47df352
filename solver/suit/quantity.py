"""A number with its 95 % interval from draws.

An end is censored if draws have their optimum at the edge of the rest lengths tried.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.suit.scenarios import CurveReadouts

Array = NDArray[np.float64]

TAIL = 0.025
MOST_UNKNOWN = 0.1
"""Share of draws without a solution above which there is no interval and no decision: they are no random sample."""
COLUMNS = {"rest_length": 1, "lowest_cost": 2, "to_slack": 3}
"""Field of CurveReadouts → column of its bounds."""


class CensoredEnd(StrEnum):
    """End of an interval that is a bound only, because draws have their optimum at the edge of the lengths tried."""

    LOW = "low"  # the end lies there or below
    HIGH = "high"  # the end lies there or above
    BOTH = "both"


@dataclass(frozen=True)
class Quantity:
    """A number with its 95 % interval; None for a missing interval or number."""

    value: float | None
    ci95: tuple[float, float] | None = None
    censored: CensoredEnd | None = None


@dataclass(frozen=True, eq=False)
class EdgeBounds:
    """values (1 + draws,) where the optimum is at the edge of the lengths tried, NaN elsewhere; sides (1 + draws,) −1
    if the true value lies there or below, 1 if there or above, 0 elsewhere.
    """

    values: Array
    sides: Array


def edge_bounds(versions: CurveReadouts, name: str) -> EdgeBounds | None:
    """EdgeBounds of a field; None for one that has none."""
    if name not in COLUMNS:
        return None
    edge = versions.bounds[:, 0]
    sides = {"rest_length": edge, "lowest_cost": -np.abs(edge), "to_slack": -edge}[name]
    return EdgeBounds(versions.bounds[:, COLUMNS[name]], sides)


def quantity_of_draws(value: float | None, versions: Array, bounds: EdgeBounds | None = None) -> Quantity:
    """versions (1 + draws,): of the assessment on the frames of the draws, then of the draws; the difference between
    the value and the first is added to the others. Where a draw has none, its bound counts. A draw without either is
    left out; if more than MOST_UNKNOWN of them are, there is no interval.
    """
    if value is None or np.isnan(versions[0]):
        return Quantity(value)
    sides = np.zeros(len(versions))
    if bounds is not None:
        sides = np.where(np.isnan(versions), bounds.sides, 0.0)
        versions = np.where(np.isnan(versions), bounds.values, versions)
    is_known = np.isfinite(versions[1:])
    if not is_known.any() or is_known.mean() < 1 - MOST_UNKNOWN:
        return Quantity(value)
    low, high = interval_of_draws(versions[1:][is_known] - versions[0])
    # The value is always inside: a minimum, as the lowest cost, is below that of most draws.
    ends = float(value + min(low, 0.0)), float(value + max(high, 0.0))
    return Quantity(value, ends, _censored(sides[1:][is_known]))


def interval_of_draws(values: Array) -> tuple[float, float]:
    """The 95 % interval of finite values (draws,): order statistics at p (n + 1), between which the next draw lies with
    95 % (David and Nagaraja 2003, Order Statistics, ch. 7.3); the outermost two of fewer than 39.
    """
    low, high = np.quantile(values, [TAIL, 1 - TAIL], method="weibull")
    return float(low), float(high)


def content_of_intervals(draws: int) -> tuple[float, float]:
    """Bounds (95 %) of the part of all draws that an interval of this number of draws contains.

    Between the order statistics r and s of n draws it has the distribution Beta(s − r, n + 1 − s + r).
    """
    inside = (1 - 2 * TAIL) * (draws + 1)
    least, most = (float(scipy.stats.beta.ppf(p, inside, draws + 1 - inside)) for p in (TAIL, 1 - TAIL))
    return least, most


def _censored(sides: Array) -> CensoredEnd | None:
    """Which ends are bounds: those that the quantile takes from draws at the edge, or where these lie within it."""
    most = max(math.floor(TAIL * (len(sides) + 1)) - 1, 0)
    is_low, is_high = (np.count_nonzero(sides == side) > most for side in (-1, 1))
    if is_low and is_high:
        return CensoredEnd.BOTH
    if is_low:
        return CensoredEnd.LOW
    return CensoredEnd.HIGH if is_high else None
