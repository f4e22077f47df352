"""States of one trial: a state takes items, time and commands, and returns the next state.

Idle: devices are opening. Armed: the last seconds are kept in memory until the sync edge. RecordingState: every item is
written, until the capture, the duration or the operator ends the trial. Closing: the post-roll is recorded, and samples
of its last moments may still arrive.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from documents.message import Figures, Message, because
from fitting.trial.clocks import BOUNCE
from recordings.samples import Event, Item, Loss, Samples
from station.bench.stream_watchdog import SHORT_S, SILENCE_TIMEOUT_S
from station.bench.sync_line import LATENESS_S, PRE_ROLL_S, Edge, FallingEdges, PreRoll, wrong_polarity
from station.bench.trial_context import DeviceFailure, TrialContext
from station.bench.view import OPENING, TrialState
from station.messages.bench_messages import TrialCode


@dataclass(frozen=True)
class StartEdge:
    """The sync edge on the clock of /sync and in station seconds."""

    device_ns: int
    station_s: float


class State:
    """Every method returns the next state; by default this one. `messages` are the state of the trial for views."""

    name: TrialState
    messages: tuple[Message[TrialCode], ...]
    edge: StartEdge | None = None
    armed_s: float | None = None  # station seconds at which the time-out began, while one runs
    wants_capture_start = False

    def handle(self, item: Item) -> State:  # noqa: ARG002
        """Take one item from a device, in the order of arrival."""
        return self

    def tick(self) -> State:
        """Check what depends on time alone."""
        return self

    def stop(self, *, at_once: bool) -> State:  # noqa: ARG002
        """The operator ends the trial: cleanly, or at once."""
        return self

    def fail(self, failure: DeviceFailure) -> State:  # noqa: ARG002
        """A device is lost."""
        return self

    def cut_short(self, message: Message[TrialCode]) -> State:  # noqa: ARG002
        """End a trial that cannot continue: what was recorded is closed and kept, and not accepted."""
        return self

    def note_stall(self, event: Event) -> None:
        """The station itself was suspended."""

    def mark(self) -> None:
        """The operator marks this moment, if samples are being recorded."""


class Ended(State):
    """CLOSED (accepted) or FAILED."""

    def __init__(self, *messages: Message[TrialCode], edge: StartEdge | None = None, is_accepted: bool = False) -> None:
        self.name = TrialState.CLOSED if is_accepted else TrialState.FAILED
        self.messages, self.edge = messages, edge


class OpenState(State, ABC):
    """A state in which the devices are read."""

    def __init__(self, context: TrialContext) -> None:
        self.context = context

    def handle(self, item: Item) -> State:
        self.context.record_arrival(item)
        self.store(item)
        if isinstance(item, Event):
            self.context.watchdog.handle_event(item)
            self.context.first_frame.handle_event(item)
            return self.handle_event(item)
        if isinstance(item, Samples) and item.stream == "/sync" and len(item.device_time_ns):
            self.context.latest_device_ns = int(item.device_time_ns[-1])
            return self.handle_sync(item)
        return self

    @abstractmethod
    def store(self, item: Item) -> None:
        """Keep or write the item."""

    def handle_event(self, event: Event) -> State:  # noqa: ARG002
        """Take an event of a device that was stored already."""
        return self

    @abstractmethod
    def handle_sync(self, samples: Samples) -> State:
        """Take a block of the sync line that was stored already."""

    def note_stall(self, event: Event) -> None:
        self.store(event)


CANCELLED = Message(TrialCode.CANCELLED)


class BeforeRecording(State):
    def stop(self, *, at_once: bool) -> State:  # noqa: ARG002
        return Ended(CANCELLED)

    def fail(self, failure: DeviceFailure) -> State:
        return Ended(failure.message)

    def cut_short(self, message: Message[TrialCode]) -> State:
        return Ended(message)


class Idle(BeforeRecording):
    name, messages = TrialState.IDLE, OPENING


PFI0 = "the hardware trigger on PFI0 started the acquisition"


class Armed(BeforeRecording, OpenState):
    name = TrialState.ARMED
    armed_s: float

    def __init__(self, context: TrialContext) -> None:
        super().__init__(context)
        self.messages, self.armed_s = (Message(TrialCode.ARMED),), context.clock.station_s()
        self._pre_roll, self._falls = PreRoll(self._is_daq_stream), FallingEdges()
        self.store(context.event("armed", "all devices are open; waiting for the sync edge"))

    def store(self, item: Item) -> None:
        self._pre_roll.append(item)

    def handle_event(self, event: Event) -> State:
        self._falls.handle_event(event.kind, self.context.clock.station_s())
        if event.kind in ("capture_stopped", "numbering_restarted", "capture_replaced"):
            self._pre_roll.drop_frames()
        return self

    def handle_sync(self, samples: Samples) -> State:
        if self.context.rules.start == "pfi0":
            started = self._begin(int(samples.sample_numbers[0]), int(samples.device_time_ns[0]), PFI0)
            return started.handle_edges(self.context.sync.update(samples))
        edges = self.context.sync.update(samples)
        for number, edge in enumerate(edges, 1):
            if edge.is_glitch:
                self.store(self.context.glitch_event(edge))
            elif edge.rising:
                change = f"the sync line rose from {edge.from_v:z.2f} V to {edge.to_v:z.2f} V"
                started = self._begin(edge.sample_number, edge.device_time_ns, change)
                return started.handle_edges(edges[number:])
            else:
                self._restart_wait(edge)
        return self

    def fail(self, failure: DeviceFailure) -> State:
        return self if self.context.can_continue_without(failure) else super().fail(failure)

    def tick(self) -> State:
        """Check for a silent sync line, wrong polarity, and the time-out."""
        rules, now_s = self.context.rules, self.context.clock.station_s()
        waited_s = now_s - self.armed_s
        if rules.start == "sync_edge":
            if silence := self.context.silence(("/sync",), self.armed_s):
                return self.fail(silence)
            if edge := self._falls.inverted_start(now_s):
                return Ended(wrong_polarity(edge))
            sync = self.context.sync
            is_capturing = sync.is_high and sync.has_settled
            self.messages = (Message(TrialCode.CAPTURE_RUNNING if is_capturing else TrialCode.ARMED),)
        if waited_s > rules.timeout_s:
            return Ended(self.context.sync.missing_edge(rules.timeout_s, self._falls.unexplained))
        is_pre_roll_full = waited_s >= PRE_ROLL_S and self.context.watchdog.last_arrival_s("/sync") is not None
        self.wants_capture_start = rules.start == "pfi0" or is_pre_roll_full
        return self

    def _is_daq_stream(self, stream: str) -> bool:
        find_device = self.context.watchdog.find_device
        return stream != "/markers" and find_device(stream) == find_device("/sync")

    def _restart_wait(self, fall: Edge) -> None:
        """An earlier capture ended: restart the time-out."""
        self.armed_s = self.context.clock.station_s()
        self._falls.add(fall, self.armed_s)
        self._pre_roll.drop_before(fall.device_time_ns)

    def _begin(self, sample_number: int, device_ns: int, cause: str) -> RecordingState:
        context = self.context
        self.edge = edge = StartEdge(device_ns, context.clock.station_s())  # also if a write below fails
        for item in self._pre_roll.take_from(device_ns):
            context.writer.write(item)
        for note in context.notes:
            context.write_message(note)
        context.write_event("sync_edge", f"{cause} at sample {sample_number}; recording")
        since_edge_ns = context.latest_device_ns - device_ns
        context.write_loss(context.first_frame.set_edge(context.shortfall.last_sync_ns - since_edge_ns))
        return RecordingState(context, edge)


class RecordedState(OpenState):
    """A trial with a sync edge."""

    edge: StartEdge

    def __init__(self, context: TrialContext, edge: StartEdge) -> None:
        super().__init__(context)
        self.edge = edge

    def store(self, item: Item) -> None:
        context = self.context
        context.write(item)
        for message in context.overload.update(item, context.clock.utc_ns()):
            context.write_message(message)

    def mark(self) -> None:
        self.context.marks += 1
        self.context.write_event("mark", f"mark {self.context.marks}")


RECORDING = Message(TrialCode.RECORDING)
CAPTURE_ENDS = ("capture_ended", "capture_replaced")
"""Kinds of messages after which no frame belongs to the capture."""


class RecordingState(RecordedState):
    name = TrialState.RECORDING

    def __init__(self, context: TrialContext, edge: StartEdge) -> None:
        super().__init__(context, edge)
        self.messages = (RECORDING,)
        self._fall: Edge | None = None  # the latest fall of the sync line
        self._renumbered_s: float | None = None  # station seconds of a restart of the frame numbers
        self._defects: tuple[Message[TrialCode], ...] = ()  # why the trial will not be accepted, although it continues

    def handle_event(self, event: Event) -> State:
        recorded_s = self.context.clock.station_s() - self.edge.station_s
        if event.kind == "capture_stopped":
            self._check_empty_capture(recorded_s)
            return self._close(Message(TrialCode.CAPTURE_ENDED))
        if event.kind == "capture_replaced":
            return self.cut_short(Message(TrialCode.CAPTURE_REPLACED, because(event.text)))
        if event.kind == "numbering_restarted" and recorded_s > LATENESS_S:
            if self._renumbered_s is None:
                self._renumbered_s = self.context.clock.station_s()
            else:  # a preview begins once
                self._note_renumbering(self._renumbered_s)
        if event.kind == "time_stamps_jumped" and recorded_s > LATENESS_S:
            self._note_once(Message(TrialCode.STAMPS_JUMPED, {"after_s": recorded_s}))
        return self

    def handle_sync(self, samples: Samples) -> State:
        return self.handle_edges(self.context.sync.update(samples))

    def handle_edges(self, edges: Sequence[Edge]) -> State:
        """Take the edges of a block of the sync line, and check the duration at its end."""
        for edge in edges:
            if edge.is_glitch:
                self.context.writer.write(self.context.glitch_event(edge))
            elif not edge.rising:
                self._fall = edge
            elif self._fall is not None and edge.device_time_ns - self._fall.device_time_ns >= BOUNCE * 1e9:
                self._note_second_start(edge)
        duration_s = self.context.rules.duration_s
        if duration_s is None or (self.context.latest_device_ns - self.edge.device_ns) * 1e-9 < duration_s:
            return self
        end_ns = self.context.shortfall.last_sync_ns
        return self._close(Message(TrialCode.DURATION_REACHED, {"duration_s": duration_s}), end_ns)

    def tick(self) -> State:
        for streams in (self.context.needed, self.context.additional):
            if silence := self.context.silence(streams, self.edge.station_s):
                return self.fail(silence)
        return self._check_renumbering() or self._check_quiet_capture_end()

    def stop(self, *, at_once: bool) -> State:
        closing = self._close(Message(TrialCode.OPERATOR_STOP))
        return closing.finish() if at_once else closing

    def fail(self, failure: DeviceFailure) -> State:
        """End the trial, or go on without a device that has no stream which the trial needs."""
        context = self.context
        if context.can_continue_without(failure):
            context.write_message(failure.message)
            self.messages = (RECORDING, *self._defects, *context.notes)
            return self
        context.watchdog.mark_lost(failure.device, failure.cause)
        return self._close(failure.message, is_accepted=False).finish()

    def cut_short(self, message: Message[TrialCode]) -> State:
        return self._close(message, is_accepted=False)

    def _note_second_start(self, edge: Edge) -> None:
        """Two rising edges leave the start of the capture ambiguous: the trial continues, and is not accepted."""
        after_s = (edge.device_time_ns - self.edge.device_ns) * 1e-9
        message = Message(TrialCode.SECOND_START, {"after_s": after_s})
        self._add_defect(message)
        self.context.write_message(message)

    def _add_defect(self, message: Message[TrialCode]) -> None:
        """A later message of the same code replaces the earlier one."""
        self._defects = (*(defect for defect in self._defects if defect.code is not message.code), message)
        self.messages = (RECORDING, *self._defects, *self.context.notes)

    def _check_empty_capture(self, recorded_s: float) -> None:
        """A capture without a frame that ends before the silence time-out."""
        context = self.context
        markers = next((stream for stream in context.streams if stream.name == "/markers"), None)
        if markers is not None and (context.watchdog.last_arrival_s(markers.name) or 0.0) < self.edge.station_s:
            missing = round(recorded_s * markers.rate_hz)
            latest_ns, now_ns = context.latest_device_ns, context.clock.utc_ns()
            context.write_loss(Loss(markers.name, "silent", 0, missing, latest_ns, now_ns))
            self._add_defect(Message(TrialCode.EMPTY_CAPTURE, {"source": markers.source}))

    def _check_renumbering(self) -> State | None:
        """Frame numbers that restart are those of a preview if the capture has ended, and a defect if it continues."""
        context, renumbered_s = self.context, self._renumbered_s
        if renumbered_s is None or context.clock.station_s() - renumbered_s <= LATENESS_S:
            return None
        if context.rules.start == "sync_edge" and not context.sync.is_high:
            return self._close(Message(TrialCode.CAPTURE_ENDED_RENUMBERED))
        self._note_renumbering(renumbered_s)
        return None

    def _note_renumbering(self, renumbered_s: float) -> None:
        self._note_once(Message(TrialCode.FRAMES_RENUMBERED, {"after_s": renumbered_s - self.edge.station_s}))

    def _note_once(self, message: Message[TrialCode]) -> None:
        """A defect whose repetitions are in the recording alone."""
        if not any(defect.code is message.code for defect in self._defects):
            self._add_defect(message)
            self.context.write_message(message)

    def _check_quiet_capture_end(self) -> State:
        """A mocap system without events ends its capture by a low sync line and no more frames."""
        context = self.context
        last_s = context.watchdog.last_arrival_s("/markers")
        is_quiet = last_s is not None and context.clock.station_s() - last_s > QUIET_S
        if is_quiet and context.rules.start == "sync_edge" and not context.sync.is_high:
            return self._close(Message(TrialCode.CAPTURE_ENDED_NO_FRAMES))
        return self

    def _close(self, reason: Message[TrialCode], end_ns: int | None = None, *, is_accepted: bool = True) -> Closing:
        """end_ns: the end of the trial [UTC]; by default now."""
        messages = (reason, *self._defects)
        self.context.write_event(reason.kind, "; ".join(map(str, messages)))
        end = TrialEnd(
            self.context.clock.utc_ns() if end_ns is None else end_ns,
            self.context.clock.station_s(),
            reason.kind in CAPTURE_ENDS,
            messages,
            is_accepted=is_accepted and not self._defects,
        )
        return Closing(self.context, self.edge, end)


QUIET_S = 1.0
"""Station seconds without frames after which, with the sync line low, the capture is over; and without samples after
which closing no longer waits for the post-roll. For the capture's own samples it waits SILENCE_TIMEOUT_S."""
LONGEST_CLOSING_S = 15.0
"""Station seconds after which closing ends, although a backlog still arrives."""


@dataclass(frozen=True)
class TrialEnd:
    """The end of a trial [UTC, ns], the station time at which it was noticed, and its messages."""

    host_ns: int
    noticed_s: float
    has_capture_ended: bool
    messages: tuple[Message[TrialCode], ...]
    is_accepted: bool


class Closing(RecordedState):
    name = TrialState.CLOSING

    def __init__(self, context: TrialContext, edge: StartEdge, end: TrialEnd) -> None:
        super().__init__(context, edge)
        self.messages, self._end, self._is_accepted = end.messages, end, end.is_accepted

    def handle(self, item: Item) -> State:
        """Frames that arrive after the end of the capture belong to a preview, or to the next capture."""
        if self._end.has_capture_ended and isinstance(item, Samples | Loss) and item.stream == "/markers":
            return self
        return super().handle(item)

    def handle_sync(self, samples: Samples) -> State:
        for edge in self.context.sync.update(samples):
            if edge.is_glitch:
                self.context.writer.write(self.context.glitch_event(edge))
        return self

    def tick(self) -> State:
        """Wait for the DAQ's samples up to the end of the post-roll; a backlog may take its time."""
        watchdog, now_s = self.context.watchdog, self.context.clock.station_s()
        awaited = self.context.shortfall.find_short_streams(self._end.host_ns, -self.context.rules.post_roll_s)
        arrivals_s = [watchdog.last_arrival_s(stream.name) or 0.0 for stream, _ in awaited]
        last_arrival_s = max([self._end.noticed_s, *arrivals_s])
        short = [(stream, short_s) for stream, short_s in awaited if short_s > SHORT_S]
        timeout_s = SILENCE_TIMEOUT_S if short else QUIET_S
        if awaited and now_s - last_arrival_s < timeout_s and now_s - self._end.noticed_s < LONGEST_CLOSING_S:
            return self
        for stream, short_s in short:
            figures: Figures = {"source": stream.source, "stream": stream.name, "missing_s": short_s}
            missing = Message(TrialCode.END_MISSING, figures)
            if stream.name in self.context.needed:
                self._is_accepted, self.messages = False, (missing,)
            elif not watchdog.absence(stream.name):  # otherwise a note says so
                self.context.notes.append(missing)
        return self.finish()

    def stop(self, *, at_once: bool) -> State:
        return self.finish() if at_once else self

    def finish(self) -> Ended:
        """Count the missing samples, and end the trial."""
        context, end = self.context, self._end
        for loss in context.shortfall.losses(end.host_ns, end.noticed_s, self.edge.station_s):
            context.write_loss(loss)
        messages = [*self.messages]
        if end.has_capture_ended and context.sync.is_high:
            messages.append(Message(TrialCode.NO_STOP_EDGE))
            context.write_message(messages[-1])
        mostly_lost = context.mostly_lost() if self._is_accepted else []
        messages += [*mostly_lost, *context.notes, *context.overload.messages]
        return Ended(*messages, edge=self.edge, is_accepted=self._is_accepted and not mostly_lost)
