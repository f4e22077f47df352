"""Curves and markers of a trial in Rerun, on one timeline, as Rerun's own reader prints it."""

from __future__ import annotations

import re
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from recordings.samples import Event, Samples, Stream
from station.bench.view import Snapshot, TrialState
from station.viewer.viewer import DISTANCE, TIMELINE, RerunLog, SceneExtent


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


UTC_NS = 1_750_000_000_000_000_000
EDGE_DEVICE_NS = 3_500_000_000
DELAY_NS = 5_000_000
STREAMS = (
    Stream("/force", "V", ("force",), 1000.0, "NI"),
    Stream("/sync", "V", ("sync",), 1000.0, "NI"),
    Stream("/markers", "mm", ("cuff_1", "rope_1"), 100.0, "QTM"),
)


def record(path: Path) -> RerunLog:
    """A trial whose blocks arrive up to 30 ms late, at random, its frames 80 ms late."""
    random = np.random.default_rng(3)
    frames = np.tile(np.array([[140.0, -60.0, 1240.0, 0.4], [340.0, 160.0, 1300.0, 0.4]], np.float32), (100, 1, 1))
    frames[50, 1] = np.nan
    with RerunLog(path) as log:
        log.show(Snapshot(TrialState.ARMED, streams=STREAMS))
        for start in range(0, 5000, 50):
            numbers = np.arange(start, start + 50, dtype=np.uint64)
            times = numbers.astype(np.int64) * 1_000_000
            late = DELAY_NS if start == 500 else int(random.integers(DELAY_NS + 1, 30_000_000))
            for name in ("/sync", "/force"):
                log.offer(Samples(name, numbers, times, UTC_NS + int(times[-1]) + late, np.ones((50, 1))))
            if start == 3500:
                log._refresh()  # as its own thread does now and then
                log.show(Snapshot(TrialState.RECORDING, streams=STREAMS, edge_device_ns=EDGE_DEVICE_NS))
                log.offer(Event("sync_edge", "the sync line rose", UTC_NS + int(times[-1]) + late, "station"))
        numbers = np.arange(1, 101, dtype=np.uint64)
        times = (numbers.astype(np.int64) - 1) * 10_000_000
        log.offer(Samples("/markers", numbers, times, UTC_NS + 5_000_000_000 + 80_000_000, frames))
    return log


def printed(path: Path) -> str:
    words = [sys.executable, "-m", "rerun", "rrd", "print", "-vvv", str(path)]
    return subprocess.run(words, check=True, capture_output=True, encoding="utf-8").stdout  # noqa: S603  (our own words)


def chunks(said: str, entity: str) -> list[str]:
    return [chunk for chunk in said.split("Chunk(")[1:] if f" - {entity} - " in chunk.splitlines()[0]]


def times_of(said: str, entity: str) -> list[int]:
    """Nanoseconds since UTC_NS, of every row."""
    found = re.findall(r"row_\w+ +┆ +(\S+T[\d:]+)(?:\.(\d+))?", "".join(chunks(said, entity)))
    begin = datetime.fromisoformat("2025-06-15T15:06:40")
    return sorted(
        int((datetime.fromisoformat(second) - begin).total_seconds()) * 10**9 + int(rest.ljust(9, "0"))
        for second, rest in found
    )


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("rerun") / "trial.rrd"
    log = record(path)
    assert log.edge_ns == UTC_NS + EDGE_DEVICE_NS + DELAY_NS, "by the block that was least delayed"
    return printed(path)


@pytest.mark.parametrize("entity", ["/force", "/sync", "/markers", "/events"])
def test_there_is_one_timeline(said: str, entity: str) -> None:
    names = {name for chunk in chunks(said, entity) for name in re.findall(r"index_name: (\w+)", chunk)}
    assert names == {TIMELINE}


@pytest.mark.parametrize(("entity", "spacing_ns"), [("/force", 10_000_000), ("/markers", 40_000_000)])
def test_samples_lie_where_their_device_s_clock_puts_them_however_late_they_come(
    said: str, entity: str, spacing_ns: int
) -> None:
    after = [time for time in times_of(said, entity) if time >= EDGE_DEVICE_NS + DELAY_NS]
    assert len(after) >= 25
    assert set(np.diff(after)[1:].tolist()) == {spacing_ns}, (
        "but for the first, which the grid of the display cuts short"
    )


def test_the_edge_the_first_frame_and_the_force_of_that_moment_lie_together(said: str) -> None:
    edge = EDGE_DEVICE_NS + DELAY_NS
    assert edge in times_of(said, "/events")
    assert times_of(said, "/markers")[0] == edge
    assert min(abs(time - edge) for time in times_of(said, "/force")) <= 10_000_000


def test_markers_carry_their_labels_and_a_hidden_one_has_none(said: str) -> None:
    content = "".join(chunks(said, "/markers"))
    assert "cuff_1, rope_1" in content.replace('"', "")
    assert re.search(r"\[cuff_1\]", content.replace('"', "")), "frame 51 lacks rope_1"


def test_a_view_s_eye_sees_the_whole_of_what_is_there(said: str) -> None:
    assert "EyeControls3D:look_target" in said
    points = np.array([[0.14, -0.06, 1.24], [0.34, 0.16, 1.3]])
    extent = SceneExtent.around(points)
    np.testing.assert_allclose(extent.centre, points.mean(axis=0))
    assert extent.diameter == pytest.approx(np.linalg.norm(points[1] - points[0]))
    for up in ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)):
        eye = extent.eye(up)
        position = np.asarray(eye.position.as_arrow_array().to_pylist()[0])  # type: ignore[union-attr]
        away = position - extent.centre
        assert np.linalg.norm(away) == pytest.approx(DISTANCE * extent.diameter)
        assert away @ np.array(up) > 0, "from above"
