"""Flow control towards a browser: a fake one draws when the test says so."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable

import pytest

from station.console.running_view import UNDRAWN_UPDATES, UpdateSender

Run = Callable[[Callable[[], Awaitable[None]]], None]


class FakeBrowser:
    def __init__(self) -> None:
        self.sent = 0
        self._undrawn: deque[asyncio.Future[None]] = deque()

    async def draw(self) -> None:
        self.sent += 1
        self._undrawn.append(asyncio.get_running_loop().create_future())
        await self._undrawn[-1]

    async def has_drawn(self) -> None:
        self._undrawn.popleft().set_result(None)
        await turn()

    async def times_out(self) -> None:
        self._undrawn.popleft().set_exception(TimeoutError())
        await turn()


async def turn() -> None:
    """Every task of the event loop that can run has run."""
    for _ in range(5):
        await asyncio.sleep(0)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    def in_a_loop(work: Callable[[], Awaitable[None]]) -> None:
        async def whole() -> None:
            monkeypatch.setattr("nicegui.core.loop", asyncio.get_running_loop())
            await work()

        asyncio.run(whole())

    return in_a_loop


def test_every_tick_with_new_data_sends_one_update_to_a_browser_that_draws(run: Run) -> None:
    async def work() -> None:
        browser = FakeBrowser()
        sender = UpdateSender(browser.draw)
        for tick in range(1, 101):
            sender.tick(0.08 * tick)
            await turn()
            assert browser.sent == tick
            await browser.has_drawn()

    run(work)


def test_a_browser_that_does_not_draw_receives_no_further_updates_until_it_does(run: Run) -> None:
    async def work() -> None:
        browser = FakeBrowser()
        sender = UpdateSender(browser.draw)
        for tick in range(50):
            sender.tick(float(tick))  # without a turn: the count must not wait for the tasks
        await turn()
        assert browser.sent == UNDRAWN_UPDATES
        await browser.has_drawn()
        for tick in range(50, 100):
            sender.tick(float(tick))
        await turn()
        assert browser.sent == UNDRAWN_UPDATES + 1

    run(work)


def test_a_browser_that_timed_out_receives_updates_again(run: Run) -> None:
    async def work() -> None:
        browser = FakeBrowser()
        sender = UpdateSender(browser.draw)
        sender.tick(1.0)
        sender.tick(2.0)
        await turn()
        await browser.times_out()
        sender.tick(3.0)
        await turn()
        assert browser.sent == 3

    run(work)


def test_data_are_sent_once_and_no_data_not_at_all(run: Run) -> None:
    async def work() -> None:
        browser = FakeBrowser()
        sender = UpdateSender(browser.draw)
        for at in (None, 1.0, 1.0, 1.0):
            sender.tick(at)
            await turn()
        assert browser.sent == 1

    run(work)
