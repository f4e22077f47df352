"""All devices are open: the last seconds are kept in memory until the sync edge."""

from __future__ import annotations

from recordings.samples import Event, Item, Samples
from station.bench.falling_edges import FallingEdges
from station.bench.pre_roll import PRE_ROLL_S, PreRoll
from station.bench.snapshot import TrialState
from station.bench.states.before_recording import BeforeRecording
from station.bench.states.context import DeviceFailure, TrialContext
from station.bench.states.recording import RecordingState
from station.bench.states.state import Ended, OpenState, StartEdge, State
from station.bench.sync_line import Edge, wrong_polarity
from station.messages.codes import TrialCode
from station.messages.message import Message

PFI0 = "the hardware trigger on PFI0 started the acquisition"


class Armed(BeforeRecording, OpenState):
    name = TrialState.ARMED
    armed_s: float

    def __init__(self, context: TrialContext) -> None:
        super().__init__(context)
        self.messages, self.armed_s = (Message(TrialCode.ARMED),), context.clock.station_s()
        self._pre_roll, self._falls = PreRoll(self._is_of_daq), FallingEdges()
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

    def _is_of_daq(self, stream: str) -> bool:
        device_of = self.context.watchdog.device_of
        return stream != "/markers" and device_of(stream) == device_of("/sync")

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
        context.write_loss(context.first_frame.set_edge(context.shortfall.last_sample_ns("/sync") - since_edge_ns))
        return RecordingState(context, edge)
