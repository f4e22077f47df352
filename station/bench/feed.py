"""One thread per device: opens it, reads it, passes on its samples and events, and closes it."""

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
"""Messages that may wait for the recorder: half a minute at twenty per second from each of three devices."""


@dataclass(frozen=True)
class DeviceOpened:
    device: str
    streams: tuple[Stream, ...]
    identity: DeviceIdentity


@dataclass(frozen=True)
class ItemsReceived:
    device: str
    items: Sequence[Item]


@dataclass(frozen=True)
class DeviceFailed:
    device: str
    error: DeviceError


FeedMessage = DeviceOpened | ItemsReceived | DeviceFailed


class FeedQueue(Queue[FeedMessage]):
    """Bounded queue of messages from the feeds to the recorder.

    While it is full the devices are not read: samples wait in the drivers, which count what they cannot hold.
    """

    def __init__(self) -> None:
        super().__init__(MOST_WAITING)


class DeviceFeed:
    """Owns the only thread that uses a device, so that a call that never returns blocks no other device.

    The thread is a daemon thread: a device that hangs is abandoned when the process ends.
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
        """Ask the device to start or stop the common capture; its own thread does so between two reads."""
        device = self.device
        if isinstance(device, CaptureControl):
            self._requests.put(device.start_capture if start else device.stop_capture)

    def ask_to_stop(self) -> None:
        self._stop.set()

    def has_ended(self, within_s: float) -> bool:
        """Whether the thread ends (device closed) within `within_s` wall seconds."""
        self._thread.join(within_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            self.device.open()
            self._deliver(DeviceOpened(self.device.name, self.device.streams, self.device.identity))
            self._serve()
            self._execute_requests()
        except DeviceError as error:
            self._deliver(DeviceFailed(self.device.name, error))
        except Exception as error:  # a bug in a driver must end the trial with a message, not hang it
            lost = DeviceLost(f"{self.device.name}: {type(error).__name__}: {error}")
            self._deliver(DeviceFailed(self.device.name, lost))
        finally:
            self._close()

    def _serve(self) -> None:
        """Read until asked to stop."""
        while not self._stop.is_set():
            self._execute_requests()
            items = self.device.read(READ_TIMEOUT_S)
            if items:
                self._deliver(ItemsReceived(self.device.name, items))

    def _deliver(self, message: FeedMessage) -> None:
        """Wait for space in the queue; if the feed is stopped meanwhile, drop the message."""
        while True:
            try:
                return self._inbox.put(message, timeout=READ_TIMEOUT_S)
            except Full:
                if self._stop.is_set():
                    return None

    def _execute_requests(self) -> None:
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
            self._deliver(DeviceFailed(self.device.name, error))


class Feeds:
    """The devices of one trial, read as fast as they deliver."""

    def __init__(self, devices: Sequence[Device]) -> None:
        self._inbox = FeedQueue()
        self.feeds = [DeviceFeed(device, self._inbox) for device in devices]

    def start(self) -> None:
        for feed in self.feeds:
            feed.start()

    def poll(self) -> list[FeedMessage]:
        """Messages that arrive while the devices open."""
        return self.receive()

    def receive(self) -> list[FeedMessage]:
        """All messages that have arrived; waits POLL_S for the first."""
        messages = []
        try:
            messages.append(self._inbox.get(timeout=POLL_S))
            while True:
                messages.append(self._inbox.get_nowait())
        except Empty:
            return messages

    def finish_requests(self) -> None:
        """Nothing to do: the devices execute their requests before they close."""

    def release(self, within_s: float) -> list[str]:
        """Close the devices; return the names of those that did not close within `within_s` wall seconds."""
        return end_feeds(self.feeds, within_s)


def end_feeds(feeds: Sequence[DeviceFeed], within_s: float, meanwhile: Callable[[], None] = lambda: None) -> list[str]:
    """Ask all feeds to stop and wait `within_s` wall seconds; return the names of devices that are still running."""
    for feed in feeds:
        feed.ask_to_stop()
    deadline = time.perf_counter() + within_s
    while not all(feed.has_ended(POLL_S) for feed in feeds) and time.perf_counter() < deadline:
        meanwhile()
    return [feed.device.name for feed in feeds if not feed.has_ended(0.0)]
