"""Axes of a chart: limits, ticks at round numbers, and their texts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from station.charts.marks import (
    Array,
    Band,
    Cloud,
    Intervals,
    Line,
    Mark,
    Panel,
    Points,
    Rule,
    Strip,
)

MARGIN = 0.05
"""Part of the extent that is left free at both ends of an axis."""
ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
LARGE, SMALL = 1e5, 1e-4
"""Tick labels outside have an exponent."""


@dataclass(frozen=True)
class Scale:
    """From numbers [low, high] to pixels [start, end]."""

    low: float
    high: float
    start: float
    end: float

    def pixels(self, numbers: Array) -> Array:
        return self.start + (numbers - self.low) * ((self.end - self.start) / (self.high - self.low))

    def pixel(self, number: float) -> float:
        return float(self.start + (number - self.low) * (self.end - self.start) / (self.high - self.low))


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round numbers from low to high: the least step of 1, 2, 2.5 or 5 times a power of ten with `most` intervals."""
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    for factor in ROUND:
        step = power * factor
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        if last - first <= most:
            break
    return [number * step for number in range(first, last + 1)]


def tick_texts(places: list[float]) -> list[str]:
    """As many decimals as distinguish neighbours, the same for all."""
    if not places:
        return []
    step = places[1] - places[0] if len(places) > 1 else abs(places[0]) or 1.0
    largest = max(map(abs, places))
    if largest >= LARGE or (largest < SMALL and largest > 0):
        return [f"{place:.3g}".replace("-", "−") for place in places]
    decimals = next((count for count in range(9) if abs(round(step, count) - step) < 1e-6 * step), 9)
    return [f"{place:z.{decimals}f}".replace("-", "−") for place in places]


def limits(panel: Panel) -> tuple[tuple[float, float], tuple[float, float]]:
    """Of the x and the y axis: the extent of the marks with a margin, or what the panel asks for."""
    return (
        _with_names(panel.x_names) or _limits([*_extents(panel.marks, is_x=True)], panel.x_limits),
        _with_names(panel.y_names) or _limits([*_extents(panel.marks, is_x=False)], panel.y_limits),
    )


def _with_names(names: tuple[str, ...]) -> tuple[float, float] | None:
    return (-0.6, len(names) - 0.4) if names else None


def _limits(extents: list[Array], wished: tuple[float | None, float | None]) -> tuple[float, float]:
    known = np.concatenate([np.ravel(extent) for extent in extents]) if extents else np.zeros(0)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    low, high = (wished[0] if wished[0] is not None else low), (wished[1] if wished[1] is not None else high)
    if not high - low > 1e-12 * max(abs(low), abs(high), 1e-300):
        reach = 0.05 * abs(low) or 1.0
        low, high = low - reach, low + reach
    free = MARGIN * (high - low)
    return (low - free if wished[0] is None else low), (high + free if wished[1] is None else high)


def _extents(marks: Iterable[Mark], *, is_x: bool) -> Iterable[Array]:
    """Numbers on one axis that have to be seen."""
    for mark in marks:
        match mark:
            case Line() | Cloud() | Points():
                yield mark.x if is_x else mark.y
            case Band():
                yield from (mark.x,) if is_x else (mark.low, mark.high)
            case Intervals():
                yield from (mark.places,) if mark.is_upright == is_x else (mark.low, mark.high)
            case Rule() if mark.is_upright == is_x:
                yield np.array([mark.at])
            case Strip() if mark.is_upright == is_x:
                yield np.array([mark.low, mark.high])
