from __future__ import annotations

from pathlib import Path

import numpy as np

from recordings.samples import Event, Samples, Stream
from station.rerun_log import RerunLog
from station.session import Snapshot, State


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
        log.show(Snapshot(State.RECORDING, "recording", streams=(stream,)))
        log.offer(
            Samples("/markers", numbers, numbers.astype(np.int64) * 10_000_000, 1_750_000_001_000_000_000, frames)
        )
    assert b"/rope" in path.read_bytes()
