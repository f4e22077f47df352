"""One thread per device: opens it, reads it, passes on its samples and events, and closes it.

On a stepped clock, devices are read in rounds: the clock advances one step, every device is read to its end, then the
station continues. Items of a step carry the time of its end, independent of the scheduling of threads on a busy
machine.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, Full, Queue, SimpleQueue
from typing import TypeVar

import numpy as np

from drivers.device import CaptureControl, Device, Received, StreamingDevice
from drivers.errors import DeviceError, DeviceLost
from recordings.samples import DeviceIdentity, Item, Samples, Stream
from station.clock import SteppedClock

READ_TIMEOUT_S = 0.1
POLL_S = 0.02
MOST_WAITING = 2000
"""Messages that may wait for the recorder: half a minute at twenty per second from each of three devices."""
ROUND_TIMEOUT_S = 60.0
"""Wall seconds after which time advances without a device that has not finished its round."""
PENDING_INTERVAL_S = 0.05
"""Wall seconds between two queries whether a device has a pending reply, which arrives only as time advances."""
OPENING_INTERVAL_S = 0.005
POLL_INTERVAL_S = 0.0005
"""Wall seconds between two reads of a connection with more data to come."""
Sent = Mapping[int, int | None]
T = TypeVar("T")


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
        for request in _drain(self._requests):
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
        try:
            return [self._inbox.get(timeout=POLL_S), *_drain(self._inbox)]
        except Empty:
            return []

    def finish_requests(self) -> None:
        """Do nothing: the devices execute their requests before they close."""

    def release(self, within_s: float) -> list[str]:
        """Close the devices; return the names of those that did not close within `within_s` wall seconds."""
        return end_feeds(self.feeds, within_s)


def _drain(queue: Queue[T] | SimpleQueue[T]) -> Iterator[T]:
    """Everything that waits."""
    with suppress(Empty):
        while True:
            yield queue.get_nowait()


def end_feeds(feeds: Sequence[DeviceFeed], within_s: float, meanwhile: Callable[[], None] = lambda: None) -> list[str]:
    """Ask all feeds to stop and wait `within_s` wall seconds; return the names of devices that are still running."""
    for feed in feeds:
        feed.ask_to_stop()
    deadline = time.perf_counter() + within_s
    while not all(feed.has_ended(POLL_S) for feed in feeds) and time.perf_counter() < deadline:
        meanwhile()
    return [feed.device.name for feed in feeds if not feed.has_ended(0.0)]


class SteppedFeed(DeviceFeed):
    """A feed whose thread reads the device once per round, up to the last byte that was sent in it."""

    def __init__(self, device: Device) -> None:
        self.inbox = FeedQueue()
        super().__init__(device, self.inbox)
        self._streaming = device if isinstance(device, StreamingDevice) else None  # the check is slow: once
        self._sent: Sent | None = {}
        self._has_round = threading.Event()
        self._is_idle = threading.Event()
        self._is_idle.set()
        self._latest_s = 0.0  # wall; until then the others wait for the round

    @property
    def received(self) -> Received | None:
        return None if self._streaming is None else self._streaming.received

    @property
    def has_requests(self) -> bool:
        return not self._requests.empty()

    def begin_round(self, sent: Sent | None) -> None:
        """Read everything that was sent; None: execute the requests, and read nothing.

        Without effect while the previous round is not over.
        """
        if self._is_idle.is_set():
            self._sent, self._latest_s = sent, time.perf_counter() + ROUND_TIMEOUT_S
            self._is_idle.clear()
            self._has_round.set()

    def is_round_over(self, within_s: float) -> bool:
        """Whether no other device has to wait: a round that has lasted ROUND_TIMEOUT_S no longer delays later ones."""
        is_over = self._is_idle.wait(within_s) or not self._thread.is_alive()
        return is_over or time.perf_counter() > self._latest_s

    def ask_to_stop(self) -> None:
        super().ask_to_stop()
        self._has_round.set()

    def collect(self) -> list[FeedMessage]:
        """Messages that were delivered and not collected yet."""
        return list(_drain(self.inbox))

    def _serve(self) -> None:
        while True:
            self._has_round.wait()
            self._has_round.clear()
            if self._stop.is_set():
                return
            if self._sent is None:
                self._execute_requests()
            elif items := list(_join_blocks(self._read_round(self._sent))):
                self._deliver(ItemsReceived(self.device.name, items))
            self._is_idle.set()

    def _read_round(self, sent: Sent) -> list[Item]:
        items: list[Item] = []
        while not self._has_all(sent) and not self._stop.is_set():
            items += self.device.read(0.0)
            time.sleep(POLL_INTERVAL_S)
        items += self.device.read(0.0)
        return items

    def _has_all(self, sent: Sent) -> bool:
        """Whether everything that was sent on this connection has arrived; a closed one must be noticed first."""
        received = self.received
        if received is None or received.port not in sent:
            return True
        size = sent[received.port]
        return size is not None and received.size >= size


class SteppedFeeds:
    """The devices of one trial on a stepped clock."""

    def __init__(self, devices: Sequence[Device], clock: SteppedClock) -> None:
        self._clock = clock
        self.feeds = [SteppedFeed(device) for device in devices]
        self._opening = {device.name for device in devices}

    def start(self) -> None:
        for feed in self.feeds:
            feed.start()

    def poll(self) -> list[FeedMessage]:
        """Messages that arrive while the devices open. Time advances only if all devices still opening wait for it."""
        messages = self._collect()
        self._opening -= {message.device for message in messages}
        if not messages:
            time.sleep(OPENING_INTERVAL_S)
            if 0 < len(self._opening) <= self._clock.pending_devices():
                self._clock.step()
        return messages

    def receive(self) -> list[FeedMessage]:
        """All messages of the next step, device by device. Raises DeviceLost if the simulated bench has ended."""
        connections = [feed.received for feed in self.feeds]  # read once: a connection may end at any time
        sent = self._clock.step([connection.port for connection in connections if connection is not None])
        self._make_round([feed for feed in self.feeds if feed.has_requests], None)
        self._make_round(self.feeds, sent)
        return self._collect()

    def finish_requests(self) -> None:
        """Execute the requests: a stopped capture ends with its current frame, and reports its end."""
        try:
            self.receive()
            self.receive()
        except DeviceLost:
            return

    def release(self, within_s: float) -> list[str]:
        """Close the devices; return the names of those that did not close within `within_s` wall seconds."""
        return end_feeds(self.feeds, within_s, meanwhile=self._step_while_pending)

    def _make_round(self, feeds: Sequence[SteppedFeed], sent: Sent | None) -> None:
        """Run a round. Requests get a round of their own: they must not depend on how far other devices are read."""
        for feed in feeds:
            feed.begin_round(sent)
        while busy := [feed for feed in feeds if not feed.is_round_over(0.0)]:
            # At most as many feeds may stay busy as there are devices whose reply needs time to advance.
            if not busy[0].is_round_over(PENDING_INTERVAL_S) and len(busy) <= self._clock.pending_devices():
                return

    def _step_while_pending(self) -> None:
        try:
            if self._clock.pending_devices():
                self._clock.step()
        except DeviceLost:
            return

    def _collect(self) -> list[FeedMessage]:
        return [message for feed in self.feeds for message in feed.collect()]


def _join_blocks(items: Sequence[Item]) -> Iterator[Item]:
    """Join consecutive blocks of one stream that arrived at the same time."""
    waiting: list[Samples] = []
    for item in items:
        if waiting and not (isinstance(item, Samples) and _continues(waiting[-1], item)):
            yield _concatenate(waiting)
            waiting = []
        if isinstance(item, Samples):
            waiting.append(item)
        else:
            yield item
    if waiting:
        yield _concatenate(waiting)


def _continues(first: Samples, second: Samples) -> bool:
    return (first.stream, first.host_time_ns) == (second.stream, second.host_time_ns)


def _concatenate(blocks: Sequence[Samples]) -> Samples:
    if len(blocks) == 1:
        return blocks[0]
    return Samples(
        blocks[0].stream,
        np.concatenate([block.sample_numbers for block in blocks]),
        np.concatenate([block.device_time_ns for block in blocks]),
        blocks[0].host_time_ns,
        np.concatenate([block.values for block in blocks]),
    )
