"""Content of a chart as data: lines, dots, bands, intervals, rules, with axes and paths.

Coordinates are in the units of the axes. A colour is a class of the page's style sheet (`ink`, `quiet`, `c1` … `c6`),
so that it follows the light, dark or printed page.

Axes have limits, ticks at round numbers, and their texts. Curves and clouds are short SVG paths: no more points than a
screen can show, in tenths of a pixel.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Colour = Literal[
    "ink", "quiet", "c1", "c2", "c3", "c4", "c5", "c6",
    "less1", "less2", "less3", "same", "more1", "more2", "more3", "bone", "cord",
]  # fmt: skip
Dash = Literal["", "dashed", "dotted"]

COLOURS: tuple[Colour, ...] = ("c1", "c2", "c3", "c4", "c5", "c6")
"""Blue, vermilion, green, purple, orange, sky blue: the palette of Okabe and Ito (2008), which colour-blind users can
distinguish. Yellow is left out: it cannot be seen on white paper.
"""
MARGIN = 0.05
"""Part of the extent that is left free at both ends of an axis."""
ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
LARGE, SMALL = 1e5, 1e-4
"""Tick labels outside have an exponent."""
PIECES = 220
"""Of a curve; the first, least, greatest and last value of every piece are kept, so that no peak is lost."""
MOST_DOTS = 450
HALF, THIRD, QUARTER, SIXTH = 500.0, 340.0, 250.0, 180.0
"""Width [px] of a panel that takes this part of the page's width."""


@dataclass(frozen=True)
class Line:
    """A curve; NaN interrupts it. title: shown on hovering where there is no label, which is also in the legend."""

    x: Array
    y: Array
    colour: Colour
    label: str = ""
    dash: Dash = ""
    width: float = 1.4
    title: str = ""


@dataclass(frozen=True)
class Cloud:
    """Many small dots without titles of their own."""

    x: Array
    y: Array
    colour: Colour
    label: str = ""


@dataclass(frozen=True)
class Points:
    """Dots, each with a hover title; hollow ones mark a second series in the same colour. radius [px]: None for that
    of the kind.
    """

    x: Array
    y: Array
    colour: Colour
    label: str = ""
    is_hollow: bool = False
    radius: float | None = None
    titles: tuple[str, ...] = ()


@dataclass(frozen=True)
class Intervals:
    """Bars from low to high through places on the other axis; is_upright: along y."""

    places: Array
    low: Array
    high: Array
    colour: Colour
    is_upright: bool


@dataclass(frozen=True)
class Band:
    """Area between two curves over x."""

    x: Array
    low: Array
    high: Array
    colour: Colour
    label: str = ""


@dataclass(frozen=True)
class Rule:
    """A straight line across the whole panel, at y (is_upright: at x), with a label."""

    at: float
    colour: Colour = "ink"
    label: str = ""
    dash: Dash = ""
    is_upright: bool = False
    word: str = ""


@dataclass(frozen=True)
class Strip:
    """Shaded strip from low to high on the x axis (is_upright) or on the y axis."""

    low: float
    high: float
    colour: Colour = "quiet"
    label: str = ""
    is_upright: bool = False


Mark = Line | Cloud | Points | Intervals | Band | Rule | Strip


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    x_names, y_names  instead of numbers: names of the places 0, 1, 2 … ; y_names run downwards
    x_limits, y_limits  instead of the extent of the marks; None leaves an end to them
    width, height     [px] with margins; text is 11 px
    is_picture        without axes, both directions on the same scale
    """

    marks: tuple[Mark, ...]
    x_label: str = ""
    y_label: str = ""
    title: str = ""
    x_names: tuple[str, ...] = ()
    y_names: tuple[str, ...] = ()
    x_limits: tuple[float | None, float | None] = (None, None)
    y_limits: tuple[float | None, float | None] = (None, None)
    width: float = HALF
    height: float = 250.0
    has_x_numbers: bool = True
    is_picture: bool = False


@dataclass(frozen=True)
class Chart:
    """Panels in columns, each drawn below the other in its column. On a narrow screen the columns follow each other.

    has_one_legend  all panels have the labels of the first, and one legend stands above them
    """

    columns: tuple[tuple[Panel, ...], ...]
    has_one_legend: bool = False


def chart(*panels: Panel, has_one_legend: bool = False) -> Chart:
    """Every panel in a column of its own."""
    return Chart(tuple((panel,) for panel in panels), has_one_legend)


def values(numbers: object) -> Array:
    """As an array of 64-bit floats; None becomes NaN."""
    return np.asarray(numbers, dtype=np.float64)


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


def curve(x: Array, y: Array) -> str:
    """`d` of a path through the points (n,) [px]; NaN interrupts it."""
    return "".join(_piece(points) for points in _runs(np.column_stack([x, y])) if len(points))


def outline(x: Array, low: Array, high: Array) -> str:
    """`d` of the closed path around a band."""
    return "".join(
        _piece(np.concatenate([points[:, :2], points[::-1, ::2]])) + "Z"
        for points in _runs(np.column_stack([x, low, high]))
        if len(points)
    )


def dots(x: Array, y: Array) -> str:
    """`d` of dots: lines of no length, which a round line cap makes visible. Dots on the same pixel are one."""
    points = np.column_stack([x, y])[:: max(1, -(-len(x) // MOST_DOTS))]
    pixels = np.unique(np.round(points[np.isfinite(points).all(axis=1)], 0), axis=0)
    return "".join(f"M{across} {up}h0" for across, up in pixels.astype(np.int64).tolist())


def _runs(points: Array) -> Iterator[Array]:
    """The stretches without NaN."""
    known = np.asarray(np.isfinite(points).all(axis=1))
    edges = np.flatnonzero(np.diff(known)) + 1
    for run in np.split(np.arange(len(points)), edges):
        if len(run) and known[run[0]]:
            yield points[run]


def _piece(points: Array) -> str:
    points = _decimated(points)
    tenths = np.rint(10.0 * points).astype(np.int64)
    steps = np.diff(tenths, axis=0)
    moves = steps[np.any(steps != 0, axis=1)]
    start = f"M{_tenths(int(tenths[0, 0]))} {_tenths(int(tenths[0, 1]))}"
    return start + ("l" + " ".join(map(_tenths, moves.ravel().tolist())) if len(moves) else "h0")


@cache
def _tenths(count: int) -> str:
    """A number of tenths; steps of curves are few numbers many times."""
    return f"{count / 10:g}"


def _decimated(points: Array) -> Array:
    """First, least, greatest (of y) and last point of every piece of a long curve, in their order."""
    count = len(points)
    if count <= 4 * PIECES:
        return points
    edges = np.arange(PIECES + 1) * count // PIECES
    up, kept = points[:, 1], np.zeros(count, bool)
    kept[edges[:-1]] = kept[edges[1:] - 1] = True
    piece = np.repeat(np.arange(PIECES), np.diff(edges))
    order = np.lexsort((up, piece))  # of every piece the least and the greatest at its ends
    kept[order[edges[:-1]]] = kept[order[edges[1:] - 1]] = True
    return np.asarray(points[kept])
