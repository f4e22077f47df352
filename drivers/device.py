"""Interfaces of a device, simulated or real."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from recordings.samples import DeviceIdentity, Item, Stream

HostClock = Callable[[], int]
"""Returns UTC in nanoseconds; the station's clock, given to a driver when it is made."""


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
