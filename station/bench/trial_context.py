"""Shared data of the states of one trial: streams, counters, the writer, and the conditions that start and end it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from documents.message import Figures, Message
from fitting.pull.cuff_motion import OCCLUSION_LIMIT
from fitting.trial.clocks import LONGEST_FORCE_GAP
from recordings.samples import Event, Item, Loss, Samples, Stream
from station.bench.stream_watchdog import OverloadMonitor, Shortfall, StreamWatchdog
from station.bench.sync_line import GLITCH_NS, Edge, SyncLine
from station.clock import Clock
from station.messages.bench_messages import TrialCode


class ItemWriter(Protocol):
    """The part of the recording writer that a trial uses. Every method raises RecordingError after a failed write."""

    def write(self, item: Item) -> None: ...

    def flush_if_due(self) -> None: ...


@dataclass(frozen=True)
class DeviceFailure:
    """A device that ends the trial: the message, the device's name, and the cause of its Loss."""

    message: Message[TrialCode]
    device: str = ""
    cause: str = "disconnected"


NEEDED = ("/force", "/sync", "/markers")
"""Streams whose silence or loss ends a trial, where its devices have them; of all but /sync a fit needs more than the
edges."""
ADDITIONAL = ("/force", "/emg", "/analog")
"""Streams without which a trial goes on, where they are not needed; their silence is noted and counted. Measurements of
an amplifier's clock come every few seconds."""


class TrialContext:
    """Streams, counters and writer of one trial, from arming to its end.

    latest_device_ns is the time of the last sample of /sync on the clock of its device. notes are written at the sync
    edge, and are part of the final message.
    """

    def __init__(
        self,
        rules: TrialRules,
        writer: ItemWriter,
        clock: Clock,
        streams: Sequence[Stream],
        device_by_stream: Mapping[str, str],
    ) -> None:
        self.rules, self.writer, self.clock, self.streams = rules, writer, clock, tuple(streams)
        self.needed = tuple(name for name in NEEDED if name != "/force" or rules.is_force_needed)
        self.additional = tuple(name for name in ADDITIONAL if name not in self.needed)
        self.watchdog = StreamWatchdog(clock, streams, device_by_stream)
        self.shortfall = Shortfall(streams, self.watchdog)
        self.first_frame = FirstFrameCheck(streams)
        self.sync = SyncLine(rules.threshold_v)
        self.overload = OverloadMonitor()
        self.notes: list[Message[TrialCode]] = []
        self.lost_samples = self.marks = self.latest_device_ns = 0
        self._recorded, self._lost = Counter[str](), Counter[str]()
        self._gaps: dict[str, list[tuple[float, float]]] = {}  # stream → begin and end [s] on the host's clock

    def record_arrival(self, item: Item) -> None:
        """Restart the silence timer of a stream that delivered samples, update its clock, check the first frame."""
        if isinstance(item, Samples) and len(item.device_time_ns):
            self.watchdog.record_arrival(item.stream)
            self.shortfall.update(item)
            if item.stream == "/markers":
                self.write_loss(self.first_frame.update(item))  # a loss is known after the sync edge alone

    def write_event(self, kind: str, text: str) -> None:
        self.writer.write(self.event(kind, text))

    def write_message(self, message: Message[TrialCode]) -> None:
        """Record the message as an event of its kind."""
        self.write_event(message.kind, str(message))

    def write(self, item: Item) -> None:
        """Record an item of the trial, and count its samples."""
        if isinstance(item, Loss):
            self.lost_samples += item.count
            rate_hz = sum(stream.rate_hz for stream in self.streams if stream.name == item.stream)
            if item.stream == "/markers" or item.count > LONGEST_FORCE_GAP * rate_hz:
                self._lost[item.stream] += item.count
                self._add_gap(item, item.count / rate_hz if rate_hz else 0.0)
        elif isinstance(item, Samples):
            self._recorded[item.stream] += len(item.device_time_ns)
        self.writer.write(item)

    def write_loss(self, loss: Loss | None) -> None:
        """Count and record samples that the station itself found missing."""
        if loss is not None:
            self.write(loss)

    def mostly_lost(self) -> list[Message[TrialCode]]:
        """A message for each measured stream that lost more than the fit of a cuff accepts; it bridges short gaps."""
        messages, duration_s = list[Message[TrialCode]](), 0.0
        measured = [stream for stream in self.streams if stream.name in self.needed and stream.name != "/sync"]
        for stream in measured:
            lost = self._lost[stream.name]
            total = max(1, lost + self._recorded[stream.name])
            share, duration_s = lost / total, max(duration_s, total / stream.rate_hz)
            if share > OCCLUSION_LIMIT:
                figures: Figures = {
                    "source": stream.source,
                    "stream": stream.name,
                    "lost_percent": 100 * share,
                    "limit_percent": 100 * OCCLUSION_LIMIT,
                }
                messages.append(Message(TrialCode.MOSTLY_LOST, figures))
        lost_s = _length([gap for stream in measured for gap in self._gaps.get(stream.name, ())])
        if not messages and lost_s > OCCLUSION_LIMIT * duration_s:
            common = {"common_s": max(0.0, duration_s - lost_s), "duration_s": duration_s}
            messages.append(Message(TrialCode.LITTLE_IN_COMMON, {**common, "limit_percent": 100 * OCCLUSION_LIMIT}))
        return messages

    def _add_gap(self, loss: Loss, seconds: float) -> None:
        """Gaps of one block end together; they lie one before the other."""
        gaps, end_s = self._gaps.setdefault(loss.stream, []), loss.host_time_ns * 1e-9
        if gaps and end_s - seconds < gaps[-1][1]:
            before = gaps.pop()
            seconds, end_s = seconds + before[1] - before[0], max(end_s, before[1])
        gaps.append((end_s - seconds, end_s))

    def event(self, kind: str, text: str) -> Event:
        return Event(kind, text, self.clock.utc_ns(), "station")

    def glitch_event(self, glitch: Edge) -> Event:
        code = TrialCode.GLITCH_UP if glitch.rising else TrialCode.GLITCH_DOWN
        figures = {"to_v": glitch.to_v, "glitch_ms": GLITCH_NS * 1e-6, "sample": glitch.sample_number}
        message = Message(code, figures)
        return self.event(message.kind, str(message))

    def can_continue_without(self, failure: DeviceFailure) -> bool:
        """Whether no stream of the failed device is needed; the failure is then a note on the trial."""
        if self.watchdog.is_needed(failure.device, self.needed):
            return False
        self.watchdog.mark_lost(failure.device, failure.cause)
        self.notes.append(failure.message)
        return True

    def silence(self, expected: Sequence[str], since_s: float) -> DeviceFailure | None:
        """The first expected stream that fell silent, as the failure of its device."""
        silent = self.watchdog.find_silent_stream(expected, since_s)
        if silent is None:
            return None
        stream = silent.stream
        figures: Figures = {
            "source": stream.source,
            "stream": stream.name,
            "silence_s": silent.silence_s,
            "rate_hz": stream.rate_hz,
        }
        message = Message(TrialCode.DEVICE_SILENT, figures)
        return DeviceFailure(message, self.watchdog.find_device(stream.name), "silent")


def _length(gaps: Sequence[tuple[float, float]]) -> float:
    """Seconds in at least one of the gaps (begin, end)."""
    length, covered_to = 0.0, -math.inf
    for begin, end in sorted(gaps):
        length += max(0.0, end - max(begin, covered_to))
        covered_to = max(covered_to, end)
    return length


POST_ROLL_S = 0.5
"""Station seconds recorded after the end of the capture, so that the falling edge of the sync line is in the file."""


@dataclass(frozen=True)
class TrialRules:
    """Times are station seconds; duration_s None: until the capture ends."""

    start: Literal["sync_edge", "pfi0"]
    threshold_v: float
    timeout_s: float
    duration_s: float | None
    post_roll_s: float = POST_ROLL_S
    is_force_needed: bool = True


LATENESS = 0.1
"""Disagreement of both clocks about the time since the edge: this fraction of it, plus as many seconds."""


class FirstFrameCheck:
    """Finds the first block of /markers of a capture, and the frames that are missing before it.

    Frames whose numbers continue from before the edge (a live preview without a capture) carry no such information;
    the driver counts what is missing among them.
    """

    def __init__(self, streams: Sequence[Stream]) -> None:
        self._rate_hz = sum(stream.rate_hz for stream in streams if stream.name == "/markers")
        self._edge_host_ns: int | None = None
        self._is_awaited = True
        self._is_found = False
        self._first: Samples | None = None

    def set_edge(self, host_ns: int) -> Loss | None:
        """The capture began at this host time [UTC, ns]; its frames may have arrived before the edge."""
        self._edge_host_ns = host_ns
        return self._missed()

    def handle_event(self, event: Event) -> None:
        """Frame numbers that restart belong to a capture, whose first frame is counted once."""
        self._is_awaited |= not self._is_found and event.kind in ("numbering_restarted", "capture_replaced")

    def update(self, block: Samples) -> Loss | None:
        """Take a block with at least one frame; return the frames that are missing before it, once they are known."""
        if not self._is_awaited:
            return None
        self._is_awaited, self._first = False, block
        return self._missed()

    def _missed(self) -> Loss | None:
        if self._first is None or self._edge_host_ns is None:
            return None
        first, self._first = self._first, None
        number = int(first.sample_numbers[0])
        since_edge_s = (first.host_time_ns - self._edge_host_ns) * 1e-9
        most = (since_edge_s * (1 + LATENESS) + LATENESS) * self._rate_hz
        self._is_found = since_edge_s >= 0 and 1 <= number <= most
        if not self._is_found or number == 1:
            return None
        return Loss(first.stream, "late", 1, number - 1, int(first.device_time_ns[0]), first.host_time_ns)
