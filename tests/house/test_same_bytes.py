"""The same seed gives the same samples, figures and report on any machine: idle, busy, or with a single core."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.under_load import busy_loops
from tests.house.sameness import differences
from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[2]
LOOPS = 4
PATIENCE_S = 200.0


def made(folder: Path, *options: str, loops: int = 0) -> Path:
    """The folder, with the session of one cuff in it."""
    with busy_loops(loops, PATIENCE_S):
        command = [sys.executable, "-m", "tests.house.one_cuff", str(folder), *options]
        subprocess.run(command, check=True, cwd=ROOT, timeout=scaled_timeout(PATIENCE_S))  # noqa: S603
    return folder


def assert_same(one: Path, other: Path) -> None:
    assert len(list(one.glob("*.mcap"))) == 6
    assert differences(one, other) == []


@pytest.mark.slow
def test_busy_loops_beside_it_change_nothing(recorded_session: Path, tmp_path: Path) -> None:
    assert_same(recorded_session, made(tmp_path, loops=LOOPS))


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system does not pin a process to a core")
def test_a_single_core_changes_nothing(recorded_session: Path, tmp_path: Path) -> None:
    assert_same(recorded_session, made(tmp_path, "--pinned"))
