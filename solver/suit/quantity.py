"""A number with its 95 % interval from draws; an end is a bound only where draws have their optimum at the edge."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from solver.suit.readouts import CurveReadouts

Array = NDArray[np.float64]

TAIL = 0.025
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


def bounds_of(versions: CurveReadouts, name: str) -> EdgeBounds | None:
    """EdgeBounds of a field; None for one that has none."""
    if name not in COLUMNS:
        return None
    edge = versions.bounds[:, 0]
    sides = {"rest_length": edge, "lowest_cost": -np.abs(edge), "to_slack": -edge}[name]
    return EdgeBounds(versions.bounds[:, COLUMNS[name]], sides)


def quantity_of_draws(value: float, versions: Array | None, bounds: EdgeBounds | None = None) -> Quantity:
    """versions (1 + draws,): of the fitted cuffs, then of the drawn ones, on fewer frames than the value; NaN where a
    draw has none, and its bound counts.
    """
    if np.isnan(value):
        return Quantity(None)
    if versions is None or np.isnan(versions[0]):
        return Quantity(float(value))
    sides = np.zeros(len(versions))
    if bounds is not None:
        sides = np.where(np.isnan(versions), bounds.sides, 0.0)
        versions = np.where(np.isnan(versions), bounds.values, versions)
    if np.isnan(versions).any():
        return Quantity(float(value))
    low, high = np.quantile(versions[1:] - versions[0], [TAIL, 1 - TAIL])
    # The value is always inside: a minimum, as the lowest cost, is below that of most draws.
    ends = float(value + min(low, 0.0)), float(value + max(high, 0.0))
    return Quantity(float(value), ends, _censored(sides[1:]))


def _censored(sides: Array) -> CensoredEnd | None:
    """Which ends are bounds: those that the quantile takes from draws at the edge, or where these lie within it."""
    most = math.floor(TAIL * (len(sides) - 1))
    is_low, is_high = (np.count_nonzero(sides == side) > most for side in (-1, 1))
    if is_low and is_high:
        return CensoredEnd.BOTH
    if is_low:
        return CensoredEnd.LOW
    return CensoredEnd.HIGH if is_high else None
