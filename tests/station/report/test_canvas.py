"""The figures' canvas: room for tick labels and names without matplotlib's layout, and PNG that is always the same."""

from __future__ import annotations

import io
from itertools import product

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from station.report import muscle_figures
from station.report.canvas import DPI, TITLED, as_png, fit_columns, new_mosaic, new_page

CONDITIONS = ("slack", "rigid", "shift", "visco_elastic", "both")


@pytest.mark.parametrize("scale", [3e-7, 0.004, 1.0, 85_000.0, 4e9])
def test_numbers_of_any_size_have_room_beside_every_column(scale: float) -> None:
    figure, axes = new_page(3, rows=2, height=1.9, width=3.5, margins=TITLED)
    for axis in axes:
        _fill(axis, scale)
    _assert_nothing_collides(figure)


def test_a_column_of_two_heights_has_room_for_its_widest_number() -> None:
    figure, axes = new_mosaic([["a", "b"], ["a", "c"]], [1, 1], 4.0)
    for name, scale in (("a", 1.0), ("b", 1.0), ("c", 0.0004)):
        _fill(axes[name], scale)
    _assert_nothing_collides(figure)
    assert axes["b"].get_position().x0 == axes["c"].get_position().x0


def test_columns_are_equally_wide_and_reach_the_right_margin() -> None:
    figure, axes = new_page(3)
    for axis, scale in zip(axes, (1.0, 0.001, 1000.0), strict=True):
        _fill(axis, scale)
    fit_columns(figure)
    np.testing.assert_allclose([axis.get_position().width for axis in axes], axes[0].get_position().width)
    assert axes[2].get_position().x1 == pytest.approx(figure.subplotpars.right)


def test_muscles_have_room_for_their_names(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(muscle_figures, "as_png", lambda figure: drawn.append(figure) or b"")
    names = ["LatissimusDorsi_M_of_the_left_side", "Biceps"]
    reduction = {name: {"value": 0.2, "ci95": [0.1, 0.3]} for name in names}
    muscle_figures.reduction_figure(
        {"muscle_reduction": {"rigid": reduction, "hand": {"both": reduction}}, "emg": []}, "hand"
    )
    _assert_nothing_collides(drawn[0])
    label = max((label.get_window_extent() for label in drawn[0].axes[0].get_yticklabels()), key=lambda box: box.width)
    assert label.x0 > 0.0


def test_activations_of_eight_muscles_leave_room_for_titles_and_legend(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(muscle_figures, "as_png", lambda figure: drawn.append(figure) or b"")
    rows = [
        {
            "time_s": time,
            "condition": condition,
            "cuff": "",
            **dict.fromkeys(muscle_figures.NAMED_MUSCLES, 0.002 * time),
        }
        for condition, time in product(CONDITIONS, (0.0, 1.0, 6.0))
    ]
    muscle_figures.activation_figure(pd.DataFrame(rows), "hand")
    _assert_nothing_collides(drawn[0])
    (legend,) = drawn[0].legends
    lowest = min(axis.get_tightbbox().y0 for axis in drawn[0].axes)
    assert legend.get_window_extent().y1 <= lowest


def test_the_same_figure_gives_the_same_bytes_without_a_date_or_a_version() -> None:
    first, second = (as_png(_example()) for _ in range(2))
    assert first == second
    with Image.open(io.BytesIO(first)) as image:
        assert set(image.info) == {"dpi"}


def test_a_figure_is_opaque_and_as_large_as_it_was_asked_to_be() -> None:
    with Image.open(io.BytesIO(as_png(_example()))) as image:
        assert image.mode == "RGB"
        assert image.size == (2 * 5.2 * DPI, 3.4 * DPI)
        assert image.getpixel((0, 0)) == (255, 255, 255)


def _example() -> Figure:
    figure, axes = new_page(2)
    for axis, scale in zip(axes, (1.0, 2e6), strict=True):
        _fill(axis, scale)
    return figure


def _fill(axis: Axes, scale: float) -> None:
    axis.plot([0.0, 61.0], [-0.77 * scale, scale])
    axis.set_xlabel("session time [s]")
    axis.set_ylabel("displacement [mm]")


def _assert_nothing_collides(figure: Figure) -> None:
    """What stands around an axes is on the figure, and on no other axes."""
    fit_columns(figure)
    figure.draw_without_rendering()
    for axis in figure.axes:
        around = axis.get_tightbbox()
        assert around.x0 >= 0.0 and around.y0 >= 0.0, axis.get_ylabel()
        assert around.x1 <= figure.bbox.x1 and around.y1 <= figure.bbox.y1, axis.get_ylabel()
        side = axis.yaxis.get_tightbbox()
        assert not any(side.overlaps(other.bbox) for other in figure.axes if other is not axis), axis.get_ylabel()
