from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from types import SimpleNamespace

import pytest

import station.bench.feed
from drivers.errors import DeviceLost, DeviceUnavailable
from recordings.samples import DeviceIdentity, Event, Item, Stream
from station.bench.feed import (
    ROUND_TIMEOUT_S,
    DeviceFailed,
    DeviceFeed,
    DeviceOpened,
    FeedQueue,
    ItemsReceived,
    SteppedFeed,
)
from tests.timeout import scaled_timeout


class Scripted:
    """A device that returns what the script says, one entry a read; an exception is raised."""

    name = "scripted"
    streams: tuple[Stream, ...] = ()
    identity = DeviceIdentity("scripted", "", None)

    def __init__(self, script: Sequence[Sequence[Item] | Exception], refuses: Exception | None = None) -> None:
        self._script, self._refuses = list(script), refuses
        self.closed = threading.Event()
        self.requests: list[str] = []

    def open(self) -> None:
        if self._refuses:
            raise self._refuses

    def read(self, timeout_s: float) -> Sequence[Item]:
        if not self._script:
            self.closed.wait(0.01)
            return []
        step = self._script.pop(0)
        if isinstance(step, Exception):
            raise step
        return step

    def start_capture(self) -> None:
        self.requests.append("start")

    def stop_capture(self) -> None:
        self.requests.append("stop")

    def close(self) -> None:
        self.closed.set()


def patience_s() -> float:
    """Bound on the wait for a message, which comes at once on an idle machine."""
    return scaled_timeout(30.0)


def test_the_items_of_a_device_arrive_in_order() -> None:
    events = [Event(str(i), "", i, "x") for i in range(3)]
    inbox = FeedQueue()
    feed = DeviceFeed(Scripted([[events[0]], [], events[1:]]), inbox)
    feed.start()
    assert inbox.get(timeout=patience_s()) == DeviceOpened("scripted", (), Scripted.identity)
    assert inbox.get(timeout=patience_s()) == ItemsReceived("scripted", [events[0]])
    assert inbox.get(timeout=patience_s()) == ItemsReceived("scripted", events[1:])
    feed.ask_to_stop()
    assert feed.has_ended(within_s=patience_s())


def test_a_device_that_does_not_open_or_is_lost_is_reported_and_closed() -> None:
    for device in (Scripted([], refuses=DeviceUnavailable("no")), Scripted([DeviceLost("gone")])):
        inbox = FeedQueue()
        feed = DeviceFeed(device, inbox)
        feed.start()
        message = inbox.get(timeout=patience_s())
        if isinstance(message, DeviceOpened):
            message = inbox.get(timeout=patience_s())
        assert isinstance(message, DeviceFailed)
        assert feed.has_ended(within_s=patience_s())
        assert device.closed.is_set()


def test_an_unexpected_error_of_a_driver_is_a_lost_device() -> None:
    inbox = FeedQueue()
    feed = DeviceFeed(Scripted([ZeroDivisionError("oops")]), inbox)
    feed.start()
    inbox.get(timeout=patience_s())
    message = inbox.get(timeout=patience_s())
    assert isinstance(message, DeviceFailed)
    assert "ZeroDivisionError: oops" in str(message.error)
    assert feed.has_ended(within_s=patience_s())


def test_capture_requests_are_done_by_the_device_s_own_thread_even_when_stopping() -> None:
    inbox = FeedQueue()
    device = Scripted([])
    feed = DeviceFeed(device, inbox)
    assert feed.can_control_capture
    feed.start()
    feed.request_capture(start=True)
    feed.request_capture(start=False)
    feed.ask_to_stop()
    assert feed.has_ended(within_s=patience_s())
    assert device.requests == ["start", "stop"]


def test_a_full_queue_pauses_the_device_without_a_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(station.bench.feed, "MOST_WAITING", 3)
    monkeypatch.setattr(station.bench.feed, "READ_TIMEOUT_S", 0.01)
    events = [Event(str(i), "", i, "x") for i in range(20)]
    device = Scripted([[event] for event in events])
    inbox = FeedQueue()
    feed = DeviceFeed(device, inbox)
    feed.start()
    while not inbox.full():
        device.closed.wait(0.001)
    assert len(device._script) >= 20 - 4
    taken = [inbox.get(timeout=patience_s()) for _ in range(21)]
    assert [message.items[0] for message in taken if isinstance(message, ItemsReceived)] == events
    feed.ask_to_stop()
    assert feed.has_ended(within_s=patience_s())


def test_a_feed_with_a_full_queue_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(station.bench.feed, "MOST_WAITING", 1)
    monkeypatch.setattr(station.bench.feed, "READ_TIMEOUT_S", 0.01)
    device = Scripted([[Event(str(i), "", i, "x")] for i in range(5)])
    feed = DeviceFeed(device, FeedQueue())
    feed.start()
    feed.ask_to_stop()
    assert feed.has_ended(within_s=patience_s())
    assert device.closed.is_set()


def test_a_device_that_does_not_finish_a_round_no_longer_delays_later_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    class Frozen(Scripted):
        def read(self, timeout_s: float) -> Sequence[Item]:
            self.closed.wait()
            return []

    now_s = [0.0]
    clock = SimpleNamespace(perf_counter=lambda: now_s[0], sleep=time.sleep)
    monkeypatch.setattr(station.bench.feed, "time", clock)
    device = Frozen([])
    feed = SteppedFeed(device)
    feed.start()
    feed.begin_round({})
    assert not feed.is_round_over(0.0)
    now_s[0] = 1.01 * ROUND_TIMEOUT_S
    assert feed.is_round_over(0.0)
    feed.begin_round({})
    assert feed.is_round_over(0.0)
    device.closed.set()
    feed.ask_to_stop()
    assert feed.has_ended(within_s=patience_s())
