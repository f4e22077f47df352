"""The lowest point of a cost curve and how far one may be off, on curves whose answer is known."""

import numpy as np
import pytest

from solver.suit.readouts import find_minimum

LENGTHS = np.linspace(0.6, 0.9, 16)


def parabola(lowest, cost, curvature):
    return cost + curvature * (LENGTHS - lowest) ** 2


def test_of_a_parabola_all_three_are_exact():
    found = find_minimum(LENGTHS, parabola(0.733, 0.8, 10.0))
    assert found.rest_length == pytest.approx(0.733, abs=1e-12)
    assert found.cost == pytest.approx(0.8, abs=1e-12)
    assert found.width == pytest.approx(2 * np.sqrt(0.1 * 0.2 / 10.0), abs=1e-12)  # where 0.02 of 0.2 is lost


@pytest.mark.parametrize("lowest", [0.5, 0.95])
def test_at_the_edge_of_what_was_tried_there_is_none(lowest):
    found = find_minimum(LENGTHS, parabola(lowest, 0.8, 10.0))
    assert np.isnan([found.rest_length, found.cost, found.width]).all()
    assert found.edge == np.sign(lowest - 0.75)


def test_a_width_that_goes_beyond_what_was_tried_is_unknown():
    found = find_minimum(LENGTHS, parabola(0.63, 0.8, 1.0))
    assert found.rest_length == pytest.approx(0.63)
    assert np.isnan(found.width)


def test_a_suit_that_saves_nothing_has_no_width():
    assert np.isnan(find_minimum(LENGTHS, parabola(0.733, 1.01, 10.0)).width)


def test_a_curve_with_a_gap_has_no_optimum():
    cost = parabola(0.733, 0.8, 10.0)
    cost[3] = np.nan
    assert np.isnan(find_minimum(LENGTHS, cost).rest_length)
