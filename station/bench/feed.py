"""One thread per device: opens it, reads it, passes on what comes, and closes it again."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from queue import Empty, Full, Queue, SimpleQueue

from drivers.device import CaptureControl, Device
from drivers.errors import DeviceError, DeviceLost
from recordings.samples import DeviceIdentity, Item, Stream

READ_TIMEOUT_S = 0.1
POLL_S = 0.02
MOST_WAITING = 2000
"""Messages that may wait for the daemon: at twenty a second from each of three devices half a minute."""


@dataclass(frozen=True)
class Opened:
    device: str
    streams: tuple[Stream, ...]
    identity: DeviceIdentity


@dataclass(frozen=True)
class Delivered:
    device: str
    items: Sequence[Item]


@dataclass(frozen=True)
class Gone:
    device: str
    error: DeviceError


Message = Opened | Delivered | Gone


class FeedQueue(Queue[Message]):
    """What the feeds have delivered and the daemon has not taken, of bounded length.

    While it is full the devices are not read: samples wait in the drivers, which count what they have no room for.
    """

    def __init__(self) -> None:
        super().__init__(MOST_WAITING)


class DeviceFeed:
    """Owns the only thread that touches a device, so that a call that never returns blocks nobody else.

    The thread is a daemon thread: a device that is frozen for ever is left behind when the process ends.
    """

    def __init__(self, device: Device, inbox: FeedQueue) -> None:
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

    def request_capture(self, *, start: bool) -> None:
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
            self._deliver(Opened(self.device.name, self.device.streams, self.device.identity))
            self._serve()
            self._carry_out_requests()
        except DeviceError as error:
            self._deliver(Gone(self.device.name, error))
        except Exception as error:  # a fault of the driver itself must end the trial in a sentence, not hang it
            self._deliver(Gone(self.device.name, DeviceLost(f"{self.device.name}: {type(error).__name__}: {error}")))
        finally:
            self._close()

    def _serve(self) -> None:
        """Reads until it is asked to stop."""
        while not self._stop.is_set():
            self._carry_out_requests()
            items = self.device.read(READ_TIMEOUT_S)
            if items:
                self._deliver(Delivered(self.device.name, items))

    def _deliver(self, message: Message) -> None:
        """Waits for room; when the feed is stopped and the inbox is full, the message is dropped."""
        while True:
            try:
                return self._inbox.put(message, timeout=READ_TIMEOUT_S)
            except Full:
                if self._stop.is_set():
                    return None

    def _carry_out_requests(self) -> None:
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
            self._deliver(Gone(self.device.name, error))


class Feeds:
    """The devices of one trial, each read as fast as it delivers."""

    def __init__(self, devices: Sequence[Device]) -> None:
        self._inbox = FeedQueue()
        self.feeds = [DeviceFeed(device, self._inbox) for device in devices]

    def start(self) -> None:
        for feed in self.feeds:
            feed.start()

    def poll(self) -> list[Message]:
        """What came while the devices open."""
        return self.take()

    def take(self) -> list[Message]:
        """Everything that has come; waits a moment for the first of it."""
        messages = []
        try:
            messages.append(self._inbox.get(timeout=POLL_S))
            while True:
                messages.append(self._inbox.get_nowait())
        except Empty:
            return messages

    def finish_requests(self) -> None:
        """Nothing to do: the devices carry out what they were asked while they are closed."""

    def release(self, within_s: float) -> list[str]:
        """Closes the devices; returns the names of those that did not close within `within_s` wall seconds."""
        return end_feeds(self.feeds, within_s)


def end_feeds(feeds: Sequence[DeviceFeed], within_s: float, meanwhile: Callable[[], None] = lambda: None) -> list[str]:
    """Asks all to stop and waits `within_s` wall seconds; returns the names of devices that are still running."""
    for feed in feeds:
        feed.ask_to_stop()
    deadline = time.monotonic() + within_s
    while not all(feed.has_ended(POLL_S) for feed in feeds) and time.monotonic() < deadline:
        meanwhile()
    return [feed.device.name for feed in feeds if not feed.has_ended(0.0)]
