"""What the states of one trial share: streams, counters, the writer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from recordings.samples import Event, Item, Loss, Samples, Stream
from station.bench.first_frame import FirstFrameCheck
from station.bench.overload import OverloadMonitor
from station.bench.shortfall import Shortfall
from station.bench.stream_watchdog import StreamWatchdog
from station.bench.sync_line import GLITCH_NS, Edge, SyncLine
from station.bench.trial_rules import TrialRules
from station.clock import Clock
from station.messages.codes import TrialCode
from station.messages.message import Figures, Message


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
"""Streams whose silence or loss ends a trial, where its devices have them."""


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
        self.watchdog = StreamWatchdog(clock, streams, device_by_stream)
        self.shortfall = Shortfall(streams, self.watchdog)
        self.first_frame = FirstFrameCheck(streams)
        self.sync = SyncLine(rules.threshold_v)
        self.overload = OverloadMonitor()
        self.notes: list[Message[TrialCode]] = []
        self.lost_samples = self.marks = self.latest_device_ns = 0

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

    def write_loss(self, loss: Loss | None) -> None:
        """Count and record samples that the station itself found missing."""
        if loss is not None:
            self.lost_samples += loss.count
            self.writer.write(loss)

    def event(self, kind: str, text: str) -> Event:
        return Event(kind, text, self.clock.utc_ns(), "station")

    def glitch_event(self, glitch: Edge) -> Event:
        code = TrialCode.GLITCH_UP if glitch.rising else TrialCode.GLITCH_DOWN
        figures = {"to_v": glitch.to_v, "glitch_ms": GLITCH_NS * 1e-6, "sample": glitch.sample_number}
        message = Message(code, figures)
        return self.event(message.kind, str(message))

    def can_continue_without(self, failure: DeviceFailure) -> bool:
        """Whether no stream of the failed device is needed; the failure is then a note on the trial."""
        if self.watchdog.is_needed(failure.device, NEEDED):
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
        return DeviceFailure(message, self.watchdog.device_of(stream.name), "silent")
