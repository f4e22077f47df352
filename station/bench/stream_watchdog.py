"""Detect streams that have stopped delivering samples, samples missing at the end of a trial, and a computer too slow.

A stream is silent when no sample has arrived for SILENCE_TIMEOUT_S although its device is connected. A disconnected
device is not reported here: its driver reconnects it or raises DeviceLost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from documents.message import Message
from recordings.samples import Event, Item, Loss, Samples, Stream
from station.clock import ArrivalClock, Clock
from station.messages.bench_messages import TrialCode

SILENCE_TIMEOUT_S = 3.0
"""Station seconds without a sample."""
STALL_THRESHOLD_S = 1.0
"""Station seconds between two polls. The station polls every 20 ms, or once a step of the simulated bench; a longer gap
means that the station itself was suspended."""
SHORT_S = 0.1
"""Station seconds by which the DAQ's last sample may precede the end of the capture, whose message also takes time."""
OVERWRITTEN = ("overrun", "queue_overflow")
"""Causes of a Loss that only a late reader produces."""
LATE_S = 1.0
"""Station seconds from the arrival of a sample at the driver to its recording; usually 0.02."""


@dataclass(frozen=True)
class SilentStream:
    stream: Stream
    silence_s: float


class StreamWatchdog:
    """Arrival time of the last sample of every stream. All times are station seconds.

    device_by_stream maps the name of a stream to the name of its device.
    """

    def __init__(self, clock: Clock, streams: Sequence[Stream], device_by_stream: Mapping[str, str]) -> None:
        self._clock, self._streams, self._device_by_stream = clock, tuple(streams), device_by_stream
        self._absences: dict[str, str] = {}  # device -> cause, as in Loss
        self._last_arrival_s: dict[str, float] = {}
        self._resumed_s = self._polled_s = clock.station_s()

    def record_arrival(self, stream: str) -> None:
        """Note that a sample of the stream has just arrived."""
        self._last_arrival_s[stream] = self._clock.station_s()

    def last_arrival_s(self, stream: str) -> float | None:
        """Arrival time of the last sample; None before the first."""
        return self._last_arrival_s.get(stream)

    def handle_event(self, event: Event) -> None:
        """Update the connection state from a connection_lost or connection_restored event."""
        if event.kind == "connection_lost":
            self._absences[event.source] = "disconnected"
        elif event.kind == "connection_restored":
            self._absences.pop(event.source, None)
            for stream in (name for name, device in self._device_by_stream.items() if device == event.source):
                self.record_arrival(stream)

    def mark_lost(self, device: str, cause: str) -> None:
        """Note that the device is lost for good. A cause that was noted before stays."""
        self._absences.setdefault(device, cause)

    def find_device(self, stream: str) -> str:
        return self._device_by_stream.get(stream, "")

    def is_needed(self, device: str, needed: Sequence[str]) -> bool:
        """Whether the device is unknown or has one of the needed streams."""
        streams = [stream for stream, owner in self._device_by_stream.items() if owner == device]
        return not streams or any(stream in needed for stream in streams)

    def absence(self, stream: str) -> str:
        """Cause of the disconnection of the stream's device, as in Loss; "" while it is connected."""
        return self._absences.get(self.find_device(stream), "")

    def poll(self) -> float | None:
        """Duration of a stall of the station itself, or None. Call at every tick.

        A stall (suspended computer, swapping) restarts the silence timers, because the devices kept streaming.
        """
        stall_s, self._polled_s = self._clock.station_s() - self._polled_s, self._clock.station_s()
        if stall_s < STALL_THRESHOLD_S:
            return None
        self._resumed_s = self._polled_s
        return stall_s

    def find_silent_stream(self, expected: Sequence[str], since_s: float) -> SilentStream | None:
        """First of the expected streams whose last sample is older than the time-out."""
        now = self._clock.station_s()
        for stream in self._streams:
            silence_s = now - max(self._last_arrival_s.get(stream.name, since_s), since_s, self._resumed_s)
            if stream.name in expected and silence_s > SILENCE_TIMEOUT_S and not self.absence(stream.name):
                return SilentStream(stream, silence_s)
        return None


class Shortfall:
    """Tracks the last sample of the DAQ's and the load cell's streams; frames end with the capture.

    A stream whose device is disconnected or lost is short in any case.
    """

    def __init__(self, streams: Sequence[Stream], watchdog: StreamWatchdog) -> None:
        self._streams, self._watchdog = tuple(streams), watchdog
        self._clocks = {name: ArrivalClock() for name in ("/force", "/sync")}
        self._reached_ns = dict.fromkeys(self._clocks, 0)
        self._last: dict[str, tuple[int, int]] = {}  # number and device time of the last sample

    def update(self, samples: Samples) -> None:
        """Take a block with at least one sample."""
        self._last[samples.stream] = int(samples.sample_numbers[-1]), int(samples.device_time_ns[-1])
        if samples.stream in self._clocks:
            self._reached_ns[samples.stream] = int(self._clocks[samples.stream].update(samples)[-1])

    @property
    def last_sync_ns(self) -> int:
        """UTC [ns] of the last sample of the sync line; 0 before the first."""
        return self._reached_ns["/sync"]

    def find_short_streams(self, end_ns: int, tolerance_s: float) -> list[tuple[Stream, float]]:
        """Streams of the DAQ and the load cell whose last sample precedes end_ns by more than tolerance_s [s]."""
        gaps = [
            (stream, (end_ns - self._reached_ns[stream.name]) * 1e-9)
            for stream in self._streams
            if stream.name in self._clocks
        ]
        return [(stream, gap_s) for stream, gap_s in gaps if gap_s > tolerance_s]

    def losses(self, end_ns: int, end_s: float, since_s: float) -> list[Loss]:
        """Missing samples of every stream up to the end (UTC [ns] and station seconds) of a trial since since_s.

        Included are streams whose device is disconnected, and those of the DAQ that are short by more than SHORT_S.
        """
        gap_s = {stream.name: gap for stream, gap in self.find_short_streams(end_ns, SHORT_S)}
        losses = []
        for stream in self._streams:
            cause = self._watchdog.absence(stream.name)
            missing_s = gap_s.get(stream.name, 0.0)
            if cause and stream.name not in self._clocks:
                missing_s = end_s - max(self._watchdog.last_arrival_s(stream.name) or 0.0, since_s)
            if (count := round(missing_s * stream.rate_hz)) > 0:
                number, last_ns = self._last.get(stream.name, (-1, 0))
                losses.append(Loss(stream.name, cause or "silent", number + 1, count, last_ns, end_ns))
        return losses


class OverloadMonitor:
    """Checks every recorded item of a trial."""

    def __init__(self) -> None:
        self._overwritten = 0
        self._longest_wait_s = 0.0
        self._is_reported = False

    def update(self, item: Item, now_ns: int) -> tuple[Message[TrialCode], ...]:
        """The messages of the first overload of the trial; empty before and afterwards."""
        if isinstance(item, Loss) and item.cause in OVERWRITTEN:
            self._overwritten += item.count
        elif not isinstance(item, Event):
            self._longest_wait_s = max(self._longest_wait_s, (now_ns - item.host_time_ns) * 1e-9)
        messages = self.messages
        if self._is_reported or not messages:
            return ()
        self._is_reported = True
        return messages

    @property
    def messages(self) -> tuple[Message[TrialCode], ...]:
        """The cost of the overload so far; empty if there was none."""
        found = []
        if self._overwritten:
            found.append(Message(TrialCode.OVERWRITTEN, {"samples": self._overwritten}))
        if self._longest_wait_s > LATE_S:
            found.append(Message(TrialCode.LATE, {"late_s": self._longest_wait_s}))
        return tuple(found)
