from __future__ import annotations

import numpy as np
import pytest

from drivers.qualisys_wire import MarkerBlocks, MarkerFrame
from recordings.samples import Event, Item, Loss, Samples


def frames_taken(*numbers_and_times_us: tuple[int, int]) -> list[Item]:
    blocks = MarkerBlocks(("a",), 100.0, "QTM")
    blocks.labels = ("a",)
    for number, timestamp_us in numbers_and_times_us:
        blocks.add(
            MarkerFrame(
                timestamp_us=timestamp_us,
                number=number,
                points=np.zeros(4, "<f4").tobytes(),
                drop_rate=0,
                out_of_sync_rate=0,
            ),
            0,
        )
    return blocks.take()


def test_frames_that_were_skipped_while_time_passed_are_lost() -> None:
    (before, loss, after) = frames_taken((7, 60_000), (10, 90_000))
    assert isinstance(loss, Loss) and (loss.first_missing, loss.count) == (8, 2)
    assert isinstance(before, Samples) and isinstance(after, Samples)


@pytest.mark.parametrize(
    ("number", "timestamp_us"),
    [(1, 0), (1, 12_110_000), (6620, 12_120_000), (6620, 500)],
    ids=["a capture begins", "the same, one clock", "preview goes on behind a capture", "the same, another clock"],
)
def test_numbers_that_jump_without_time_have_begun_anew_and_nothing_is_lost(number: int, timestamp_us: int) -> None:
    items = frames_taken((1211, 12_100_000), (number, timestamp_us))
    assert [type(item) for item in items] == [Samples, Event, Samples]
    assert isinstance(items[1], Event) and items[1].kind == "numbering_restarted"


def test_what_follows_a_capture_is_counted_anew_even_where_time_jumps_too() -> None:
    blocks = MarkerBlocks(("a",), 100.0, "QTM")
    blocks.labels = ("a",)
    points = np.zeros(4, "<f4").tobytes()
    told = []
    for number in (1800, 16878, 16880):
        frame = MarkerFrame(timestamp_us=10_000 * number, number=number, points=points, drop_rate=0, out_of_sync_rate=0)
        blocks.add(frame, 0)
        told += [type(item) for item in blocks.take() if not isinstance(item, Samples)]
        if number == 1800:
            blocks.capture_ended()
    assert told == [Event, Loss], "the jump behind the capture is none, the next one is"
