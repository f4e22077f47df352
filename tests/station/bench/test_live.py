import io
from collections.abc import Sequence

import numpy as np
from rich.console import Console

from documents.message import Message
from recordings.manifest import CuffSite, LoadCell
from recordings.samples import Event, Item, Loss, Samples, Stream
from station.bench.live import BACKLOG, LiveView
from station.bench.view import Snapshot, TrialState
from station.clock import ManualClock
from station.messages.bench_messages import TrialCode


def screen_of(
    snapshots: list[Snapshot], items: Sequence[Item] = (), *subject: object, is_terminal: bool = False
) -> tuple[str, LiveView]:
    """What is printed of states and then items, and the view; subject: load cell and markers of the trial."""
    out = io.StringIO()
    console = Console(file=out, force_terminal=is_terminal, width=200)
    view = LiveView(ManualClock(), "hand static 1", console, *subject)  # type: ignore[arg-type]
    for snapshot in snapshots:
        view.show(snapshot)
    for item in items:
        view.offer(item)
    with view:
        pass
    return out.getvalue(), view


def test_every_state_is_printed_once_even_if_it_was_short() -> None:
    states = {
        TrialState.ARMED: Message(TrialCode.ARMED),
        TrialState.RECORDING: Message(TrialCode.RECORDING),
        TrialState.CLOSED: Message(TrialCode.CAPTURE_ENDED),
    }
    armed, recording, closed = (Snapshot(state, (message,)) for state, message in states.items())
    printed, _ = screen_of([armed, armed, recording, closed])
    assert printed.splitlines() == [f"hand static 1: {state.value}: {message}" for state, message in states.items()]


def test_events_and_losses_are_printed_as_they_arrive() -> None:
    items = Event("x", "the capture started", 0, "QTM"), Loss("/force", "overrun", 5, 12, 0, 0)
    printed, _ = screen_of([], items)
    assert printed.splitlines() == ["  the capture started", "  lost 12 samples of /force: overrun"]


def test_a_view_that_falls_behind_drops_the_oldest_and_counts() -> None:
    numbers = np.arange(1, dtype=np.uint64)
    block = Samples("/force", numbers, numbers.astype(np.int64), 0, np.zeros((1, 1)))
    _, view = screen_of([], [block] * (BACKLOG + 7))
    assert view.dropped == 7


def test_an_armed_trial_shows_level_time_left_and_how_to_cancel() -> None:
    armed = Snapshot(TrialState.ARMED, sync_level_v=0.31, waited_s=12.0, left_s=48.0)
    shown, _ = screen_of([armed], is_terminal=True)
    assert "armed  for 12 s, 48 s left, Ctrl-C cancels  sync 0.31 V" in shown


def test_a_trial_shows_force_and_displacement_with_the_values_of_the_devices() -> None:
    labels = ("anchor_1", "anchor_2", "anchor_3", "cuff_1", "rope_1", "rope_2")
    streams = (Stream("/force", "V", ("force",), 1000.0, "NI"), Stream("/markers", "mm", labels, 100.0, "QTM"))
    numbers = np.arange(40, dtype=np.uint64)
    frames = np.zeros((40, 6, 4), np.float32)
    frames[:, :, :3] = [[0, 0, 0], [100, 0, 0], [0, 100, 0], [50, 50, 50], [60, 50, 50], [160, 50, 50]]
    frames[30:, 3:, 0] += 7.5
    force = Samples("/force", numbers, numbers.astype(np.int64), 0, np.full((40, 1), -0.25))
    parts = np.split(numbers, [30])
    markers = (Samples("/markers", part, part.astype(np.int64), 0, frames[part]) for part in parts)
    subject = LoadCell("daq", 100.0, -1), CuffSite("hand", "arm", labels[:3], ("cuff_1",), labels[4:])
    recording = Snapshot(TrialState.RECORDING, streams=streams)
    shown, _ = screen_of([recording], [force, *markers], *subject, is_terminal=True)
    assert "+25.0 N (-0.250 V)" in shown and "+7.5 mm along the rope, 6 of 6 markers seen" in shown
