from __future__ import annotations

import io

import numpy as np
from rich.console import Console

from recordings.samples import Event, Loss, Samples
from station.bench.live import BACKLOG, LiveView
from station.bench.session import Snapshot, State
from station.clock import ManualClock


def seen(view_of: list[object], snapshots: list[Snapshot]) -> tuple[str, LiveView]:
    out = io.StringIO()
    view = LiveView(ManualClock(), "hand static 1", Console(file=out, force_terminal=False))
    for snapshot in snapshots:
        view.show(snapshot)
    for item in view_of:
        view.offer(item)  # type: ignore[arg-type]
    with view:
        pass
    return out.getvalue(), view


def test_every_state_is_said_once_even_if_it_was_short() -> None:
    armed, recording = Snapshot(State.ARMED, "waiting"), Snapshot(State.RECORDING, "recording")
    said, _ = seen([], [armed, armed, recording, Snapshot(State.CLOSED, "the capture ended")])
    assert said.splitlines() == [
        "hand static 1: armed: waiting",
        "hand static 1: recording: recording",
        "hand static 1: closed: the capture ended",
    ]


def test_events_and_losses_are_said_as_they_come() -> None:
    said, _ = seen([Event("x", "the capture started", 0, "QTM"), Loss("/force", "overrun", 5, 12, 0, 0)], [])
    assert said.splitlines() == ["  the capture started", "  lost 12 samples of /force: overrun"]


def test_a_view_that_falls_behind_drops_the_oldest_and_counts() -> None:
    numbers = np.arange(1, dtype=np.uint64)
    block = Samples("/force", numbers, numbers.astype(np.int64), 0, np.zeros((1, 1)))
    _, view = seen([block] * (BACKLOG + 7), [])
    assert view.dropped == 7


def test_an_armed_trial_shows_level_time_left_and_how_to_cancel() -> None:
    out = io.StringIO()
    view = LiveView(ManualClock(), "hand static 1", Console(file=out, force_terminal=True, width=200))
    view.show(Snapshot(State.ARMED, "waiting", sync_level_v=0.31, waited_s=12.0, left_s=48.0))
    with view:
        pass
    assert "armed  for 12 s, 48 s left, Ctrl-C cancels  sync 0.31 V" in out.getvalue()
