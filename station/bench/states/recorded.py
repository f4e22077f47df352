"""What the states recording and closing share: every item is written."""

from __future__ import annotations

from recordings.samples import Item, Loss
from station.bench.states.context import TrialContext
from station.bench.states.state import OpenState, StartEdge


class RecordedState(OpenState):
    """A trial with a sync edge."""

    edge: StartEdge

    def __init__(self, context: TrialContext, edge: StartEdge) -> None:
        super().__init__(context)
        self.edge = edge

    def store(self, item: Item) -> None:
        context = self.context
        if isinstance(item, Loss):
            context.lost_samples += item.count
        context.writer.write(item)
        for message in context.overload.update(item, context.clock.utc_ns()):
            context.write_message(message)

    def mark(self) -> None:
        self.context.marks += 1
        self.context.write_event("mark", f"mark {self.context.marks}")
