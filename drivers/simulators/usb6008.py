"""The instrument behind the NI server: a USB-6008's converter, crystal and buffer, sampling one World, and its tasks.

A task acquires voltages: on demand, a finite number, or without end. Nothing is stored: a sample is the value of the
World at its time.

Does not imitate: single-ended inputs, digital lines, counter and analog outputs, input impedance, settling and
crosstalk between channels, delays of the USB bus, the time that a software-timed sample takes (a millisecond or so, by
the USB bus), the restart of an aborted task.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.simulators.faults import Faults
from drivers.simulators.settings import DaqClockSettings, EmgWire

Array = NDArray[np.float64]
Signal = Callable[[Array], Array]  # world seconds → volts

RANGES_V = (1.0, 1.25, 2.0, 2.5, 4.0, 5.0, 10.0, 20.0)  # differential, one per gain of its amplifier
CODES = 4096  # 12 bit, differential
NOISE_OF_RANGE = 0.25e-3  # V rms per V of range: 5 mV at ±20 V, half a code
DIFFERENTIAL_INPUTS = 4
HIGHEST_RATE_HZ = 10_000.0  # of all channels together
CONVERSION_S = 1 / HIGHEST_RATE_HZ  # one converter behind a multiplexer: delay from channel to channel
TRIGGER_V = 2.5
TRIGGER_GRID_S = 1e-4  # resolution of the trigger line
LONGEST_SLEEP_S = 0.02  # wall, while waiting for samples
NEARLY_FULL = 0.8  # of the buffer

# The faults of the "ni" device, with NI's error texts.
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
PAST_THE_END = (
    -200278,
    "Attempted to read a sample beyond the final sample acquired. The acquisition has stopped, therefore the sample "
    "specified by the combination of position and offset will never be available.",
)
Mode = Literal["on_demand", "finite", "continuous"]


class ElectricalWorld(Protocol):
    """Interface of the World to an analog input: voltages at any time up to now [world s]."""

    faults: Faults

    @property
    def speed(self) -> float | None: ...
    def now(self) -> float: ...
    def amplifier_voltage(self, t: Array) -> Array: ...
    def sync_voltage(self, t: Array) -> Array: ...
    def emg_voltage(self, channel: str, t: Array) -> Array: ...


class RunningTask(Protocol):
    """Interface of a task to the device that it reserved."""

    name: str
    may_overrun: bool

    @property
    def is_nearly_full(self) -> bool: ...
    def abort(self) -> None: ...


class DaqmxError(DeviceError):
    """An NI-DAQmx error code and its sentence."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.error_code = code


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
    """One differential channel of a task, for voltages from lowest_v to highest_v."""

    name: str
    lowest_v: float
    highest_v: float
    signal: Signal
    random: np.random.Generator

    @property
    def range_v(self) -> float:
        """The smallest range of the converter [± V] that covers the range of the task."""
        return next(limit for limit in RANGES_V if limit >= max(abs(self.lowest_v), abs(self.highest_v)))

    def spanning(self, lowest_v: float, highest_v: float) -> Input:
        """The same channel for other voltages. Raises DaqmxError where no range holds them."""
        ensure_range(lowest_v, highest_v)
        return replace(self, lowest_v=lowest_v, highest_v=highest_v)

    def convert(self, t: Array) -> Array:
        """Volts as scaled by the driver: noise added, clipped, rounded to a code."""
        step = 2 * self.range_v / CODES
        volts = self.signal(t) + self.random.normal(0.0, NOISE_OF_RANGE * self.range_v, t.size)
        codes: Array = np.clip(np.rint(volts / step), -CODES // 2, CODES // 2 - 1)
        return codes * step


def ensure_range(lowest_v: float, highest_v: float) -> None:
    """Raises DaqmxError where no range of the converter holds both."""
    if not lowest_v < highest_v or max(abs(lowest_v), abs(highest_v)) > RANGES_V[-1]:
        raise DaqmxError(
            -200077,
            "Requested value is not a supported value for this property.\n\nProperty: AI.Max\n"
            f"Requested Value: {highest_v:g}\nMaximum Value: {RANGES_V[-1]:g}",
        )


class Usb6008:
    """The device: its channels' wiring and the one task that may run at a time."""

    serial_number = 0x01C0FFEE

    def __init__(
        self,
        world: ElectricalWorld,
        *,
        name: str,
        force_channel: str,
        sync_channel: str,
        emg: Mapping[str, EmgWire] = MappingProxyType({}),
        clock: DaqClockSettings,
        seed: int,
    ) -> None:
        self.world = world
        self.name = name
        self.crystal = Crystal(clock.offset_ppm, clock.drift_ppm_per_hour)
        self._wiring = {force_channel: world.amplifier_voltage, sync_channel: world.sync_voltage}
        self._wiring |= {wire.input: partial(world.emg_voltage, name) for name, wire in emg.items()}
        self._seeds = np.random.SeedSequence(seed)
        self._lock = threading.RLock()  # taken before a task's own, never after
        self._running: RunningTask | None = None

    @property
    def running(self) -> RunningTask | None:
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
        ensure_range(lowest_v, highest_v)
        random = np.random.default_rng(self._seeds.spawn(1)[0])
        return Input(physical_channel, lowest_v, highest_v, self._wiring.get(channel, np.zeros_like), random)

    def reserve(self, task: RunningTask) -> None:
        """Run the task. Raises DaqmxError while another runs, also if the client of that one is dead."""
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

    def release(self, task: RunningTask) -> None:
        with self._lock:
            if self._running is task:
                self._running = None

    def reset(self) -> None:
        """Abort the running task of any client."""
        with self._lock:
            if self._running is not None:
                self._running.abort()

    @property
    def is_streaming(self) -> bool:
        """Whether a task runs, or waits for its trigger."""
        return self._running is not None


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
