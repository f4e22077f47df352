"""Interfaces of a device, simulated or real.

The clock of a device has bounds: a sample is not taken after it arrived.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from recordings.samples import DeviceIdentity, Item, Stream

HostClock = Callable[[], int]
"""Returns UTC in nanoseconds; the station's clock, given to a driver when it is made."""
TOLERANCE_S = 1.0
"""By which a reading may lie ahead of the earlier ones. The first samples of a device may have waited for so long."""


class Device(Protocol):
    """One instrument on one wire. One thread uses it at a time; the recorder owns that thread and its watchdog.

    A driver numbers and time-stamps samples on arrival. It never aligns, filters, tares or converts them, and it
    raises only the exceptions of drivers/errors.py.
    """

    @property
    def name(self) -> str:
        """The device as errors and tables name it: "NI Dev1", "QTM 127.0.0.1:22223"."""
        ...

    def open(self) -> None:
        """Connect, configure and start streaming. Raises DeviceError in one sentence."""
        ...

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The streams of the device; complete once open() has returned."""
        ...

    @property
    def identity(self) -> DeviceIdentity:
        """Product, serial number and whether it is simulated, as reported by the device; complete after open()."""
        ...

    def read(self, timeout_s: float) -> Sequence[Item]:
        """All items received since the last call, in order. Waits at most timeout_s [wall s] for the first one.

        A timeout of 0 also returns samples that the driver would otherwise collect into larger blocks.
        Raises DeviceLost when the device is gone; items received before that were returned by earlier calls.
        """
        ...

    def close(self) -> None:
        """Stop and release the device. May be called at any time, twice, and after a loss."""
        ...


@runtime_checkable
class CaptureControl(Protocol):
    """A device that can start the experiment's common capture itself (QTM with mocap.control = "start")."""

    def start_capture(self) -> None: ...

    def stop_capture(self) -> None: ...


@dataclass(frozen=True)
class Received:
    """Progress of a connection: its local TCP port, and the number of bytes that the driver has decoded."""

    port: int
    size: int


@runtime_checkable
class StreamingDevice(Protocol):
    """A device that sends unrequested data, so that only the driver knows how much of it is decoded."""

    @property
    def received(self) -> Received | None:
        """None without a connection, and for a connection other than TCP."""
        ...


@runtime_checkable
class Resumable(Protocol):
    """A device that can be reconnected during a trial."""

    def resume(self) -> None:
        """Reconnect after read() raised DeviceLost; the streams do not change. May be repeated until it succeeds.

        Does not wait for a past trigger and does not start a capture. Sample numbers continue: samples without a number
        of the device are counted by the host's clock, and the jump of the numbers is the loss. Raises DeviceError.
        """
        ...


class DeviceClock:
    """Compares readings of a device's clock [s] with the times of their arrival [ns] on the host's clock.

    A jump ahead of the host's clock is one of the device's clock. No time has passed then, so no sample was lost.
    """

    def __init__(self) -> None:
        self._ahead_s: float | None = None  # most that a reading was ahead of its arrival; negative for a delay

    def is_possible(self, reading_s: float, host_time_ns: int) -> bool:
        """Whether so much time can have passed for the device."""
        return self._ahead_s is None or reading_s - host_time_ns * 1e-9 <= self._ahead_s + TOLERANCE_S

    def add(self, reading_s: float, host_time_ns: int) -> None:
        ahead_s = reading_s - host_time_ns * 1e-9
        self._ahead_s = ahead_s if self._ahead_s is None else max(self._ahead_s, ahead_s)

    def restart(self) -> None:
        """The device's clock was set."""
        self._ahead_s = None
