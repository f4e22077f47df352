"""Every item is written, until the capture, the duration or the operator ends the trial."""

from __future__ import annotations

from collections.abc import Sequence

from fitting.trial.sync_line import BOUNCE
from recordings.samples import Event, Loss, Samples
from station.bench.pre_roll import LATENESS_S
from station.bench.snapshot import TrialState
from station.bench.states.closing import QUIET_S, Closing, TrialEnd
from station.bench.states.context import NEEDED, DeviceFailure, TrialContext
from station.bench.states.recorded import RecordedState
from station.bench.states.state import StartEdge, State
from station.bench.sync_line import Edge
from station.messages.codes import TrialCode
from station.messages.message import Message

RECORDING = Message(TrialCode.RECORDING)
CAPTURE_ENDS = ("capture_ended", "capture_replaced")
"""Kinds of messages after which no frame belongs to the capture."""

ADDITIONAL = ("/emg", "/analog")
"""Streams without which a trial goes on; their silence is noted and counted."""


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
            return self.cut_short(Message(TrialCode.CAPTURE_REPLACED, {"text": event.text}))
        if event.kind == "numbering_restarted" and recorded_s > LATENESS_S and self._renumbered_s is None:
            self._renumbered_s = self.context.clock.station_s()
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
        end_ns = self.context.shortfall.last_sample_ns("/sync")
        return self._close(Message(TrialCode.DURATION_REACHED, {"duration_s": duration_s}), end_ns)

    def tick(self) -> State:
        for streams in (NEEDED, ADDITIONAL):
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
        if not any(defect.code is TrialCode.FRAMES_RENUMBERED for defect in self._defects):
            message = Message(TrialCode.FRAMES_RENUMBERED, {"after_s": renumbered_s - self.edge.station_s})
            self._add_defect(message)
            context.write_message(message)
        return None

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
