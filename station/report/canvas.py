"""The canvas of the report's figures: style, axes with margins in inches, PNG."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from station.report.ticks import draw_with_moved_ticks, reach_on_the_left

FORCE, MOTION, LINE, MARK = "#1f5f8b", "#c2571a", "#1b1b1b", "#8a8a8a"
SHADES = ("#1f5f8b", "#3f9c6b", "#b8860b", "#8b3a62", "#5a5a9a")
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titley": 1.0,  # else matplotlib measures every axis to find where a title is free of it
    "grid.color": "#e4e4e4",
    "legend.fontsize": 8,
    "legend.edgecolor": "none",
}
WIDE = 10.4
"""Inches of a figure that takes the page's whole width: wider, and its words are small on the page."""
TITLE = 0.3
"""Inches above axes that have a title, or one row of a legend."""
SPACE = 0.09
"""Inches between columns, beside what stands there."""
NAME = 0.22
"""Inches of a vertical axis's name and of the space between it and the tick labels."""
DPI = 120
COMPRESSION = 3
"""Level of zlib: 6, the usual one, takes almost twice the time for 2 % fewer bytes."""


@dataclass(frozen=True)
class Margins:
    """Inches above, below and right of a figure's axes, and between its rows; on the left `fit_columns` finds them."""

    top: float = 0.12
    bottom: float = 0.48
    right: float = 0.15
    between_rows: float = 0.16


PLAIN = Margins()
TITLED = Margins(top=TITLE)


def new_page(
    columns: int, rows: int = 1, height: float = 3.4, width: float = 5.2, margins: Margins = PLAIN
) -> tuple[Figure, list[Axes]]:
    """A figure and its axes, row by row; height and width [in] are those of one of them with its margins."""
    with mpl.rc_context(STYLE):
        figure = _new_figure(width * columns, height * rows, rows, margins)
        axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.flat)


def new_mosaic(
    plan: list[Any], height_ratios: Sequence[float], height: float, margins: Margins = TITLED
) -> tuple[Figure, dict[str, Axes]]:
    """A figure of the page's width and this height [in], and its axes by the names in the plan."""
    with mpl.rc_context(STYLE):
        figure = _new_figure(WIDE, height, len(plan), margins)
        axes = figure.subplot_mosaic(plan, height_ratios=height_ratios)
    return figure, axes


def fit_columns(figure: Figure) -> None:
    """Leave as much room on the left of every column as its tick labels and its axis's name need.

    Matplotlib's constrained layout would do the same, but measures every text four times and draws the figure twice:
    half of its processor time. The height of a row follows from the margins, so that one pass is enough.
    """
    needed: dict[int, float] = {}
    columns = 1
    for axes in figure.axes:
        place = axes.get_subplotspec()
        if place is not None and axes.get_visible() and axes.axison:
            columns = place.get_gridspec().ncols
            needed[place.colspan.start] = max(needed.get(place.colspan.start, 0.0), _room_on_the_left(axes))
    width, right = figure.get_figwidth(), figure.subplotpars.right
    left = needed.pop(0, PLAIN.right)
    gap = max(needed.values(), default=PLAIN.right)
    column = (right * width - left - (columns - 1) * gap) / columns
    figure.subplots_adjust(left=left / width, wspace=gap / column)


def as_png(figure: Figure) -> bytes:
    """The same figure gives the same bytes: neither a date nor a version is in them."""
    pixels, png = io.BytesIO(), io.BytesIO()
    figure.set_dpi(DPI)
    with mpl.rc_context(STYLE):
        if figure.get_layout_engine() is None:
            fit_columns(figure)
            draw_with_moved_ticks(figure)
        figure.savefig(pixels, format="rgba", dpi=DPI)
    opaque = Image.frombytes("RGBA", figure.canvas.get_width_height(), pixels.getvalue()).convert("RGB")
    opaque.save(png, "png", compress_level=COMPRESSION, dpi=(DPI, DPI))
    return png.getvalue()


def _new_figure(width: float, height: float, rows: int, margins: Margins) -> Figure:
    figure = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)  # else every measurement of a text builds a renderer
    row = (height - margins.top - margins.bottom - (rows - 1) * margins.between_rows) / rows
    figure.subplots_adjust(
        bottom=margins.bottom / height,
        top=1.0 - margins.top / height,
        right=1.0 - margins.right / width,
        hspace=margins.between_rows / row,
    )
    return figure


def _room_on_the_left(axes: Axes) -> float:
    """Inches from the axes' left edge to what stands left of them."""
    return reach_on_the_left(axes) + (NAME if axes.get_ylabel() else 0.0) + SPACE
