"""Live values on their way to the pages: one subscription, common rest length, and what remains when they stop."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.multibody.postures import points_in_ground, postures
from solver.osim.model_writer import osim_document
from solver.suit.suit import read_suit
from station.console.live_feed import COMMAND_TIMEOUT_S, BodyDrawing, LiveFeed
from station.live.published import LiveSubject
from station.sources import read_model
from tests.station.console.live_source import LiveSource, live_setup
from tests.timeout import scaled_timeout

FEEDS: list[LiveFeed] = []


class ManualClock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


async def polled(feed: LiveFeed, is_met: Callable[[], bool]) -> None:
    async with asyncio.timeout(scaled_timeout(60.0)):
        while not is_met():
            await feed.poll()
            await asyncio.sleep(0.005)


def opened(folder: Callable[[], Path | None], *clock: Callable[[], float]) -> LiveFeed:
    """Closed by run()."""
    FEEDS.append(LiveFeed(folder, *clock))
    return FEEDS[-1]


def run(work: Coroutine[Any, Any, None]) -> None:
    try:
        asyncio.run(work)
    finally:
        while FEEDS:
            FEEDS.pop().close()


def test_a_page_opened_in_the_middle_has_the_curves_so_far(tmp_path: Path) -> None:
    async def whole() -> None:
        feed = opened(lambda: tmp_path)
        with LiveSource(tmp_path) as source:
            await polled(feed, lambda: feed.setup is not None and source.views == 1)
            sent = [source.publish() for _ in range(5)]
            await polled(feed, lambda: feed.points == 5)
            assert feed.values == sent[-1]
            assert [point.time_s for point in feed.history] == [one.time_s for one in sent]
            assert [point.cord_force_n for point in feed.history] == [one.scenarios[1].cord_force_n for one in sent]
            assert feed.drawing is not None and feed.suit is not None

    run(whole())


def test_a_rest_length_is_common_at_once_and_solved_from_the_next_frame_on(tmp_path: Path) -> None:
    async def whole() -> None:
        feed = opened(lambda: tmp_path)
        with LiveSource(tmp_path) as source:
            await polled(feed, lambda: feed.setup is not None and source.views == 1)
            assert feed.rest_length_m == 0.70
            feed.set_rest_length(0.755)
            assert feed.rest_length_m == 0.755
            await polled(feed, lambda: len(source.rest_lengths) == 2)
            assert source.rest_lengths == [("worn", 0.755), ("rigid", 0.755)], "what is compared has the same cord"
            source.publish()
            await polled(feed, lambda: feed.points == 1)
            lengths = {one.name: one.rest_length_m for one in feed.scenarios}
            assert lengths == {
                "slack": pytest.approx(math.nan, nan_ok=True),
                "worn": 0.755,
                "rigid": 0.755,
                "0.680 m": 0.68,
            }
            assert feed.rest_length_m == 0.755

    run(whole())


def test_a_rest_length_that_is_not_applied_is_not_shown_for_long(tmp_path: Path) -> None:
    async def whole() -> None:
        clock = ManualClock()
        feed = opened(lambda: tmp_path, clock)
        with LiveSource(tmp_path) as source:
            await polled(feed, lambda: feed.setup is not None and source.views == 1)
            feed.set_rest_length(0.755)
            await feed.poll()
            assert feed.rest_length_m == 0.755
            clock.now_s += COMMAND_TIMEOUT_S + 0.1
            await feed.poll()
            assert feed.rest_length_m == 0.70

    run(whole())


def test_values_remain_while_there_are_no_new_ones_and_after_the_end(tmp_path: Path) -> None:
    """The page shows their age."""

    async def whole() -> None:
        feed = opened(lambda: tmp_path)
        with LiveSource(tmp_path) as source:
            await polled(feed, lambda: feed.setup is not None and source.views == 1)
            last = source.publish()
            source.publish_nothing()
            await polled(feed, lambda: feed.latest is not None and feed.latest.values is None)
            assert feed.values == last
        await polled(feed, lambda: feed.is_over)
        assert feed.values == last

    run(whole())


def test_another_session_shows_nothing_of_the_one_before(tmp_path: Path) -> None:
    async def whole() -> None:
        first, second = tmp_path / "first", tmp_path / "second"
        first.mkdir(), second.mkdir()
        open_folder = first
        feed = opened(lambda: open_folder)
        with LiveSource(first) as source:
            await polled(feed, lambda: feed.setup is not None and source.views == 1)
            source.publish()
            await polled(feed, lambda: feed.points == 1)
            open_folder = second
            await feed.poll()
            assert (feed.setup, feed.values, len(feed.history)) == (None, None, 0)
            assert math.isnan(feed.rest_length_m)
            with LiveSource(second, live_setup(subject=LiveSubject("P02", is_scaled=True))):
                clock_over = feed.setups + 1
                await polled(feed, lambda: feed.setups == clock_over)
                assert feed.setup is not None and feed.setup.subject.name == "P02"

    run(whole())


def test_without_fitted_cuffs_the_rigid_suit_is_the_one_worn(tmp_path: Path) -> None:
    async def whole() -> None:
        feed = opened(lambda: tmp_path)
        setup = live_setup(scenarios=tuple(one for one in live_setup().scenarios if one.condition != "both"))
        with LiveSource(tmp_path, setup) as source:
            await polled(feed, lambda: feed.setup is not None and source.views == 1)
            feed.set_rest_length(0.755)
            await polled(feed, lambda: bool(source.rest_lengths))
            assert source.rest_lengths == [("rigid", 0.755)]

    run(whole())


@pytest.mark.parametrize("scenarios", [(), live_setup().scenarios[:1]])
def test_without_a_worn_suit_there_is_no_rest_length(tmp_path: Path, scenarios: tuple[Any, ...]) -> None:
    async def whole() -> None:
        feed = opened(lambda: tmp_path)
        with LiveSource(tmp_path, live_setup(scenarios=scenarios)):
            await polled(feed, lambda: feed.setup is not None)
            feed.set_rest_length(0.7)
            assert feed.worn is None and math.isnan(feed.rest_length_m)

    run(whole())


# The body on the live page is that of the model, scaled or not.


def test_muscles_begin_at_their_origins_and_the_cord_at_the_waist() -> None:
    model, suit = bundled_model(), read_suit()
    q = model.default_coordinates
    lines = BodyDrawing(model, suit).lines(q.tolist())
    state = postures(model, q[None], np.zeros((1, len(q))))
    assert len(lines["muscles"]) == len(model.muscles)
    for muscle, drawn in zip(model.muscles, lines["muscles"], strict=True):
        origin = points_in_ground(state, muscle.path.points[0].body, muscle.path.points[0].location)[0]
        assert drawn[0] == pytest.approx(1e3 * origin, abs=0.5)
    waist = points_in_ground(state, model.body_index(suit.waist.body), suit.waist.location)[0]
    assert lines["cord"][0] == pytest.approx(1e3 * waist, abs=0.5)
    assert len(lines["cord"]) == 3
    assert BodyDrawing(model, None).lines(q.tolist())["cord"] == []


def test_a_model_sent_as_an_opensim_file_is_drawn_alike() -> None:
    model = bundled_model()
    osim = ElementTree.tostring(osim_document(model), encoding="unicode")
    q = model.default_coordinates.tolist()
    sent, own = (BodyDrawing(one, None).lines(q) for one in (read_model(osim), read_model("")))
    for name in ("bones", "muscles"):
        assert len(sent[name]) == len(own[name])
    for one, other in zip(sent["muscles"], own["muscles"], strict=True):
        assert np.array(one) == pytest.approx(np.array(other), abs=1.0)
