"""A task of the simulated USB-6008 that acquires voltages: on demand, a finite number, or without end.

Nothing is stored: a sample is the value of the World at its time.

Does not imitate: the time that a software-timed sample takes (a millisecond or so, by the USB bus).
"""

from __future__ import annotations

import math
import threading
import time
from typing import Literal

import numpy as np

from drivers.simulators.usb6008 import (
    ABORTED,
    CONVERSION_S,
    DEADLY,
    HIGHEST_RATE_HZ,
    LONGEST_SLEEP_S,
    NEARLY_FULL,
    OVERWRITTEN,
    TRIGGER_GRID_S,
    TRIGGER_V,
    Array,
    DaqmxError,
    Input,
    Usb6008,
)

PAST_THE_END = (
    -200278,
    "Attempted to read a sample beyond the final sample acquired. The acquisition has stopped, therefore the sample "
    "specified by the combination of position and offset will never be available.",
)
Mode = Literal["on_demand", "finite", "continuous"]


class AcquisitionTask:
    """Without a sample clock, a task samples when it is read."""

    def __init__(self, device: Usb6008, name: str) -> None:
        self.name = name
        self.inputs: list[Input] = []
        self.mode: Mode = "on_demand"
        self.rate_hz = 0.0
        self.length = 0  # samples per channel of a finite acquisition
        self.buffer_size = 0
        self.waits_for_trigger = False
        self._device = device
        self._made_at = device.world.now()
        self._changed = threading.Condition()
        self._watched_until: float | None = None  # world seconds; None while the task is stopped
        self._started_at: float | None = None  # world seconds of sample 0; None while the trigger is awaited
        self._position = 0
        self._was_aborted = False
        self.may_overrun = False

    @property
    def is_nearly_full(self) -> bool:
        """Whether the unread samples will soon be overwritten."""
        with self._changed:
            unread = self.acquired() - self._position if self.mode == "continuous" else 0
            return unread > NEARLY_FULL * self.buffer_size

    @property
    def is_running(self) -> bool:
        """Whether it was started and not stopped; a task that waits for its trigger is running."""
        return self._watched_until is not None

    @property
    def is_done(self) -> bool:
        """Whether a finite acquisition has all its samples; any other is done once it is stopped."""
        return not self.is_running or (self.mode == "finite" and self.acquired() >= self.length)

    @property
    def position(self) -> int:
        """Samples per channel that were read since the start."""
        return self._position

    def abort(self) -> None:
        """End the task, as a reset of its device does; it cannot be started again."""
        self._was_aborted = True
        self.stop()

    def ensure_alive(self) -> None:
        """Raises the error that a task returns for every call after its device was removed."""
        if self._was_aborted:
            raise DaqmxError(*ABORTED)
        for kind, (code, text) in DEADLY.items():
            if self._device.world.faults.has_begun("ni", kind, since=self._made_at):
                raise DaqmxError(code, text)

    def set_clock(self, rate_hz: float, samples_per_channel: int, *, is_finite: bool = False) -> None:
        """A finite acquisition has a buffer for all its samples; a continuous one at least NI's default."""
        self.mode = "finite" if is_finite else "continuous"
        self.rate_hz = rate_hz
        self.length = samples_per_channel if is_finite else 0
        self.buffer_size = self.length if is_finite else max(default_buffer_size(rate_hz), samples_per_channel)

    def start(self) -> None:
        self._ensure_rate()
        self._device.reserve(self)
        with self._changed:
            if self._watched_until is not None:
                return
            now = self._device.world.now()
            self._watched_until = now
            self._started_at = None if self.waits_for_trigger else now
            self._position = 0

    def _ensure_rate(self) -> None:
        if self.mode == "on_demand":
            return
        highest = HIGHEST_RATE_HZ / max(1, len(self.inputs))
        if not 0 < self.rate_hz <= highest:
            raise DaqmxError(
                -200077,
                "Requested value is not a supported value for this property.\n\nProperty: SampClk.Rate\n"
                f"Requested Value: {self.rate_hz:g}\nMaximum Value: {highest:g}",
            )

    def stop(self) -> None:
        with self._changed:
            self._watched_until = self._started_at = None
            self._changed.notify_all()
        self._device.release(self)

    def acquired(self) -> int:
        """Samples per channel since the start."""
        with self._changed:
            now = self._device.world.now()
            if self._started_at is None:
                self._watch_trigger(now)
            if self._started_at is None:
                return 0
            elapsed = now - self._started_at
            ticks = elapsed + self._device.crystal.gain(self._started_at, elapsed)
            count = int(ticks * self.rate_hz) + 1
            return min(count, self.length) if self.mode == "finite" else count

    def available(self) -> int:
        """Samples per channel in the buffer. Raises the overrun once unread ones were overwritten."""
        if self.mode == "on_demand":
            return 0
        with self._changed:
            available = self.acquired() - self._position
            if available > self.buffer_size:
                raise DaqmxError(*OVERWRITTEN["overrun"])
            for kind, (code, text) in OVERWRITTEN.items():
                started_at = self._started_at
                if started_at is not None and self._device.world.faults.has_begun("ni", kind, since=started_at):
                    raise DaqmxError(code, text)
            return available

    def wait_until_acquired(self, count: int, timeout_s: float) -> bool:
        """Whether this number of samples per channel was acquired within the time-out (wall; negative: no time-out)."""
        deadline_s = time.perf_counter() + timeout_s
        with self._changed:
            while (missing := count - self.acquired()) > 0:
                self.ensure_alive()
                left_s = deadline_s - time.perf_counter() if timeout_s >= 0 else LONGEST_SLEEP_S
                if left_s <= 0 or self._watched_until is None:
                    return False
                due_s = missing / self.rate_hz / (self._device.world.speed or math.inf)
                self._changed.wait(min(left_s, max(due_s, 1e-3), LONGEST_SLEEP_S))
            return True

    def default_read_count(self) -> int:
        """Meaning of "all available": on demand 1, of a finite acquisition the rest, else the samples in the buffer."""
        if self.mode == "continuous":
            return self.available()
        return self.length - (self._position if self.is_running else 0) if self.mode == "finite" else 1

    def read(self, count: int, timeout_s: float) -> Array:
        """(channels, n) volts, n = count unless the timeout (wall) came first.

        A task that is not running is started, and stopped again once it is done.
        """
        was_running = self.is_running
        self.start()
        volts = self._sample_now(count) if self.mode == "on_demand" else self._read_clocked(count, timeout_s)
        is_over = self.mode == "on_demand" or (self.mode == "finite" and self._position >= self.length)
        if is_over and not was_running:
            self.stop()
        return volts

    def _sample_now(self, count: int) -> Array:
        self.ensure_alive()
        times = np.full(count, self._device.world.now())
        return np.array([channel.convert(times) for channel in self.inputs])

    def _read_clocked(self, count: int, timeout_s: float) -> Array:
        with self._changed:
            self.available()
            if self.mode == "finite" and self._position + count > self.length:
                raise DaqmxError(*PAST_THE_END)
            self.wait_until_acquired(self._position + count, timeout_s)
            if self._started_at is None or (count := min(count, self.available())) <= 0:
                return np.empty((len(self.inputs), 0))
            seconds = np.arange(self._position, self._position + count) / self.rate_hz
            self._position += count
            times = self._started_at + seconds - self._device.crystal.gain(self._started_at, seconds)
            return np.array([channel.convert(times + turn * CONVERSION_S) for turn, channel in enumerate(self.inputs)])

    def _watch_trigger(self, now: float) -> None:
        """Starts at the first rising edge of the sync line since it was last looked at."""
        if self._watched_until is None or now - self._watched_until < 2 * TRIGGER_GRID_S:
            return
        times = np.arange(self._watched_until, now, TRIGGER_GRID_S)
        is_high = self._device.world.sync_voltage(times) > TRIGGER_V
        edges = np.flatnonzero(~is_high[:-1] & is_high[1:])
        self._started_at = float(times[edges[0] + 1]) if edges.size else None
        self._watched_until = float(times[-1])


def default_buffer_size(rate_hz: float) -> int:
    """Default buffer size of NI-DAQmx in samples per channel."""
    return 1_000 if rate_hz <= 100 else 10_000 if rate_hz <= 10_000 else 100_000
