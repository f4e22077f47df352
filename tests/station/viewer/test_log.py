from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from recordings.samples import Event, Samples, Stream
from station.bench.snapshot import Snapshot, TrialState
from station.viewer.log import RerunLog


def test_a_trial_s_force_markers_and_events_are_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "trial.rrd"
    numbers = np.arange(100, dtype=np.uint64)
    times = numbers.astype(np.int64) * 10_000_000
    markers = np.ones((100, 3, 4), dtype=np.float32)
    markers[:, 1] = np.nan
    with RerunLog(path) as log:
        log.offer(Event("armed", "all devices are open", 1_750_000_000_000_000_000, "station"))
        log.offer(Samples("/force", numbers, times, 1_750_000_001_000_000_000, np.ones((100, 1))))
        log.offer(Samples("/markers", numbers, times, 1_750_000_001_000_000_000, markers))
    content = path.read_bytes()
    assert content[:4] == b"RRF2"
    for name in (b"/force", b"/markers", b"/events"):
        assert name in content
    assert log.dropped == 0


def test_the_rope_is_drawn_between_its_markers(tmp_path: Path) -> None:
    path = tmp_path / "trial.rrd"
    numbers = np.arange(10, dtype=np.uint64)
    frames = np.ones((10, 3, 4), dtype=np.float32)
    stream = Stream("/markers", "mm", ("cuff_1", "rope_1", "rope_2"), 100.0, "QTM")
    with RerunLog(path, ("rope_1", "rope_2")) as log:
        log.show(Snapshot(TrialState.RECORDING, streams=(stream,)))
        log.offer(
            Samples("/markers", numbers, numbers.astype(np.int64) * 10_000_000, 1_750_000_001_000_000_000, frames)
        )
    assert b"/rope" in path.read_bytes()


def rows_in(path: Path) -> dict[str, int]:
    """Rows per entity over time, counted by Rerun's own reader."""
    words = [sys.executable, "-m", "rerun", "rrd", "print", "-v", str(path)]
    said = subprocess.run(words, check=True, capture_output=True, encoding="utf-8").stdout  # noqa: S603  (our own words)
    found = re.findall(r"with (\d+) rows .* - /(\w+) - .*:(?:scalars|positions|strips)\]", said)
    rows = dict.fromkeys((name for _, name in found), 0)
    for count, name in found:
        rows[name] += int(count)
    return rows


def test_what_is_shown_is_decimated(tmp_path: Path) -> None:
    path = tmp_path / "trial.rrd"
    stream = Stream("/markers", "mm", ("cuff_1", "rope_1", "rope_2"), 100.0, "QTM")
    frames = np.ones((200, 3, 4), dtype=np.float32)
    frames[100:, 2] = np.nan
    with RerunLog(path, ("rope_1", "rope_2")) as log:
        log.show(Snapshot(TrialState.RECORDING, streams=(stream,)))
        for start in range(0, 2000, 50):  # two seconds in the DAQ's blocks
            numbers = np.arange(start, start + 50, dtype=np.uint64)
            times = numbers.astype(np.int64) * 1_000_000
            log.offer(Samples("/force", numbers, times, 1_750_000_000_000_000_000 + int(times[-1]), np.ones((50, 1))))
        numbers = np.arange(200, dtype=np.uint64)
        times = numbers.astype(np.int64) * 10_000_000
        log.offer(Samples("/markers", numbers, times, 1_750_000_002_000_000_000, frames))
    rows = rows_in(path)
    assert 199 <= rows["force"] <= 202, "a hundred a second"
    assert 49 <= rows["markers"] <= 52, "twenty-five a second"
    assert 24 <= rows["rope"] <= 27, "while both ends are seen"
