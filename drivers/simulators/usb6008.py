"""The instrument behind the NI server: a USB-6008's converter, crystal and buffer, sampling one World.

Does not imitate: single-ended inputs, on-demand and finite acquisition, digital lines, counter and analog outputs,
input impedance, settling and crosstalk between channels, delays of the USB bus, the restart of an aborted task.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.faults import Faults
from drivers.simulators.settings import DaqClock

Array = NDArray[np.float64]
Signal = Callable[[Array], Array]  # world seconds → volts

RANGES_V = (1.0, 1.25, 2.0, 2.5, 4.0, 5.0, 10.0, 20.0)  # differential, one per gain of its amplifier
CODES = 4096  # 12 bit, differential
NOISE_OF_RANGE = 0.25e-3  # V rms per V of range: 5 mV at ±20 V, half a code
DIFFERENTIAL_INPUTS = 4
HIGHEST_RATE_HZ = 10_000.0  # of all channels together
CONVERSION_S = 1 / HIGHEST_RATE_HZ  # one converter behind a multiplexer: the next channel comes this much later
TRIGGER_V = 2.5
TRIGGER_GRID_S = 1e-4  # how finely the trigger line is watched
LONGEST_SLEEP_S = 0.02  # wall, while waiting for samples
NEARLY_FULL = 0.8  # of the buffer

# The faults of the "ni" device, as NI words them.
OVERWRITTEN = {
    "overrun": (
        -200279,
        "The application is not able to keep up with the hardware acquisition: samples were overwritten before they "
        "were read.",
    ),
    "fifo_overflow": (-200361, "Onboard device memory overflow: the USB bus did not take the samples in time."),
}
DEADLY = {
    "unplug": (-200045, "Device was removed or is not present, and the task was aborted."),
    "transfer_aborted": (-50405, "No transfer is in progress because the transfer was aborted by the client."),
}
ABORTED = (-88709, "The task was aborted: its device was reset.")
REFUSALS = {
    "refuse": (-50103, "The specified resource is reserved. The operation could not be completed as specified."),
    "transfer_aborted": DEADLY["transfer_aborted"],
}


class ElectricalWorld(Protocol):
    """What an analog input can see of the World: its voltages, at any moment up to now (world seconds)."""

    faults: Faults

    @property
    def speed(self) -> float | None: ...
    def now(self) -> float: ...
    def amplifier_voltage(self, t: Array) -> Array: ...
    def sync_voltage(self, t: Array) -> Array: ...


class DaqmxError(Exception):
    """An NI-DAQmx error code and its sentence."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


@dataclass(frozen=True)
class Crystal:
    """The device's clock against the world's: fast by offset_ppm, and drifting."""

    offset_ppm: float
    drift_ppm_per_hour: float

    def gain(self, start: float, elapsed: float | Array) -> float | Array:
        """Seconds the crystal is ahead, elapsed seconds after the world's start."""
        drift = self.drift_ppm_per_hour / 3600
        return 1e-6 * ((self.offset_ppm + drift * start) * elapsed + drift * elapsed**2 / 2)


@dataclass(frozen=True)
class Input:
    """One differential channel of a task."""

    name: str
    range_v: float
    signal: Signal
    random: np.random.Generator

    def convert(self, t: Array) -> Array:
        """Volts as the driver scales them: noise added, clipped, rounded to a code."""
        step = 2 * self.range_v / CODES
        volts = self.signal(t) + self.random.normal(0.0, NOISE_OF_RANGE * self.range_v, t.size)
        codes: Array = np.clip(np.rint(volts / step), -CODES // 2, CODES // 2 - 1)
        return codes * step


class Usb6008:
    """The device: its channels' wiring and the one task that may run at a time."""

    serial_number = 0x01C0FFEE

    def __init__(
        self, world: ElectricalWorld, *, name: str, force_channel: str, sync_channel: str, clock: DaqClock, seed: int
    ) -> None:
        self.world = world
        self.name = name
        self.crystal = Crystal(clock.offset_ppm, clock.drift_ppm_per_hour)
        self._wiring = {force_channel: world.amplifier_voltage, sync_channel: world.sync_voltage}
        self._seeds = np.random.SeedSequence(seed)
        self._lock = threading.RLock()  # taken before a task's own, never after
        self._running: AcquisitionTask | None = None

    @property
    def running(self) -> AcquisitionTask | None:
        """The task that runs or waits for its trigger."""
        return self._running

    @property
    def is_plugged_in(self) -> bool:
        return self.world.faults.active("ni", "unplug") is None

    def ensure_known(self, name: str) -> None:
        """Raises the error of a device that is not there."""
        if name.lower() != self.name.lower() or not self.is_plugged_in:
            raise DaqmxError(-200220, f"Device identifier is invalid.\n\nDevice Specified: {name}")

    def input(self, physical_channel: str, lowest_v: float, highest_v: float) -> Input:
        device, _, channel = physical_channel.strip().partition("/")
        self.ensure_known(device)
        if channel not in {f"ai{number}" for number in range(DIFFERENTIAL_INPUTS)}:
            raise DaqmxError(
                -200170, f"Physical channel specified does not exist on this device.\n\nPhysical Channel: {channel}"
            )
        reach = max(abs(lowest_v), abs(highest_v))
        if not lowest_v < highest_v or reach > RANGES_V[-1]:
            raise DaqmxError(
                -200077,
                "Requested value is not a supported value for this property.\n\nProperty: AI.Max\n"
                f"Requested Value: {highest_v:g}\nMaximum Value: {RANGES_V[-1]:g}",
            )
        range_v = next(limit for limit in RANGES_V if limit >= reach)
        random = np.random.default_rng(self._seeds.spawn(1)[0])
        return Input(physical_channel, range_v, self._wiring.get(channel, np.zeros_like), random)

    def reserve(self, task: AcquisitionTask) -> None:
        """Makes it the running task. Raises where another one runs, also one whose client is dead."""
        with self._lock:
            other = self._running
            if other is task:
                return
            self.ensure_known(self.name)
            for kind, (code, text) in REFUSALS.items():
                if self.world.faults.active("ni", kind):
                    raise DaqmxError(code, text)
            if other is not None:
                raise DaqmxError(
                    -200022,
                    "Resource requested by this task has already been reserved by a different task.\n\n"
                    f"Device: {self.name}",
                )
            self._running = task

    def release(self, task: AcquisitionTask) -> None:
        with self._lock:
            if self._running is task:
                self._running = None

    def reset(self) -> None:
        """Aborts the running task, whoever started it."""
        with self._lock:
            if self._running is not None:
                self._running.abort()

    @property
    def is_streaming(self) -> bool:
        """Whether a task runs, or waits for its trigger."""
        return self._running is not None


class AcquisitionTask:
    """A continuous, clocked acquisition. Nothing is stored: a sample is what the World was at its moment."""

    def __init__(self, device: Usb6008, name: str) -> None:
        self.name = name
        self.inputs: list[Input] = []
        self.rate_hz = 0.0
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
            return self.acquired() - self._position > NEARLY_FULL * self.buffer_size

    @property
    def is_running(self) -> bool:
        """Whether it was started and not stopped; a task that waits for its trigger is running."""
        return self._watched_until is not None

    @property
    def position(self) -> int:
        """Samples per channel that were read since the start."""
        return self._position

    def abort(self) -> None:
        """Stops it for good, as a reset of its device does."""
        self._was_aborted = True
        self.stop()

    def ensure_alive(self) -> None:
        """Raises what a task says for ever once its device was taken from under it."""
        if self._was_aborted:
            raise DaqmxError(*ABORTED)
        for kind, (code, text) in DEADLY.items():
            if self._device.world.faults.has_begun("ni", kind, since=self._made_at):
                raise DaqmxError(code, text)

    def set_clock(self, rate_hz: float, samples_per_channel: int) -> None:
        self.rate_hz = rate_hz
        self.buffer_size = max(default_buffer_size(rate_hz), samples_per_channel)

    def start(self) -> None:
        highest = HIGHEST_RATE_HZ / max(1, len(self.inputs))
        if not 0 < self.rate_hz <= highest:
            raise DaqmxError(
                -200077,
                "Requested value is not a supported value for this property.\n\nProperty: SampClk.Rate\n"
                f"Requested Value: {self.rate_hz:g}\nMaximum Value: {highest:g}",
            )
        self._device.reserve(self)
        with self._changed:
            if self._watched_until is not None:
                return
            now = self._device.world.now()
            self._watched_until = now
            self._started_at = None if self.waits_for_trigger else now
            self._position = 0

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
            return int(ticks * self.rate_hz) + 1

    def available(self) -> int:
        """Samples per channel in the buffer. Raises the overrun once unread ones were overwritten."""
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
        """Whether so many samples per channel were acquired within the timeout (wall; negative waits for ever)."""
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while (missing := count - self.acquired()) > 0:
                self.ensure_alive()
                left_s = deadline_s - time.monotonic() if timeout_s >= 0 else LONGEST_SLEEP_S
                if left_s <= 0 or self._watched_until is None:
                    return False
                due_s = missing / self.rate_hz / (self._device.world.speed or math.inf)
                self._changed.wait(min(left_s, max(due_s, 1e-3), LONGEST_SLEEP_S))
            return True

    def read(self, count: int, timeout_s: float) -> Array:
        """(channels, n) volts, n = count unless the timeout (wall) came first."""
        self.start()
        with self._changed:
            self.available()
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
    """The samples per channel that NI-DAQmx buffers unless asked for more."""
    return 1_000 if rate_hz <= 100 else 10_000 if rate_hz <= 10_000 else 100_000
