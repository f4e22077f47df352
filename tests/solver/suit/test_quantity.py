"""Intervals of draws, also where some have their optimum at the edge of the rest lengths tried."""

import numpy as np
import pytest

from solver.suit.quantity import CensoredEnd, EdgeBounds, Quantity, quantity_of_draws

DRAWN = 0.7 + 0.05 * np.random.default_rng(1).standard_normal(2001)
DRAWN[0] = 0.7


@pytest.mark.parametrize(
    ("lowest", "highest", "censored"),
    [(0.4, 0.9, None), (0.65, 1.0, CensoredEnd.LOW), (0.5, 0.75, CensoredEnd.HIGH), (0.65, 0.75, CensoredEnd.BOTH)],
)
def test_an_end_beyond_the_lengths_tried_is_a_bound_and_the_other_stays(
    lowest: float, highest: float, censored: CensoredEnd | None
) -> None:
    sides = np.where(lowest > DRAWN, -1.0, np.where(highest < DRAWN, 1.0, 0.0))
    bounds = EdgeBounds(np.where(sides, np.clip(DRAWN, lowest, highest), np.nan), sides)
    found = quantity_of_draws(0.7, np.where(sides, np.nan, DRAWN), bounds)
    truth = quantity_of_draws(0.7, DRAWN)
    assert found.censored == censored
    assert truth.ci95
    assert found.ci95 == pytest.approx((max(truth.ci95[0], lowest), min(truth.ci95[1], highest)))


def test_without_bounds_a_draw_without_a_number_leaves_no_interval() -> None:
    versions = DRAWN.copy()
    versions[3] = np.nan
    assert quantity_of_draws(0.7, versions) == Quantity(0.7)
    assert quantity_of_draws(np.nan, DRAWN) == Quantity(None)
