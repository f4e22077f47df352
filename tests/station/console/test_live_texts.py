"""Figures in the sentences of the live page."""

from __future__ import annotations

import math

import pytest

from station.console.live_view import best_text, delivery_text, most_active, rest_length_text, share_text
from station.live.published import LiveBest, LiveDelivery, LiveUpdate
from tests.station.console.live_source import live_setup


@pytest.mark.parametrize(("share", "figure"), [(1.0, "100 %"), (0.914, "91 %"), (0.0, "0 %"), (math.nan, "–")])
def test_an_effort_is_a_share_of_that_with_a_slack_cord(share: float, figure: str) -> None:
    assert share_text(share) == figure


@pytest.mark.parametrize(
    ("best", "figures"),
    [
        (LiveBest(0.708, 0.012, 0.912, 4), ("0.71 m ± 0.01", "9 % less")),
        (LiveBest(0.708, math.nan, 1.03, 1), ("0.71 m,", "3 % more")),
    ],
)
def test_the_best_rest_length_has_its_spread_and_its_effort(best: LiveBest, figures: tuple[str, ...]) -> None:
    assert all(figure in best_text(best) for figure in figures)


def test_the_largest_activations_come_first_and_unsolved_ones_are_left_out() -> None:
    text = most_active(("a", "b_c", "d"), (0.12, 0.5, math.nan))
    assert text.endswith("b c 50 %, a 12 %")
    assert "%" not in most_active(("a",), (math.nan,))


def test_frames_left_out_and_updates_not_shown_are_counted() -> None:
    delivery = LiveDelivery(0.0, 0.17, 0.021, 50, 7, 1, 98.6, not_shown=3)
    text = delivery_text(live_setup(), LiveUpdate(None, delivery), is_over=False)
    for figures in ("99 of 100 frames", "7 frames left out", "21 ms", "3 updates"):
        assert figures in text


def test_a_rest_length_has_millimetres() -> None:
    assert "0.705 m" in rest_length_text(0.705) and not rest_length_text(math.nan)
