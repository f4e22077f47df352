"""Every fault of the sync line, through the real wires: who tells it, and what becomes of the trial."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from drivers.simulators.faults import FAULTS
from tests.station.sync_faults import CASES, Case, suffer


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
