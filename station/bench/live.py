"""The live view on the terminal: state, level of the sync line, rates. Items that it drops are counted."""

from __future__ import annotations

from collections import deque

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.table import Table

from documents.interval import counted
from recordings.manifest import CuffSite, LoadCell
from recordings.samples import Event, Item, Loss, Samples
from station.bench.live_displacement import LiveDisplacement
from station.bench.view import BackgroundView, Snapshot, StreamTally, TrialState
from station.clock import Clock

REFRESH_S = 0.25
BACKLOG = 2000
"""Items that may wait for the view before the oldest are dropped."""


class LiveView(BackgroundView):
    """A table on a terminal; states, events and losses as lines in any case."""

    def __init__(
        self,
        clock: Clock,
        title: str,
        console: Console | None = None,
        load_cell: LoadCell | None = None,
        cuff: CuffSite | None = None,
    ) -> None:
        super().__init__("live view", REFRESH_S, BACKLOG)
        self._load_cell, self._cuff = load_cell, cuff
        self._tracker: LiveDisplacement | None = None
        self._displacement_mm: float | None = None
        self._clock, self._title = clock, title
        self._console = console or Console(stderr=True)
        self._snapshot = Snapshot(TrialState.IDLE)
        self._changes: deque[Snapshot] = deque()
        self._tallies: dict[str, StreamTally] = {}

    def show(self, snapshot: Snapshot) -> None:
        if (snapshot.state, snapshot.sentence) != (self._snapshot.state, self._snapshot.sentence):
            self._changes.append(snapshot)
        self._snapshot = snapshot

    def _run(self) -> None:
        if not self._console.is_terminal:
            super()._run()
            return
        with Live(console=self._console, get_renderable=self._table, refresh_per_second=1 / REFRESH_S, transient=True):
            super()._run()

    def _refresh(self) -> None:
        while self._changes:
            change = self._changes.popleft()
            self._print(f"{self._title}: {change.state.value}: {change.sentence}")
        super()._refresh()

    def _handle(self, item: Item) -> None:
        if isinstance(item, Samples):
            self._tallies.setdefault(item.stream, StreamTally()).add(item)
            if item.stream == "/markers":
                self._track_cuff(item)
        elif isinstance(item, Event):
            self._print(f"  {item.text}")
        elif isinstance(item, Loss):
            self._print(f"  lost {counted(item.count, 'sample')} of {item.stream}: {item.cause}")

    def _track_cuff(self, frames: Samples) -> None:
        labels = {stream.name: stream.labels for stream in self._snapshot.streams}.get(frames.stream, ())
        if self._cuff is None or not len(frames.values) or len(labels) != frames.values.shape[1]:
            return
        if self._tracker is None:
            self._tracker = LiveDisplacement(self._cuff, labels)
        displacement = self._tracker.update(frames.values)
        self._displacement_mm = float(displacement[-1]) if np.isfinite(displacement[-1]) else None

    def _last(self, stream: str, tally: StreamTally) -> str:
        """The last value: force in newtons and in the device's unit, frames with the displacement of the cuff."""
        if stream == "/force" and self._load_cell is not None and tally.last:
            newtons = self._load_cell.polarity * self._load_cell.newtons_per_unit * float(tally.last)
            return f"{newtons:+.1f} N ({tally.last} {self._unit(stream)})"
        if stream == "/markers" and self._cuff is not None:
            displacement = "-" if self._displacement_mm is None else f"{self._displacement_mm:+.1f}"
            return f"{displacement} mm along the rope, {tally.last}"
        return f"{tally.last} {self._unit(stream)}"

    def _unit(self, stream: str) -> str:
        units = {known.name: known.unit for known in self._snapshot.streams}
        return units.get(stream, "") if stream != "/markers" else ""

    def _print(self, text: str) -> None:
        self._console.print(text, highlight=False, markup=False, soft_wrap=True)

    def _table(self) -> Table:
        snapshot, now = self._snapshot, self._clock.station_s()
        level = "-" if snapshot.sync_level_v is None else f"{snapshot.sync_level_v:.2f} V"
        waiting = f"for {snapshot.waited_s:.0f} s, {snapshot.left_s:.0f} s left, Ctrl-C cancels"
        clock = waiting if snapshot.state is TrialState.ARMED else f"{snapshot.recorded_s:.1f} s"
        table = Table(title=f"{self._title}  {snapshot.state.value}  {clock}  sync {level}", title_justify="left")
        for heading in ("stream", "samples/s", "samples", "last"):
            table.add_column(heading, justify="left" if heading in ("stream", "last") else "right")
        for name, tally in sorted(self._tallies.items()):
            table.add_row(name, f"{tally.rate(now):.0f}", str(tally.total), self._last(name, tally).strip())
        lost = f"lost samples: {snapshot.lost_samples}"
        table.caption = lost + (f", items not shown: {self.dropped}" if self.dropped else "")
        return table
