"""Charts as SVG: well-formed, with text, hover titles and classes instead of colours."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from matplotlib.ticker import MaxNLocator

from station.charts.marks import (
    PIECES,
    Band,
    Chart,
    Cloud,
    Intervals,
    Line,
    Mark,
    Panel,
    Points,
    Rule,
    Strip,
    chart,
    curve,
    dots,
    limits,
    tick_texts,
    ticks,
    values,
)
from station.charts.svg import draw

MARKS: tuple[Mark, ...] = (
    Line(values([0, 1, 2]), values([0, 1, 4]), "c1", "hand <both> & more"),
    Band(values([0, 2]), values([0, 3]), values([1, 5]), "c1", "95 %"),
    Cloud(values([0, 1]), values([0, 1]), "c2", "measured"),
    Points(values([1.5]), values([2.0]), "c3", "best"),
    Intervals(values([1.0]), values([0.0]), values([2.0]), "c3", is_upright=True),
    Rule(1.0, label="slack", word="slack cord"),
    Strip(0.2, 0.4, label="fitted", is_upright=True),
)
STEPS = [1, 2, 2.5, 5, 10]


def test_a_chart_is_well_formed_with_texts_hover_titles_and_classes_instead_of_colours() -> None:
    drawn = draw(chart(Panel(MARKS, "length [m]", "effort", "all")), "effort")
    texts = {element.text for element in ET.fromstring(drawn).iter("text")}  # noqa: S314
    assert {"length [m]", "effort", "all", "hand <both> & more", "slack cord", "fitted"} <= texts
    titles = re.findall(r"<title>(.*?)</title>", drawn)
    assert {"hand &lt;both&gt; &amp; more", "95 %", "best: 1.5, 2", "slack", "fitted"} <= set(titles)
    assert not re.search(r"#[0-9a-f]{3,6}|fill=|stroke=", drawn)


def test_numbers_are_where_the_scale_puts_them() -> None:
    panel = Panel((Points(values([0, 10]), values([0, 10]), "c1"),), x_limits=(0, 10), y_limits=(0, 10))
    drawn = draw(chart(panel), "")
    (left, bottom), (right, top) = re.findall(r'cx="([\d.]+)" cy="([\d.]+)"', drawn)
    axis = re.search(r'class="axis" d="M([\d.]+) ([\d.]+)V([\d.]+)H([\d.]+)"', drawn)
    assert axis.groups() == (left, top, bottom, right)


def test_panels_of_a_column_share_their_left_edge_and_legend() -> None:
    wide, narrow = (Panel((Line(values([0, 1]), scale * values([0, 1]), "c1"),)) for scale in (0.001, 1.0))
    drawn = draw(Chart(((wide, narrow),)), "")
    assert len(set(re.findall(r'class="axis" d="M([\d.]+)', drawn))) == 1
    panel = Panel((Line(values([0, 1]), values([0, 1]), "c1", "slack"),))
    assert draw(chart(panel, panel, panel, has_one_legend=True), "").count("> slack<") == 1


def test_curves_have_gaps_peaks_and_ends_and_dots_are_drawn_once() -> None:
    assert curve(values(range(5)), values([0, 1, np.nan, 3, 4])).count("M") == 2
    assert dots(np.full(300, 7.2), np.full(300, 3.1)).count("M") == 1
    y = np.zeros(100_000)
    y[54_321] = 77.0
    d = curve(np.linspace(0.0, 500.0, len(y)), y)
    points = np.cumsum([(float(x), float(up)) for x, up in re.findall(r"(-?[\d.]+) (-?[\d.]+)", d)], axis=0)
    assert points[:, 1].max() == pytest.approx(77.0)
    assert points[[0, -1], 0].tolist() == pytest.approx([0.0, 500.0])
    assert len(points) <= 4 * PIECES


# Axes: round ticks inside the limits, with as many decimals as they need.


@example(1.0, 31.0, 3)
@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e5), st.integers(3, 9))
def test_ticks_are_inside_the_limits_and_as_many_as_matplotlib_finds(low: float, extent: float, most: int) -> None:
    found = ticks(low, low + extent, most)
    assert 1 <= len(found) <= most + 1
    assert low - 1e-9 * extent <= found[0] and found[-1] <= low + extent * (1 + 1e-9)
    theirs = MaxNLocator(most, steps=STEPS).tick_values(low, low + extent)
    inside = theirs[(theirs >= low - 1e-9 * extent) & (theirs <= low + extent * (1 + 1e-9))]
    assert len(found) >= len(inside) / 2.5


@pytest.mark.parametrize(
    ("places", "texts"),
    [
        ([0.0, 0.5, 1.0], ["0.0", "0.5", "1.0"]),
        ([-2.5, 0.0, 2.5], ["−2.5", "0.0", "2.5"]),
        ([2135.0, 2140.0], ["2135", "2140"]),
        ([0.0, 0.025, 0.05], ["0.000", "0.025", "0.050"]),
        ([0.0, 200000.0], ["0", "2e+05"]),
        ([], []),
    ],
)
def test_tick_texts_have_the_decimals_of_their_step(places: list[float], texts: list[str]) -> None:
    assert tick_texts(places) == texts


def test_limits_hold_every_mark_with_a_margin_and_names_count_from_zero() -> None:
    upright = Intervals(values([4]), values([-3]), values([7]), "c1", is_upright=True)
    panel = Panel((Line(values([0, 10]), values([1.0, np.nan]), "c1"), upright, Rule(20.0, is_upright=True)))
    assert limits(panel) == (pytest.approx((-1.0, 21.0)), pytest.approx((-3.5, 7.5)))
    assert limits(Panel((), y_names=("a", "b", "c")))[1] == (-0.6, 2.6)


@pytest.mark.parametrize("number", [0.0, 3.0, -2e-9])
def test_a_single_value_has_an_extent(number: float) -> None:
    (_, _), (low, high) = limits(Panel((Points(values([1.0]), values([number]), "c1"),)))
    assert low < number < high
