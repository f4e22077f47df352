"""Devices for tests of the station: scripted, without a wire, held to the same protocol as the real ones."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from types import SimpleNamespace

import numpy as np

from drivers.errors import DeviceError, DeviceLost
from recordings.samples import DeviceIdentity, Event, Item, Samples, Stream
from station.bench.view import Snapshot
from station.clock import Clock


class FakeDaq:
    """Force and sync at 1 kHz of station time; the sync line follows `capture`."""

    def __init__(self, clock: Clock, capture: FakeCapture, fails: DeviceError | None = None) -> None:
        self.name = "NI Fake1"
        self.streams = tuple(Stream(n, "V", (n[1:],), 1000.0, self.name) for n in ("/force", "/sync"))
        self.identity = DeviceIdentity(self.name, "", None)
        self.is_open = False
        self.hangs_on_read = False
        self.lost_after: int | None = None
        self._clock, self._capture, self._fails, self._sent = clock, capture, fails, 0

    def open(self) -> None:
        if self._fails:
            raise self._fails
        self.is_open, self._start_s, self._sent = True, self._clock.station_s(), 0

    def read(self, timeout_s: float) -> Sequence[Item]:
        if self.hangs_on_read:
            threading.Event().wait()
        _pause(timeout_s)
        now = self._clock.station_s()
        due = int((now - self._start_s) * 1000)
        if self.lost_after is not None and due > self.lost_after:
            raise DeviceLost(f"{self.name} is gone: unplugged")
        numbers = np.arange(self._sent, due, dtype=np.uint64)
        self._sent = max(due, self._sent)
        if not len(numbers):
            return []
        times_s = self._start_s + numbers.astype(float) / 1000
        device_ns = numbers.astype(np.int64) * 1_000_000
        sync = 5.0 * self._capture.is_on_at(times_s)
        force = np.sin(times_s)
        return [
            Samples(name, numbers, device_ns, self._clock.utc_ns(), values[:, None])
            for name, values in (("/force", force), ("/sync", sync))
        ]

    def close(self) -> None:
        self.is_open = False


class FakeCapture:
    """When the mocap system captures, in station seconds after the arming."""

    def __init__(self, clock: Clock, delay_s: float, length_s: float) -> None:
        self._start_s = clock.station_s() + delay_s
        self._end_s = self._start_s + length_s

    def is_on_at(self, times_s: np.ndarray) -> np.ndarray:
        return (times_s >= self._start_s) & (times_s < self._end_s)

    def frames_due(self, now_s: float) -> int:
        return int(max(0.0, min(now_s, self._end_s) - self._start_s) * 100)

    def has_ended(self, now_s: float) -> bool:
        return now_s >= self._end_s


class FakeMocap:
    def __init__(self, clock: Clock, capture: FakeCapture, labels: tuple[str, ...] = ("anchor_1", "cuff_1")) -> None:
        self.name = "QTM fake"
        self.streams = (Stream("/markers", "mm", labels, 100.0, self.name),)
        self.identity = DeviceIdentity(self.name, "", None)
        self._clock, self._capture, self._sent, self._reported = clock, capture, 0, 0

    def open(self) -> None:
        self._sent = self._reported = 0

    def read(self, timeout_s: float) -> Sequence[Item]:
        _pause(timeout_s)
        now = self._clock.station_s()
        items: list[Item] = []
        due = self._capture.frames_due(now)
        if due and not self._reported:
            self._reported = 1
            items.append(Event("capture_started", "capture started", self._clock.utc_ns(), self.name))
        if due > self._sent:
            numbers = np.arange(self._sent + 1, due + 1, dtype=np.uint64)
            values = np.ones((len(numbers), len(self.streams[0].labels), 4), dtype=np.float32)
            times = (numbers.astype(np.int64) - 1) * 10_000_000
            items.append(Samples("/markers", numbers, times, self._clock.utc_ns(), values))
            self._sent = due
        if self._capture.has_ended(now) and self._reported == 1:
            self._reported = 2
            items.append(Event("capture_stopped", "capture stopped", self._clock.utc_ns(), self.name))
        return items

    def close(self) -> None:
        pass


def view(show: Callable[[Snapshot], None]) -> SimpleNamespace:
    """A view of a recorder that looks at states only."""
    return SimpleNamespace(offer=lambda _: None, show=show)


def _pause(timeout_s: float) -> None:
    """Wait for samples while time passes by itself; a stepped clock does not wait."""
    time.sleep(min(timeout_s, 0.005))
