"""The instrument behind the NI server: a USB-6008's converter, crystal and buffer, sampling one World.

Does not imitate: single-ended inputs, digital lines, counter and analog outputs,
input impedance, settling and crosstalk between channels, delays of the USB bus, the restart of an aborted task.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Protocol

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
