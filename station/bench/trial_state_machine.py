"""One trial: idle → armed → recording → closing → closed | failed.

It has no thread and no device: it takes items and the passage of time, and its current state returns the next one, so
that a test with a manual clock reaches every state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from documents.message import Message, because, join_sentences
from drivers.errors import DeviceError
from recordings.errors import RecordingError
from recordings.samples import Item, Stream
from station.bench.states import Armed, Ended, Idle, State
from station.bench.trial_context import DeviceFailure, ItemWriter, TrialContext, TrialRules
from station.bench.view import Snapshot, TrialState
from station.clock import Clock
from station.messages.bench_messages import TrialCode


class TrialStateMachine:
    """Passes items, time and the operator's commands to the current state."""

    def __init__(self, rules: TrialRules, writer: ItemWriter, clock: Clock) -> None:
        self._rules, self._writer, self._clock = rules, writer, clock
        self._state: State = Idle()
        self._context = TrialContext(rules, writer, clock, (), {})

    @property
    def state(self) -> TrialState:
        return self._state.name

    @property
    def messages(self) -> tuple[Message[TrialCode], ...]:
        """The state of the trial, or the reason of its end, with what a reader of the recording should know."""
        return self._state.messages

    @property
    def sentence(self) -> str:
        return join_sentences(self.messages)

    @property
    def is_over(self) -> bool:
        return isinstance(self._state, Ended)

    @property
    def has_edge(self) -> bool:
        """Whether samples after a sync edge were recorded."""
        return self._state.edge is not None

    @property
    def lost_samples(self) -> int:
        return self._context.lost_samples

    @property
    def wants_capture_start(self) -> bool:
        """Whether the pre-roll is full, so that the capture may start."""
        return self._state.wants_capture_start

    def snapshot(self) -> Snapshot:
        state, context = self._state, self._context
        waited_s = 0.0 if state.armed_s is None else self._clock.station_s() - state.armed_s
        edge_ns = None if state.edge is None else state.edge.device_ns
        return Snapshot(
            state.name,
            state.messages,
            context.sync.level_v,
            waited_s,
            0.0 if edge_ns is None else max(0, context.latest_device_ns - edge_ns) * 1e-9,
            context.lost_samples,
            context.marks,
            context.streams,
            0.0 if state.armed_s is None else max(0.0, self._rules.timeout_s - waited_s),
            edge_ns,
        )

    def arm(self, streams: Sequence[Stream], device_by_stream: Mapping[str, str] | None = None) -> None:
        """All devices are open: keep the pre-roll and wait for the sync edge.

        device_by_stream maps the name of a stream to the name of its device.
        """
        self._context = TrialContext(self._rules, self._writer, self._clock, streams, device_by_stream or {})
        self._state = Armed(self._context)

    def handle(self, item: Item) -> None:
        """Take one item from a device, in the order of arrival."""
        self._state = self._state.handle(item)

    def tick(self) -> None:
        """Check time-outs, silent streams and the end of closing, and flush. Call every 20 ms."""
        stall_s = self._context.watchdog.poll()
        if stall_s is not None:
            message = Message(TrialCode.STATION_PAUSED, {"stall_s": stall_s})
            self._state.note_stall(self._context.event(message.kind, str(message)))
        self._state = self._state.tick()
        self._writer.flush_if_due()

    def stop(self, *, at_once: bool = False) -> None:
        """End the trial for the operator: while it is armed, cancel it; while it records, close and keep it."""
        self._state = self._state.stop(at_once=at_once)

    def mark(self) -> None:
        """Mark this moment, to be named later; without effect before the sync edge."""
        self._state.mark()

    def note(self, message: Message[TrialCode]) -> None:
        """Add a note to the armed trial: an event at its edge, and a part of its final message."""
        self._context.notes.append(message)

    def fail(self, error: DeviceError, device: str = "") -> None:
        """End the trial because a device is lost; without effect while it is closing."""
        message = Message(TrialCode.DEVICE_LOST, because(error))
        self._state = self._state.fail(DeviceFailure(message, device))

    def cut_short(self, message: Message[TrialCode]) -> None:
        """End a trial that cannot continue: what was recorded is kept, and not accepted."""
        self._state = self._state.cut_short(message)

    def refuse(self, message: Message[TrialCode]) -> None:
        """The trial is over, and the message says why it cannot be used."""
        self._context.write_message(message)
        self._state = Ended(*self._state.messages, message, edge=self._state.edge)

    def abandon(self, error: RecordingError) -> None:
        """End the trial because nothing more can be written."""
        self._state = Ended(Message(TrialCode.WRITE_FAILED, because(error)), edge=self._state.edge)
