"""Intervals of draws, also where some have their optimum at the edge of the rest lengths tried."""

from types import SimpleNamespace

import numpy as np
import pytest

from solver.suit.quantity import (
    CensoredEnd,
    EdgeBounds,
    Quantity,
    bounds_of,
    content_of_intervals,
    interval_of_draws,
    quantity_of_draws,
)

DRAWN = 0.7 + 0.05 * np.random.default_rng(1).standard_normal(2001)
DRAWN[0] = 0.7


@pytest.mark.parametrize(
    ("fitted", "ci95"),
    [(0.5, (9.525, 10.475)), (0.0, (10.0, 10.975)), (1.0, (9.025, 10.0))],
    ids=["around the fitted cuffs", "all draws above", "all draws below"],
)
def test_an_interval_holds_95_percent_of_equally_spaced_draws_and_the_value(
    fitted: float, ci95: tuple[float, float]
) -> None:
    found = quantity_of_draws(10.0, np.array([fitted, *np.arange(1, 1000) / 1000]))
    assert found.ci95 == pytest.approx(ci95, abs=1e-12) and (found.value, found.censored) == (10.0, None)


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


@pytest.mark.parametrize(
    ("draws", "at_edge", "is_bound"),
    [(38, 0, False), (38, 1, True), (39, 1, True), (78, 1, True), (79, 1, False), (79, 2, True), (118, 2, True)],
)
@pytest.mark.parametrize(("side", "censored"), [(-1.0, CensoredEnd.LOW), (1.0, CensoredEnd.HIGH)])
def test_an_end_is_a_bound_if_the_lower_draw_of_its_quantile_is_at_the_edge(
    draws: int, at_edge: int, is_bound: bool, side: float, censored: CensoredEnd
) -> None:
    """The lower end of n draws lies between the draws k and k + 1 with k = ⌊0.025 (n + 1)⌋, counted from 1."""
    versions, sides = np.linspace(-1.0, 1.0, 1 + draws) * side, np.zeros(1 + draws)
    versions[1 : 1 + at_edge], sides[1 : 1 + at_edge] = np.nan, side
    found = quantity_of_draws(0.0, versions, EdgeBounds(np.full(1 + draws, 2.0 * side), sides))
    assert found.ci95 is not None and found.censored == (censored if is_bound else None)


@pytest.mark.parametrize(("draws", "order"), [(39, 1), (79, 2), (199, 5)])
def test_the_ends_are_order_statistics_between_which_the_next_draw_lies_with_95_percent(draws: int, order: int) -> None:
    """P(X(r) < X < X(s)) = (s − r) / (n + 1)."""
    values = np.random.default_rng(3).standard_normal(draws)
    ends = np.sort(values)[[order - 1, draws - order]]
    assert interval_of_draws(values) == pytest.approx(ends, abs=1e-12)
    assert (draws + 1 - 2 * order) / (draws + 1) == pytest.approx(0.95)


def test_the_content_of_an_interval_has_the_stated_bounds() -> None:
    """Intervals of 100 uniform draws, whose content is their width."""
    ends = np.array([interval_of_draws(draws) for draws in np.random.default_rng(2).random((4000, 100))])
    least, most = content_of_intervals(100)
    content = np.diff(ends, axis=1)
    assert (least, most) == pytest.approx(np.quantile(content, [0.025, 0.975]), abs=0.005)
    assert content.mean() == pytest.approx(0.95, abs=0.002)


def test_draws_without_a_number_are_left_out_and_above_a_tenth_of_them_there_is_no_interval() -> None:
    versions = DRAWN.copy()
    versions[1:201] = np.nan
    assert quantity_of_draws(0.7, versions) == quantity_of_draws(0.7, np.append(DRAWN[0], DRAWN[201:]))
    versions[201] = np.nan
    assert quantity_of_draws(0.7, versions) == Quantity(0.7)
    assert quantity_of_draws(None, DRAWN) == Quantity(None)
    versions[0] = np.nan
    assert quantity_of_draws(0.7, versions, EdgeBounds(np.zeros(2001), np.ones(2001))) == Quantity(0.7)


@pytest.mark.parametrize(
    ("name", "sides", "column"),
    [("rest_length", [-1, 1, 0], 1), ("lowest_cost", [-1, -1, 0], 2), ("to_slack", [1, -1, 0], 3)],
)
def test_beyond_the_edge_the_cost_is_lower_and_a_shorter_cord_is_farther_from_slack(
    name: str, sides: list[int], column: int
) -> None:
    table = np.array([[-1.0, 0.5, 0.9, 0.2], [1.0, 0.8, 0.7, 0.0], [0.0, np.nan, np.nan, np.nan]])
    bounds = bounds_of(SimpleNamespace(bounds=table), name)  # type: ignore[arg-type]
    assert bounds is not None and bounds.sides.tolist() == sides
    np.testing.assert_array_equal(bounds.values, table[:, column])
    assert bounds_of(SimpleNamespace(bounds=table), "cord_force") is None  # type: ignore[arg-type]
