"""The sync edge has come: every item is written until the capture, the duration or the operator ends the trial."""

from __future__ import annotations

from collections.abc import Sequence

from fitting.timing.sync_line import BOUNCE
from recordings.samples import Event, Loss, Samples
from station.bench.pre_roll import LATENESS_S
from station.bench.snapshot import TrialState
from station.bench.states.closing import QUIET_S, Closing, Ending
from station.bench.states.context import DeviceFailure, TrialContext
from station.bench.states.recorded import RecordedState
from station.bench.states.state import StartEdge, State
from station.bench.sync_line import Edge


class RecordingState(RecordedState):
    name, sentence = TrialState.RECORDING, "recording"

    def __init__(self, context: TrialContext, edge: StartEdge) -> None:
        super().__init__(context, edge)
        self._dip: Edge | None = None  # the latest fall of the sync line
        self._doubt = ""  # why the trial will not be accepted, though it goes on

    def handle_event(self, event: Event) -> State:
        recorded_s = self.context.clock.station_s() - self.edge.station_s
        if event.kind == "capture_stopped":
            self._check_empty_capture(recorded_s)
            return self._close("capture_ended", "the mocap capture ended")
        if event.kind == "capture_replaced":
            return self.cut_short(event.kind, event.text)
        if event.kind == "numbering_restarted" and recorded_s > LATENESS_S:
            return self._close("capture_ended", "the mocap system numbers its frames anew: its capture ended")
        return self

    def handle_sync(self, samples: Samples) -> State:
        return self.handle_edges(self.context.sync.feed(samples))

    def handle_edges(self, edges: Sequence[Edge]) -> State:
        """Take the edges of a block of the sync line, and check the duration at its end."""
        for edge in edges:
            if edge.is_glitch:
                self.context.writer.write(self.context.glitch_event(edge))
            elif not edge.rising:
                self._dip = edge
            elif self._dip is not None and edge.device_time_ns - self._dip.device_time_ns >= BOUNCE * 1e9:
                self._note_second_start(edge)
        duration_s = self.context.rules.duration_s
        if duration_s is None or (self.context.latest_device_ns - self.edge.device_ns) * 1e-9 < duration_s:
            return self
        end_ns = self.context.shortfall.reached_ns("/sync")
        return self._close("duration_reached", f"{duration_s:g} s recorded after the edge", end_ns)

    def tick(self) -> State:
        if silence := self.context.silence(("/force", "/sync", "/markers"), self.edge.station_s):
            return self.fail(silence)
        return self._check_quiet_capture_end()

    def stop(self, *, at_once: bool) -> State:
        closing = self._close("operator_stop", "stopped by the operator")
        return closing.finish() if at_once else closing

    def fail(self, failure: DeviceFailure) -> State:
        self.context.watchdog.mark_lost(failure.device, failure.cause)
        return self._close("device_lost", failure.sentence, is_accepted=False).finish()

    def cut_short(self, kind: str, sentence: str) -> State:
        return self._close(kind, sentence, is_accepted=False)

    def _note_second_start(self, edge: Edge) -> None:
        """Two rising edges leave the start of the capture ambiguous: the trial goes on, and is not accepted."""
        after_s = (edge.device_time_ns - self.edge.device_ns) * 1e-9
        self._doubt = (
            f"the sync line rose a second time {after_s:.2f} s after the first, so nobody knows which of them is "
            "the capture's start; set the mocap system's output to one pulse for the whole capture and record again"
        )
        self.sentence = f"recording; {self._doubt}"
        self.context.write_event("sync_double_edge", self._doubt)

    def _check_empty_capture(self, recorded_s: float) -> None:
        """A capture without a frame that ends before the silence time-out."""
        context = self.context
        markers = next((stream for stream in context.streams if stream.name == "/markers"), None)
        if markers is not None and (context.watchdog.last_arrival_s(markers.name) or 0.0) < self.edge.station_s:
            missing = round(recorded_s * markers.rate_hz)
            latest_ns, now_ns = context.latest_device_ns, context.clock.utc_ns()
            context.write_loss(Loss(markers.name, "silent", 0, missing, latest_ns, now_ns))
            self._doubt = f"{markers.source} sent not one frame of it; check that it tracks and streams 3D in real time"

    def _check_quiet_capture_end(self) -> State:
        """A mocap system that sends no events ends its capture by a low sync line and no more frames."""
        context = self.context
        last_s = context.watchdog.last_arrival_s("/markers")
        is_quiet = last_s is not None and context.clock.station_s() - last_s > QUIET_S
        if is_quiet and context.rules.start == "sync_edge" and not context.sync.is_high:
            return self._close("capture_ended", "the sync line is low and the frames ended")
        return self

    def _close(self, kind: str, sentence: str, end_ns: int | None = None, *, is_accepted: bool = True) -> Closing:
        """end_ns: the end of the trial [UTC]; by default now."""
        sentence = f"{sentence}; {self._doubt}" if self._doubt else sentence
        self.context.write_event(kind, sentence)
        end_ns = self.context.clock.utc_ns() if end_ns is None else end_ns
        ending = Ending(end_ns, self.context.clock.station_s(), kind in ("capture_ended", "capture_replaced"))
        return Closing(self.context, self.edge, ending, sentence, is_accepted=is_accepted and not self._doubt)
