"""Live values on their way to the pages: one subscription, common rest length, and what remains when they stop."""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from unittest.mock import Mock
from xml.etree import ElementTree

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.multibody.postures import points_in_ground, postures
from solver.osim.model_writer import osim_document
from solver.suit.suit import read_suit
from station.console.body_drawing import BodyDrawing
from station.console.live_feed import COMMAND_TIMEOUT_S, LiveFeed
from station.live.published import LiveSetup, LiveSubject
from station.sources import read_model
from tests.station.console.live_source import LiveSource, live_setup
from tests.timeout import scaled_timeout

pytestmark = pytest.mark.anyio


async def polled(feed: LiveFeed, is_met: Callable[[], bool]) -> None:
    async with asyncio.timeout(scaled_timeout(60.0)):
        while not is_met():
            await feed.poll()
            await asyncio.sleep(0.005)


@asynccontextmanager
async def followed(
    source_folder: Path,
    setup: LiveSetup | None = None,
    *,
    shown: Callable[[], Path | None] | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> AsyncIterator[tuple[LiveFeed, LiveSource]]:
    """The feed of the folder that is shown, and a live process in source_folder to which it is connected."""
    feed = LiveFeed(shown or (lambda: source_folder), clock)
    try:
        with LiveSource(source_folder, setup or live_setup()) as source:
            await polled(feed, lambda: feed.setup is not None and source.views == 1)
            yield feed, source
    finally:
        feed.close()


async def test_a_page_opened_in_the_middle_has_the_curves_so_far(tmp_path: Path) -> None:
    async with followed(tmp_path) as (feed, source):
        sent = [source.publish() for _ in range(5)]
        await polled(feed, lambda: feed.points == 5)
        assert feed.values == sent[-1]
        assert [point.time_s for point in feed.history] == [one.time_s for one in sent]
        assert [point.cord_force_n for point in feed.history] == [one.scenarios[1].cord_force_n for one in sent]
        assert feed.drawing is not None and feed.suit is not None


async def test_a_rest_length_is_common_at_once_and_solved_from_the_next_frame_on(tmp_path: Path) -> None:
    async with followed(tmp_path) as (feed, source):
        assert feed.rest_length_m == 0.70
        feed.set_rest_length(0.755)
        assert feed.rest_length_m == 0.755
        await polled(feed, lambda: len(source.rest_lengths) == 2)
        assert source.rest_lengths == [("worn", 0.755), ("rigid", 0.755)], "what is compared has the same cord"
        source.publish()
        await polled(feed, lambda: feed.points == 1)
        slack, *others = feed.scenarios
        assert slack.name == "slack" and math.isnan(slack.rest_length_m)
        assert {one.name: one.rest_length_m for one in others} == {"worn": 0.755, "rigid": 0.755, "0.680 m": 0.68}
        assert feed.rest_length_m == 0.755


async def test_a_rest_length_that_is_not_applied_is_not_shown_for_long(tmp_path: Path) -> None:
    clock = Mock(return_value=100.0)
    async with followed(tmp_path, clock=clock) as (feed, _):
        feed.set_rest_length(0.755)
        await feed.poll()
        assert feed.rest_length_m == 0.755
        clock.return_value += COMMAND_TIMEOUT_S + 0.1
        await feed.poll()
        assert feed.rest_length_m == 0.70


async def test_values_remain_while_there_are_no_new_ones_and_after_the_end(tmp_path: Path) -> None:
    """The page shows their age."""
    async with followed(tmp_path) as (feed, source):
        last = source.publish()
        source.publish_nothing()
        await polled(feed, lambda: feed.latest is not None and feed.latest.values is None)
        assert feed.values == last
        source.__exit__(None, None, None)
        await polled(feed, lambda: feed.is_over)
        assert feed.values == last


async def test_another_session_shows_nothing_of_the_one_before(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir(), second.mkdir()
    open_folder = first
    async with followed(first, shown=lambda: open_folder) as (feed, source):
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


async def test_without_fitted_cuffs_the_rigid_suit_is_the_one_worn(tmp_path: Path) -> None:
    setup = live_setup(scenarios=tuple(one for one in live_setup().scenarios if one.condition != "both"))
    async with followed(tmp_path, setup) as (feed, source):
        feed.set_rest_length(0.755)
        await polled(feed, lambda: bool(source.rest_lengths))
        assert source.rest_lengths == [("rigid", 0.755)]


@pytest.mark.parametrize("scenarios", [(), live_setup().scenarios[:1]])
async def test_without_a_worn_suit_there_is_no_rest_length(tmp_path: Path, scenarios: tuple[Any, ...]) -> None:
    async with followed(tmp_path, live_setup(scenarios=scenarios)) as (feed, _):
        feed.set_rest_length(0.7)
        assert feed.worn is None and math.isnan(feed.rest_length_m)


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
