"""The trial has ended: samples of its last moments may still arrive, and the post-roll is recorded."""

from __future__ import annotations

from dataclasses import dataclass

from recordings.samples import Item, Loss, Samples
from station.bench.shortfall import SHORT_S
from station.bench.snapshot import TrialState
from station.bench.states.context import TrialContext
from station.bench.states.recorded import RecordedState
from station.bench.states.state import Over, StartEdge, State
from station.bench.stream_watchdog import SILENCE_TIMEOUT_S

QUIET_S = 1.0
"""Station seconds without frames after which, with the sync line low, the capture is over; and without samples after
which closing no longer waits for the post-roll. For the capture's own samples it waits SILENCE_TIMEOUT_S."""
LONGEST_CLOSING_S = 15.0
"""Station seconds after which closing no longer waits at all, though a backlog still arrives."""


@dataclass(frozen=True)
class Ending:
    """The end of a trial [UTC, ns] and the station time at which it was noticed."""

    host_ns: int
    noticed_s: float
    has_capture_ended: bool


class Closing(RecordedState):
    name = TrialState.CLOSING

    def __init__(
        self, context: TrialContext, edge: StartEdge, ending: Ending, sentence: str, *, is_accepted: bool
    ) -> None:
        super().__init__(context, edge)
        self.sentence, self._ending, self._is_accepted = sentence, ending, is_accepted

    def handle(self, item: Item) -> State:
        """Frames that come after the end of the capture are those of a preview, or of the next capture."""
        if self._ending.has_capture_ended and isinstance(item, Samples | Loss) and item.stream == "/markers":
            return self
        return super().handle(item)

    def handle_sync(self, samples: Samples) -> State:
        for edge in self.context.sync.feed(samples):
            if edge.is_glitch:
                self.context.writer.write(self.context.glitch_event(edge))
        return self

    def tick(self) -> State:
        """Wait for the DAQ's samples up to the end of the post-roll; a backlog may take its time."""
        watchdog, now_s = self.context.watchdog, self.context.clock.station_s()
        behind = self.context.shortfall.behind(self._ending.host_ns, -self.context.rules.post_roll_s)
        arrivals_s = [watchdog.last_arrival_s(stream.name) or 0.0 for stream, _ in behind]
        last_arrival_s = max([self._ending.noticed_s, *arrivals_s])
        short = [(stream, short_s) for stream, short_s in behind if short_s > SHORT_S]
        patience_s = SILENCE_TIMEOUT_S if short else QUIET_S
        if behind and now_s - last_arrival_s < patience_s and now_s - self._ending.noticed_s < LONGEST_CLOSING_S:
            return self
        for stream, short_s in short:
            self._is_accepted = False
            self.sentence = f"{stream.source} sent nothing on {stream.name} in the last {short_s:.1f} s of the trial"
        return self.finish()

    def stop(self, *, at_once: bool) -> State:
        return self.finish() if at_once else self

    def finish(self) -> Over:
        """Count what is missing, and end the trial."""
        context, ending = self.context, self._ending
        for loss in context.shortfall.losses(ending.host_ns, ending.noticed_s, self.edge.station_s):
            context.write_loss(loss)
        parts = [self.sentence]
        if ending.has_capture_ended and context.sync.is_high:
            parts.append(
                "the sync line is still high where the recording ends, so the start edge alone ties the clocks"
            )
            context.write_event("no_stop_edge", parts[-1])
        parts += [note.text for note in context.notes]
        sentence = "; ".join(filter(None, [*parts, context.overload.sentence]))
        return Over(sentence, self.edge, is_accepted=self._is_accepted)
