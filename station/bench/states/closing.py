"""The trial has ended: the post-roll is recorded, and samples of its last moments may still arrive."""

from __future__ import annotations

from dataclasses import dataclass

from recordings.samples import Item, Loss, Samples
from station.bench.shortfall import SHORT_S
from station.bench.snapshot import TrialState
from station.bench.states.context import TrialContext
from station.bench.states.recorded import RecordedState
from station.bench.states.state import Ended, StartEdge, State
from station.bench.stream_watchdog import SILENCE_TIMEOUT_S
from station.messages.codes import TrialCode
from station.messages.message import Figures, Message

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
            self._is_accepted = False
            figures: Figures = {"source": stream.source, "stream": stream.name, "missing_s": short_s}
            self.messages = (Message(TrialCode.END_MISSING, figures),)
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
        messages += [*context.notes, *context.overload.messages]
        return Ended(*messages, edge=self.edge, is_accepted=self._is_accepted)
