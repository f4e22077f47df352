"""One thread per device: opens it, reads it, passes on what comes, and closes it again."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from queue import Empty, Full, Queue, SimpleQueue

from drivers.device import CaptureControl, Device
from drivers.errors import DeviceError, DeviceLost
from recordings.samples import Item, Stream

READ_TIMEOUT_S = 0.1
MOST_WAITING = 2000
"""Messages that may wait for the daemon: at twenty a second from each of three devices half a minute."""


@dataclass(frozen=True)
class Opened:
    device: str
    streams: tuple[Stream, ...]


@dataclass(frozen=True)
class Delivered:
    device: str
    items: Sequence[Item]


@dataclass(frozen=True)
class Gone:
    device: str
    error: DeviceError


Message = Opened | Delivered | Gone


class Inbox(Queue[Message]):
    """What the feeds have delivered and the daemon has not taken, of bounded length.

    While it is full the devices are not read: samples wait in the drivers, which count what they have no room for.
    """

    def __init__(self) -> None:
        super().__init__(MOST_WAITING)


class DeviceFeed:
    """Owns the only thread that touches a device, so that a call that never returns blocks nobody else.

    The thread is a daemon thread: a device that is frozen for ever is left behind when the process ends.
    """

    def __init__(self, device: Device, inbox: Inbox) -> None:
        self.device = device
        self._inbox = inbox
        self._stop = threading.Event()
        self._requests: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=f"feed {device.name}", daemon=True)

    @property
    def can_control_capture(self) -> bool:
        return isinstance(self.device, CaptureControl)

    def start(self) -> None:
        self._thread.start()

    def request_capture(self, start: bool) -> None:
        """Asks the device to start or stop the common capture; done by its own thread between two reads."""
        device = self.device
        if isinstance(device, CaptureControl):
            self._requests.put(device.start_capture if start else device.stop_capture)

    def ask_to_stop(self) -> None:
        self._stop.set()

    def has_ended(self, within_s: float) -> bool:
        """Whether the thread ended (device closed) within so many wall seconds."""
        self._thread.join(within_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            self.device.open()
            self._tell(Opened(self.device.name, self.device.streams))
            while not self._stop.is_set():
                self._obey()
                items = self.device.read(READ_TIMEOUT_S)
                if items:
                    self._tell(Delivered(self.device.name, items))
            self._obey()
        except DeviceError as error:
            self._tell(Gone(self.device.name, error))
        except Exception as error:  # a fault of the driver itself must end the trial in a sentence, not hang it
            self._tell(Gone(self.device.name, DeviceLost(f"{self.device.name}: {type(error).__name__}: {error}")))
        finally:
            self._close()

    def _tell(self, message: Message) -> None:
        """Waits for room; where nobody listens any more, nobody is told."""
        while True:
            try:
                return self._inbox.put(message, timeout=READ_TIMEOUT_S)
            except Full:
                if self._stop.is_set():
                    return None

    def _obey(self) -> None:
        while True:
            try:
                request = self._requests.get_nowait()
            except Empty:
                return
            request()

    def _close(self) -> None:
        try:
            self.device.close()
        except DeviceError as error:
            self._tell(Gone(self.device.name, error))
