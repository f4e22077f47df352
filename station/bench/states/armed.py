"""All devices are open: the last seconds are kept in memory, and the sync edge is waited for."""

from __future__ import annotations

from recordings.samples import Event, Item, Samples
from station.bench.falls import ALREADY_CAPTURING, ARMED, Falls
from station.bench.pre_roll import PRE_ROLL_S, PreRoll
from station.bench.snapshot import TrialState
from station.bench.states.context import DeviceFailure, TrialContext
from station.bench.states.idle import CANCELLED
from station.bench.states.recording import RecordingState
from station.bench.states.state import OpenState, Over, StartEdge, State
from station.bench.sync_line import Edge, wrong_polarity

PFI0 = "the hardware trigger on PFI0 started the acquisition"


class Armed(OpenState):
    name = TrialState.ARMED
    armed_s: float

    def __init__(self, context: TrialContext) -> None:
        super().__init__(context)
        self.sentence, self.armed_s = ARMED, context.clock.station_s()
        self._pre_roll, self._falls = PreRoll(), Falls()
        self.store(context.event("armed", "all devices are open; waiting for the sync edge"))

    def store(self, item: Item) -> None:
        self._pre_roll.keep(item)

    def handle_event(self, event: Event) -> State:
        self._falls.note_capture(event.kind, self.context.clock.station_s())
        if event.kind in ("capture_stopped", "numbering_restarted", "capture_replaced"):
            self._pre_roll.forget_frames()
        return self

    def handle_sync(self, samples: Samples) -> State:
        if self.context.rules.start == "pfi0":
            started = self._begin(int(samples.sample_numbers[0]), int(samples.device_time_ns[0]), PFI0)
            return started.handle_edges(self.context.sync.feed(samples))
        edges = self.context.sync.feed(samples)
        for number, edge in enumerate(edges, 1):
            if edge.is_glitch:
                self.store(self.context.glitch_event(edge))
            elif edge.rising:
                found = f"the sync line rose from {edge.from_v:z.2f} V to {edge.to_v:z.2f} V"
                started = self._begin(edge.sample_number, edge.device_time_ns, found)
                return started.handle_edges(edges[number:])
            else:
                self._restart_wait(edge)
        return self

    def tick(self) -> State:
        """Check for a silent sync line, wrong polarity, and the time-out."""
        rules, now_s = self.context.rules, self.context.clock.station_s()
        waited_s = now_s - self.armed_s
        if rules.start == "sync_edge":
            if silence := self.context.silence(("/sync",), self.armed_s):
                return self.fail(silence)
            if edge := self._falls.inverted_start(now_s):
                return Over(wrong_polarity(edge))
            sync = self.context.sync
            self.sentence = ALREADY_CAPTURING if sync.is_high and sync.has_settled else ARMED
        if waited_s > rules.timeout_s:
            why = self.context.sync.why_no_rise(self._falls.unexplained)
            return Over(f"no sync edge came within {rules.timeout_s:g} s{why}")
        is_pre_roll_full = waited_s >= PRE_ROLL_S and self.context.watchdog.last_arrival_s("/sync") is not None
        self.wants_capture_start = rules.start == "pfi0" or is_pre_roll_full
        return self

    def stop(self, *, at_once: bool) -> State:  # noqa: ARG002
        return Over(CANCELLED)

    def fail(self, failure: DeviceFailure) -> State:
        return Over(failure.sentence)

    def cut_short(self, kind: str, sentence: str) -> State:  # noqa: ARG002
        return Over(sentence)

    def _restart_wait(self, fall: Edge) -> None:
        """An earlier capture ended: the time-out begins anew."""
        self.armed_s = self.context.clock.station_s()
        self._falls.note_fall(fall, self.armed_s)
        self._pre_roll.forget_before(fall.device_time_ns)

    def _begin(self, sample_number: int, device_ns: int, found: str) -> RecordingState:
        context = self.context
        self.edge = edge = StartEdge(device_ns, context.clock.station_s())  # also where a write below fails
        for item in [*self._pre_roll.cut(device_ns), *context.notes]:
            context.writer.write(item)
        context.write_event("sync_edge", f"{found} at sample {sample_number}; recording")
        since_edge_ns = context.latest_device_ns - device_ns
        context.write_loss(context.first_frame.edge(context.shortfall.reached_ns("/sync") - since_edge_ns))
        return RecordingState(context, edge)
