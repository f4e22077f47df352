"""What every device does, simulated or real."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from recordings.samples import DeviceIdentity, Item, Stream

HostClock = Callable[[], int]
"""Returns UTC in nanoseconds; the station's clock, given to a driver when it is made."""


class Device(Protocol):
    """One instrument on one wire. One thread uses it at a time; the daemon owns that thread and its watchdog.

    A driver numbers and stamps samples as they come. It never aligns, filters, tares or converts them,
    and it raises nothing but the exceptions of drivers/errors.py.
    """

    @property
    def name(self) -> str:
        """The device as errors and tables name it: "NI Dev1", "QTM 127.0.0.1:22223"."""
        ...

    def open(self) -> None:
        """Connects, configures and starts the flow of samples. Raises DeviceError in one sentence."""
        ...

    @property
    def streams(self) -> tuple[Stream, ...]:
        """What it sends; known once open() returned."""
        ...

    @property
    def identity(self) -> DeviceIdentity:
        """What it says of itself, also about being simulated; known once open() returned."""
        ...

    def read(self, timeout_s: float) -> Sequence[Item]:
        """Everything that came, in order; waits at most timeout_s (wall seconds) for the first of it, then returns [].

        With a timeout of 0 also what a driver would keep for a moment, to hand it over in larger blocks.
        Raises DeviceLost when the device is gone; what came before was returned by earlier calls.
        """
        ...

    def close(self) -> None:
        """Stops and releases the device; may be called at any time, twice, and after a loss."""
        ...


@runtime_checkable
class CaptureControl(Protocol):
    """A device that can start the experiment's common capture itself (QTM with mocap.control = "start")."""

    def start_capture(self) -> None: ...

    def stop_capture(self) -> None: ...


@dataclass(frozen=True)
class Received:
    """What has come over a connection since it began: its local TCP port, and the bytes that the driver has decoded."""

    port: int
    size: int


@runtime_checkable
class StreamingDevice(Protocol):
    """A device that sends without being asked, so that only the driver can tell how far it has got."""

    @property
    def received(self) -> Received | None:
        """None while there is no connection, or where it is no TCP connection."""
        ...


@runtime_checkable
class Resumable(Protocol):
    """A device that can be brought back in the middle of a trial."""

    def resume(self) -> None:
        """Opens again after read() raised DeviceLost; streams stay as they are. May be tried until it works.

        Waits for no trigger that has been, begins no capture. Samples are numbered on: what nobody numbered meanwhile
        counts by the host's clock; the jump of the numbers is the loss. Raises DeviceError in one sentence.
        """
        ...
