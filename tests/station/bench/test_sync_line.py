from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from drivers.simulators.faults import FAULTS
from recordings.samples import Samples
from station.bench.sync_line import Edge, SyncLine, wrong_polarity
from station.messages.codes import TrialCode
from station.messages.message import Message
from tests.station.sync_faults import CASES, Case, suffer

MILLISECOND = 1_000_000  # ns between two samples
THRESHOLD = 2.5
FELL = Edge(False, 7, 7 * MILLISECOND, 4.9, 0.1)


def block(volts: list[float], first: int = 0) -> Samples:
    """Samples of 1 kHz from the number `first` on."""
    numbers = np.arange(first, first + len(volts), dtype=np.uint64)
    return Samples("/sync", numbers, numbers.astype(np.int64) * MILLISECOND, 0, np.array(volts)[:, None])


def rise(number: int, from_v: float = 0.0, to_v: float = 5.0, *, is_glitch: bool = False) -> Edge:
    return Edge(True, number, number * MILLISECOND, from_v, to_v, is_glitch)


def fall(number: int, *, is_glitch: bool = False) -> Edge:
    return Edge(False, number, number * MILLISECOND, 5.0, 0.0, is_glitch)


@pytest.mark.parametrize(
    ("volts", "edges", "has_settled"),
    [
        ([0.0, 2.4, THRESHOLD, *[5.0] * 5], [rise(2, 2.4, THRESHOLD)], True),
        ([0.0, *[5.0] * 5], [], False),
        ([0.0, *[5.0] * 6], [rise(1)], True),
        ([0.0, *[5.0] * 4, *[0.0] * 9], [rise(1, is_glitch=True)], True),
        ([0.0, *[5.0] * 5, *[0.0] * 6], [rise(1), fall(6)], True),
        ([*[5.0] * 9, 0.0, *[5.0] * 9], [fall(9, is_glitch=True)], True),
        ([5.0, *[0.0] * 6], [fall(1)], True),
        ([THRESHOLD, 5.0, THRESHOLD], [], True),
    ],
    ids=["rise", "5 ms less a sample", "5 ms", "glitch", "pulse", "dip", "starts high", "at the threshold"],
)
def test_a_level_counts_from_5_ms_on_whatever_the_blocks(
    volts: list[float], edges: list[Edge], has_settled: bool
) -> None:
    for size in (1, 3, len(volts)):
        line = SyncLine(THRESHOLD)
        starts = range(0, len(volts), size)
        assert [edge for i in starts for edge in line.update(block(volts[i : i + size], i))] == edges
        assert line.has_settled is has_settled
        assert line.level_v == volts[-1] and line.is_high is (volts[-1] >= THRESHOLD)


def test_an_empty_block_changes_nothing() -> None:
    line = SyncLine(THRESHOLD)
    assert line.update(block([])) == [] and line.level_v is None and not line.is_high
    line.update(block([0.0, 5.0]))
    assert line.update(block([])) == [] and line.is_high and not line.has_settled


def test_edges_at_a_low_sample_rate_are_not_glitches() -> None:
    samples = block([0.0, 5.0, 0.0])
    slow = Samples("/sync", samples.sample_numbers, samples.device_time_ns * 50, 0, samples.values)
    line = SyncLine(THRESHOLD)
    assert [(edge.rising, edge.is_glitch) for edge in line.update(slow)] == [(True, False)]
    assert not line.has_settled


@pytest.mark.parametrize(
    ("volts", "fell", "message"),
    [
        ([0.2], FELL, Message(TrialCode.NO_SYNC_EDGE_FELL, {"timeout_s": 30.0, "from_v": 4.9, "to_v": 0.1})),
        ([], None, Message(TrialCode.NO_SYNC_EDGE_NO_SAMPLES, {"timeout_s": 30.0})),
        ([4.8], None, Message(TrialCode.NO_SYNC_EDGE_HIGH, {"timeout_s": 30.0, "level_v": 4.8, "threshold_v": 2.5})),
        ([0.2], None, Message(TrialCode.NO_SYNC_EDGE_LOW, {"timeout_s": 30.0, "level_v": 0.2, "threshold_v": 2.5})),
    ],
    ids=["fell", "no samples", "high", "low"],
)
def test_a_missing_edge_is_reported_with_what_the_line_did(
    volts: list[float], fell: Edge | None, message: Message[TrialCode]
) -> None:
    line = SyncLine(THRESHOLD)
    line.update(block(volts))
    assert line.missing_edge(30.0, fell) == message
    assert str(message)


def test_a_falling_edge_in_place_of_a_rising_one_is_reported_with_its_levels() -> None:
    assert wrong_polarity(FELL) == Message(TrialCode.WRONG_POLARITY, {"from_v": 4.9, "to_v": 0.1})


# Every fault of the sync line, through the real wires: who tells it, and what becomes of the trial.


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_fault_of_the_sync_line_is_reported_by_recorder_or_certificate(case: Case, tmp_path: Path) -> None:
    suffered = suffer(case, tmp_path)
    assert suffered.result.accepted is case.accepted, suffered.result.sentence
    assert re.search(case.words, suffered.words), suffered.words
    kinds = {"sync_glitch", "sync_double_edge", "no_stop_edge"} & {event.kind for event in suffered.events}
    assert kinds == ({case.event} if case.event else set())
    assert (suffered.result.path is None) is (case.fault == "wrong_polarity"), "nothing of an inverted line is kept"


def test_every_fault_of_the_sync_line_has_a_test_case() -> None:
    assert {case.fault for case in CASES} == set(FAULTS["sync"])
