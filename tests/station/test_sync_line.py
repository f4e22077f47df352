from __future__ import annotations

import numpy as np

from recordings.samples import Samples
from station.sync_line import SyncLine


def block(volts: list[float], first: int = 0) -> Samples:
    numbers = np.arange(first, first + len(volts), dtype=np.uint64)
    return Samples("/sync", numbers, numbers.astype(np.int64) * 1_000_000, 0, np.array(volts)[:, None])


def test_an_edge_is_named_by_the_first_sample_beyond_the_threshold() -> None:
    edges = SyncLine(2.5).feed(block([0.0, 0.1, 4.9, 5.0]))
    assert [(e.rising, e.sample_number, e.device_time_ns) for e in edges] == [(True, 2, 2_000_000)]


def test_an_edge_between_two_blocks_is_seen_once() -> None:
    line = SyncLine(2.5)
    assert line.feed(block([0.0, 0.0])) == []
    assert [e.sample_number for e in line.feed(block([5.0, 5.0], first=2))] == [2]
    assert line.is_high


def test_a_line_that_starts_high_has_no_rising_edge() -> None:
    edges = SyncLine(2.5).feed(block([5.0, 5.0, 0.0]))
    assert [e.rising for e in edges] == [False]


def test_an_empty_block_changes_nothing() -> None:
    line = SyncLine(2.5)
    assert line.feed(block([])) == [] and line.level_v is None
