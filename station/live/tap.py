"""The recorder's end: a view that starts the live process and passes it the items. It never holds up a trial.

The first message is the request, then come those of a recording: a header (kind, host time [ns], arrival at the
recorder [s, monotonic clock]) and the content, JSON for the request. Both ends are of the same installation, so the
layout has no version.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from pydantic import TypeAdapter

from documents.message import Message, because
from recordings.packing import Message as RecordedMessage
from recordings.packing import pack, unpack
from recordings.samples import Item, Samples, Stream
from recordings.topics import EMG, FORCE, MARKERS, SCHEMA_OF_TOPIC
from station.bench.states import CAPTURE_ENDS
from station.bench.view import JOIN_TIMEOUT_S, BackgroundView, Snapshot, TrialState
from station.child import Child
from station.clock import Clock
from station.config import StationConfig
from station.messages.live_messages import LiveCode
from station.protocol import BODY_TESTS, TrialSpec

HEADER = struct.Struct("<Bqd")
TOPICS = tuple(SCHEMA_OF_TOPIC)
REQUEST_KIND = 255
BACKLOG = 500
"""Blocks that may wait for the live process before the oldest is dropped: a few seconds."""
WAKE_S = 0.1
TAPPED = (MARKERS, FORCE, EMG)


@dataclass(frozen=True)
class FedMessage:
    """A message of the recorder, passed on at arrival_s of the monotonic clock, which all processes share."""

    content: RecordedMessage | dict[str, Any]
    arrival_s: float


def encode_message(message: RecordedMessage, host_time_ns: int, arrival_s: float) -> bytes:
    topic, data = pack(message)
    return HEADER.pack(TOPICS.index(topic), host_time_ns, arrival_s) + data


def encode_request(request: dict[str, Any]) -> bytes:
    return HEADER.pack(REQUEST_KIND, 0, 0.0) + json.dumps(request).encode()


def decode(data: bytes) -> FedMessage:
    kind, host_time_ns, arrival_s = HEADER.unpack_from(data)
    content = data[HEADER.size :]
    return FedMessage(
        json.loads(content) if kind == REQUEST_KIND else unpack(TOPICS[kind], host_time_ns, content), arrival_s
    )


@dataclass(frozen=True)
class LiveRequest:
    """The first message. before_utc_ns: only trials that began earlier give the body of the wearer."""

    config: StationConfig
    folder: Path
    spec: TrialSpec
    before_utc_ns: int


REQUEST = TypeAdapter(LiveRequest)


def live_views(config: StationConfig, folder: Path, spec: TrialSpec, clock: Clock) -> list[LiveTap]:
    """The tap of a trial with markers on the wearer, if [live] is enabled; else none."""
    if not config.live.enabled or spec.test not in BODY_TESTS:
        return []
    return [LiveTap(LiveRequest(config, folder.resolve(), spec, clock.wall_utc_ns()))]


def _start_process() -> Child:
    return Child("station.live.process")


class LiveTap(BackgroundView):
    """offer() and show() return at once: what the live process does not read is dropped and counted."""

    def __init__(self, request: LiveRequest, start: Callable[[], Child] = _start_process) -> None:
        super().__init__("live tap", WAKE_S, BACKLOG)
        self._request, self._start = request, start
        self._waiting: deque[tuple[Item | Stream | dict[str, Any], float]] = deque()
        self._lock = threading.Lock()
        self._has_more = threading.Event()
        self._child: Child | None = None
        self._streams: tuple[Stream, ...] = ()
        self._has_begun = self._takes_no_frames = False
        self._reported = 0  # of the dropped frames
        self.exit_code: int | None = None

    def offer(self, item: Item) -> None:
        if (
            isinstance(item, Samples)
            and item.stream in TAPPED
            and not (self._takes_no_frames and item.stream == MARKERS)
        ):
            self._put(item)

    def show(self, snapshot: Snapshot) -> None:
        if snapshot.streams != self._streams:
            self._streams = snapshot.streams
            self._put({"origin": snapshot.origin.value})
            for stream in sorted(snapshot.streams, key=lambda stream: stream.name == MARKERS):  # the set-up needs all
                if stream.name in TAPPED:
                    self._put(stream)
        if snapshot.state is TrialState.RECORDING and not self._has_begun:
            self._has_begun = True
            self._put({"begins": True, "recording": str(snapshot.recording or "")})
        elif snapshot.state is TrialState.CLOSING and snapshot.messages[0].kind in CAPTURE_ENDS:
            self._takes_no_frames = True  # what comes now is of a preview, and is not recorded

    def __enter__(self) -> LiveTap:
        try:
            self._child = self._start()
        except OSError as error:
            print(Message(LiveCode.NOT_STARTED, because(error)), file=sys.stderr, flush=True)
        super().__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._put({"ends": True})
        super().__exit__(kind, error, trace)
        if self._child is not None and self._thread.is_alive():
            self._child.process.kill()  # it has not received for JOIN_TIMEOUT_S
            self._thread.join(JOIN_TIMEOUT_S)

    def wait(self, timeout_s: float) -> bool:
        """Whether the live process ends within so many wall seconds; it closes its file after the trial has ended."""
        try:
            self.exit_code = None if self._child is None else self._child.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def _put(self, content: Item | Stream | dict[str, Any]) -> None:
        with self._lock:
            if len(self._waiting) >= BACKLOG:
                self._drop_oldest()
            self._waiting.append((content, time.perf_counter()))
        self._has_more.set()

    def _drop_oldest(self) -> None:
        """The oldest block; descriptions and requests are kept."""
        for place, (content, _) in enumerate(self._waiting):
            if isinstance(content, Samples):
                del self._waiting[place]
                self.dropped += len(content.values) if content.stream == MARKERS else 0
                return

    def _handle(self, item: Item) -> None:
        """Nothing: items do not wait in the backlog of the base."""

    def _run(self) -> None:
        child = self._child
        if child is None:
            return
        try:
            child.send_bytes(REQUEST.dump_json(self._request))
            while not self._stop.is_set():
                self._has_more.wait(WAKE_S)
                self._has_more.clear()
                self._send(child)
            self._send(child)
        except OSError:
            self.exit_code = child.process.wait()
            print(Message(LiveCode.ENDED, {"exit_code": str(self.exit_code)}), file=sys.stderr, flush=True)
        finally:
            child.close()

    def _send(self, child: Child) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    break
                content, arrival_s = self._waiting.popleft()
            if isinstance(content, dict):
                child.send_bytes(encode_request(content))
            else:
                host_ns = 0 if isinstance(content, Stream) else content.host_time_ns
                child.send_bytes(encode_message(content, host_ns, arrival_s))
        if self.dropped != self._reported:
            self._reported = self.dropped
            child.send_bytes(encode_request({"dropped": self._reported}))
