"""What a chart shows, as data: lines, dots, bands, intervals, rules. Coordinates are in the units of the axes.

A colour is a class of the page's style sheet (`ink`, `quiet`, `c1` … `c6`), so that it follows the light, dark or
printed page.
"""

from __future__ import annotations

from dataclasses import dataclass
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
    """A straight line across the whole panel, at y (is_upright: at x), with a word beside it."""

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


HALF, THIRD, QUARTER, SIXTH = 500.0, 340.0, 250.0, 195.0
"""Width [px] of a panel that takes this part of the page's width."""

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
