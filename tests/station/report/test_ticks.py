"""Ticks drawn by one Tick that moves, held against matplotlib's own."""

from __future__ import annotations

import io
from collections.abc import Callable

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from station.report.canvas import STYLE, TITLED, fit_columns, new_page
from station.report.ticks import draw_with_moved_ticks


def _numbers(over: Axes, under: Axes) -> None:
    for axis, scale in ((over, 0.004), (under, 85_000.0)):
        axis.plot([0.0, 61.0], [-0.77 * scale, scale])
        axis.set_ylabel("displacement [mm]")
    under.set_xlabel("session time [s]")


def _shared(over: Axes, under: Axes) -> None:
    _numbers(over, under)
    under.sharex(over)
    over.tick_params(labelbottom=False)


def _powers_and_names(over: Axes, under: Axes) -> None:
    over.plot([0.0, 61.0], [0.0, 4e9])
    under.barh([0, 1, 2], [3.0, 4.0, 5.0])
    under.set_yticks([0, 1, 2], ["Biceps", "DeltoideusScapula_M", "SerratusAnterior_I"])
    under.invert_yaxis()


def _none(over: Axes, under: Axes) -> None:
    _numbers(over, under)
    over.set_axis_off()
    under.set_yticks([])


@pytest.mark.parametrize("fill", [_numbers, _shared, _powers_and_names, _none])
def test_a_figure_looks_as_matplotlib_draws_it(fill: Callable[[Axes, Axes], None]) -> None:
    """But for the axes' names, which may stand a pixel aside."""
    expected, found = _filled(fill), _filled(fill)
    with mpl.rc_context(STYLE):
        draw_with_moved_ticks(found)
    for figure in (expected, found):
        figure.draw_without_rendering()
    for before, after in zip(expected.axes, found.axes, strict=True):
        for name in ("xaxis", "yaxis"):
            places = [getattr(axes, name).label.get_window_extent().get_points() for axes in (before, after)]
            np.testing.assert_allclose(*places, atol=1.5)
            getattr(before, name).label.set_text("")
            getattr(after, name).label.set_text("")
    np.testing.assert_array_equal(_pixels(found), _pixels(expected))


def _filled(fill: Callable[[Axes, Axes], None]) -> Figure:
    figure, (over, under) = new_page(1, rows=2, height=1.9, margins=TITLED)
    with mpl.rc_context(STYLE):
        fill(over, under)
        fit_columns(figure)
    return figure


def _pixels(figure: Figure) -> NDArray[np.uint8]:
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format="png")
    with Image.open(buffer) as image:
        return np.asarray(image)
