from __future__ import annotations

import numpy as np
import pytest

from recordings.samples import Samples
from station.bench.sync_line import SyncLine


def block(volts: list[float], first: int = 0) -> Samples:
    numbers = np.arange(first, first + len(volts), dtype=np.uint64)
    return Samples("/sync", numbers, numbers.astype(np.int64) * 1_000_000, 0, np.array(volts)[:, None])


LOW, HIGH = [0.0] * 20, [5.0] * 20


def test_an_edge_is_at_the_first_sample_beyond_the_threshold() -> None:
    edges = SyncLine(2.5).update(block([0.0, 0.1, 4.9, *HIGH]))
    assert [(e.rising, e.sample_number, e.device_time_ns) for e in edges] == [(True, 2, 2_000_000)]


def test_an_edge_between_two_blocks_is_seen_once() -> None:
    line = SyncLine(2.5)
    assert line.update(block(LOW)) == []
    assert [e.sample_number for e in line.update(block(HIGH, first=20))] == [20]
    assert line.update(block(HIGH, first=40)) == []
    assert line.is_high


def test_a_line_that_starts_high_has_no_rising_edge() -> None:
    edges = SyncLine(2.5).update(block([5.0, 5.0, *LOW]))
    assert [e.rising for e in edges] == [False]


def test_an_empty_block_changes_nothing() -> None:
    line = SyncLine(2.5)
    assert line.update(block([])) == [] and line.level_v is None


@pytest.mark.parametrize("before_the_end", [1, 2, 3])
def test_a_spike_across_two_blocks_is_a_glitch(before_the_end: int) -> None:
    line = SyncLine(2.5)
    assert line.update(block([*LOW, *[5.0] * before_the_end])) == [], "it may still last"
    edges = line.update(block([5.0] * (3 - before_the_end) + LOW, first=20 + before_the_end))
    assert [(e.rising, e.sample_number, e.is_glitch) for e in edges] == [(True, 20, True)]


def test_an_edge_at_the_end_of_a_block_is_returned_with_the_next_block() -> None:
    line = SyncLine(2.5)
    assert line.update(block([*LOW, 5.0])) == []
    assert [(e.rising, e.sample_number, e.is_glitch) for e in line.update(block(HIGH, first=21))] == [(True, 20, False)]


def test_a_dip_of_a_high_line_is_a_glitch_and_ends_nothing() -> None:
    line = SyncLine(2.5)
    edges = line.update(block([*HIGH, 0.0, 0.0, *HIGH]))
    assert [(e.rising, e.sample_number, e.is_glitch) for e in edges] == [(False, 20, True)]


def test_edges_at_a_low_sample_rate_are_not_glitches() -> None:
    numbers = np.arange(6, dtype=np.uint64)
    volts = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    slow = Samples("/sync", numbers, numbers.astype(np.int64) * 50_000_000, 0, volts[:, None])
    assert [(e.rising, e.is_glitch) for e in SyncLine(2.5).update(slow)] == [(True, False), (False, False)]
