"""Limits of the figures of a fibre's curves, beyond which a curve folds or its force is not finite.

Those of OpenSim's SmoothSegmentedFunctionFactory, Millard2012EquilibriumMuscle, Thelen2003Muscle and
DeGrooteFregly2016Muscle, which refuse to build such a muscle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

from solver.functions.fibre import Curves, DeGrooteFreglyCurves, MillardCurves, ThelenCurves


@dataclass(frozen=True)
class Interval:
    """From low to high; brackets say which ends belong to it: "[)" is from low to below high."""

    low: float
    high: float = math.inf
    brackets: str = "()"

    def __contains__(self, value: float) -> bool:
        is_above = value >= self.low if self.brackets[0] == "[" else value > self.low
        return is_above and (value <= self.high if self.brackets[1] == "]" else value < self.high)

    def __str__(self) -> str:
        return f"{self.brackets[0]}{self.low:g}, {self.high:g}{self.brackets[1]}"


ABOVE_ZERO, FROM_ZERO = Interval(0.0), Interval(0.0, math.inf, "[)")
SHARE = Interval(0.0, 1.0, "[]")


@dataclass(frozen=True)
class Outside:
    """A figure outside its interval."""

    name: str
    interval: Interval
    value: float

    def __str__(self) -> str:
        return f"{self.name} in {self.interval} and has {self.value:g}"


def first_outside(owner: object, limits: Iterable[tuple[str, Interval]]) -> Outside | None:
    """The first of the owner's named figures that is outside its interval."""
    for name, interval in limits:
        value = getattr(owner, name)
        if value not in interval:
            return Outside(name, interval, value)
    return None


@lru_cache(maxsize=256)
def outside_of_curves(curves: Curves) -> Outside | None:
    """Kept, because muscles are made anew for every drawn person, with the same curves."""
    return first_outside(curves, _curve_limits(curves))


def _curve_limits(curves: Curves) -> Iterator[tuple[str, Interval]]:
    """Intervals of the figures. Those of later ones are computed from earlier ones, which have to be inside theirs."""
    if isinstance(curves, MillardCurves):
        yield from _active_limits(curves)
        yield from _speed_limits(curves)
        yield from _passive_limits(curves)
    elif isinstance(curves, ThelenCurves):
        yield from ((name, ABOVE_ZERO) for name in ("passive_strain", "active_shape", "passive_shape"))
        yield "velocity_shape", ABOVE_ZERO
        yield "strongest", Interval(1.0)
        yield "linear_beyond", Interval(1.0 / curves.strongest, 1.0)
    elif isinstance(curves, DeGrooteFreglyCurves):
        yield "width", Interval(1.0, math.inf, "[)")
        yield "passive_strain", ABOVE_ZERO


def _active_limits(curves: MillardCurves) -> Iterator[tuple[str, Interval]]:
    yield "transition", Interval(0.0, 1.0)
    yield "shortest", Interval(0.0, curves.transition, "[)")
    yield "longest", Interval(1.0)
    yield "minimum", Interval(0.0, 1.0, "[)")
    yield "shallow_slope", Interval(0.0, (1.0 - curves.minimum) / (1.0 - curves.transition), "[)")


def _speed_limits(curves: MillardCurves) -> Iterator[tuple[str, Interval]]:
    yield "strongest", Interval(1.0)
    yield "concentric_slope", Interval(0.0, 1.0, "[)")
    yield "near_concentric_slope", Interval(curves.concentric_slope, 1.0)
    yield "eccentric_slope", Interval(0.0, curves.strongest - 1.0, "[)")
    yield "near_eccentric_slope", Interval(max(curves.eccentric_slope, 1.5e-8), curves.strongest - 1.0, "[)")
    concentric_secant = (1.0 - 0.05 * (curves.concentric_slope + curves.near_concentric_slope)) / 0.9
    rise = curves.strongest - 1.0 - 0.05 * (curves.eccentric_slope + curves.near_eccentric_slope)
    yield "isometric_slope", Interval(max(1.0, concentric_secant, rise / 0.9))
    yield "concentric_curviness", SHARE
    yield "eccentric_curviness", SHARE


def _passive_limits(curves: MillardCurves) -> Iterator[tuple[str, Interval]]:
    yield "passive_end", Interval(curves.passive_start)
    strain = curves.passive_end - curves.passive_start
    yield "passive_low_slope", Interval(0.0, 1.0 / strain)
    toe = min(0.1 / max(curves.passive_slope, 1.0 / strain), 0.1 * strain)
    yield "passive_slope", Interval((1.0 - curves.passive_low_slope * toe / 2) / (strain - toe))
    yield "passive_curviness", SHARE
