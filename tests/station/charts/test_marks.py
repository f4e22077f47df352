"""Axes: round ticks inside the limits, with as many decimals as they need."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from matplotlib.ticker import MaxNLocator

from station.charts.marks import Intervals, Line, Panel, Points, Rule, limits, tick_texts, ticks, values

STEPS = [1, 2, 2.5, 5, 10]


@example(1.0, 31.0, 3)
@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e5), st.integers(3, 9))
def test_ticks_are_round_inside_the_limits_and_as_many_as_matplotlib_finds(
    low: float, extent: float, most: int
) -> None:
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


def test_limits_hold_every_mark_with_a_margin() -> None:
    panel = Panel(
        (
            Line(values([0, 10]), values([1.0, np.nan]), "c1"),
            Intervals(values([4]), values([-3]), values([7]), "c1", is_upright=True),
            Rule(20.0, is_upright=True),
        )
    )
    assert limits(panel) == (pytest.approx((-1.0, 21.0)), pytest.approx((-3.5, 7.5)))


@pytest.mark.parametrize("number", [0.0, 3.0, -2e-9])
def test_a_single_value_has_an_extent(number: float) -> None:
    (_, _), (low, high) = limits(Panel((Points(values([1.0]), values([number]), "c1"),)))
    assert low < number < high


def test_names_count_from_zero() -> None:
    assert limits(Panel((), y_names=("a", "b", "c")))[1] == (-0.6, 2.6)
