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
LOOPS = 2
PATIENCE_S = 200.0


@pytest.mark.slow
def test_busy_loops_and_a_single_core_change_nothing(recorded_session: Path, tmp_path: Path) -> None:
    """The session of tests/house/one_cuff.py, made on all cores, and on one that it shares with busy loops."""
    is_pinned = ["--pinned"] if hasattr(os, "sched_setaffinity") else []
    command = [sys.executable, "-m", "tests.house.one_cuff", str(tmp_path), *is_pinned]
    with busy_loops(LOOPS, PATIENCE_S):
        subprocess.run(command, check=True, cwd=ROOT, timeout=scaled_timeout(PATIENCE_S))  # noqa: S603
    assert len(list(tmp_path.glob("*.mcap"))) == 6
    assert differences(recorded_session, tmp_path) == []
