from __future__ import annotations

import io
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recordings.manifest import CuffSite, LoadCell
from recordings.samples import Event, Item, Loss, Samples, Stream
from station.bench.live_displacement import LiveDisplacement
from station.bench.snapshot import Snapshot, TrialState
from station.protocol import TrialSpec
from station.session.guide import StaticGuide
from station.session.live import Live
from station.session.telemetry import Telemetry

ANCHOR = ("anchor_1", "anchor_2", "anchor_3")
LABELS = (*ANCHOR, "cuff_1", "rope_1", "rope_2")
CUFF = CuffSite("hand", "arm", ANCHOR, ("cuff_1",), ("rope_1", "rope_2"))
CELL = LoadCell("daq", 100.0, -1)
STREAMS = (Stream("/force", "V", ("force",), 1000.0, "NI"), Stream("/markers", "mm", LABELS, 100.0, "QTM"))
AT_REST = np.array([[0, 0, 0], [100, 0, 0], [0, 100, 0], [50, 50, 50], [60, 50, 50], [160, 50, 50]], np.float64)
RNG = np.random.default_rng(11)


def moved(frames: int, way_mm: float, rope: bool = True) -> np.ndarray:
    """Frames in which the cuff is so far along the rope (+x) while the whole body turns and sways."""
    points = np.tile(AT_REST, (frames, 1, 1))
    points[:, 3:, 0] += way_mm
    for frame in points:
        angle, sway = RNG.normal(0, 0.05), RNG.normal(0, 30, 3)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        frame[:] = frame @ turn.T + sway
    return points


def test_displacement_is_along_the_rope_whatever_the_body_does() -> None:
    live = LiveDisplacement(CUFF, LABELS)
    assert live.take(moved(30, 0.0))[-1] == pytest.approx(0.0, abs=0.1)
    assert live.take(moved(5, 7.5)) == pytest.approx(7.5, abs=0.1)


def test_without_rope_markers_it_is_along_the_way_that_the_cuff_went() -> None:
    live = LiveDisplacement(CuffSite("hand", "arm", ANCHOR, ("cuff_1",)), LABELS)
    live.take(moved(30, 0.0))
    assert live.take(moved(5, 7.5)) == pytest.approx(7.5, abs=0.1)
    assert live.take(moved(5, -2.0)) == pytest.approx(-2.0, abs=0.1), "the direction keeps its sign"


def test_a_cuff_out_of_sight_has_no_displacement_and_none_is_made_up() -> None:
    live = LiveDisplacement(CUFF, LABELS)
    live.take(moved(30, 0.0))
    hidden = moved(4, 3.0)
    hidden[1:3, 3] = np.nan
    assert np.isnan(live.take(hidden)).tolist() == [False, True, True, False]


def test_an_anchor_of_two_markers_gives_nothing() -> None:
    live = LiveDisplacement(CuffSite("hand", "arm", ANCHOR[:2], ("cuff_1",)), LABELS)
    assert np.isnan(live.take(moved(40, 0.0))).all()


class Told:
    """A telemetry view driven by hand, and the lines it wrote."""

    def __init__(self, folder: Path, out: io.StringIO | None = None) -> None:
        self.out = out or io.StringIO()
        self.view = Telemetry(self.out, CUFF, CELL, folder)
        self.view.show(Snapshot(TrialState.RECORDING, "recording", 4.9, 0.0, 3.0, 2, 1, STREAMS))

    def line(self, *items: Item) -> dict[str, Any]:
        for item in items:
            self.view.offer(item)
        self.view._refresh()
        said: dict[str, Any] = json.loads(self.out.getvalue().splitlines()[-1])
        return said


def force(start_s: float, seconds: float, volts: float) -> Samples:
    numbers = np.arange(round(1000 * start_s), round(1000 * (start_s + seconds)), dtype=np.uint64)
    times = numbers.astype(np.int64) * 1_000_000
    return Samples("/force", numbers, times, int(times[-1]) + 5_000_000, np.full((len(numbers), 1), volts))


def markers(start_s: float, values: np.ndarray) -> Samples:
    numbers = np.arange(len(values), dtype=np.uint64) + round(100 * start_s)
    times = numbers.astype(np.int64) * 10_000_000
    with_residual = np.concatenate([values, np.zeros((*values.shape[:2], 1))], axis=2).astype(np.float32)
    return Samples("/markers", numbers, times, int(times[-1]) + 5_000_000, with_residual)


def test_a_line_tells_state_force_in_newtons_and_what_is_lost(tmp_path: Path) -> None:
    said = Told(tmp_path).line(force(0.0, 0.1, -0.25))
    assert (said["state"], said["sync_v"], said["lost_samples"], said["marks"]) == ("recording", 4.9, 2, 1)
    assert 3 <= len(said["force"]) <= 6, "a curve for the eye, not a kilohertz"
    assert {newtons for _, newtons in said["force"]} == {25.0}


def test_rates_are_by_station_time_and_beside_their_nominal(tmp_path: Path) -> None:
    told = Told(tmp_path)
    for block in range(10):
        said = told.line(force(0.1 * block, 0.1, 0.0))
    assert said["streams"]["/force"]["rate_hz"] == pytest.approx(1000, rel=0.02)
    assert said["streams"]["/force"]["nominal_hz"] == 1000


def test_a_hidden_marker_is_named_and_leaves_no_point(tmp_path: Path) -> None:
    told = Told(tmp_path)
    told.line(markers(0.0, moved(30, 0.0)))
    hidden = moved(4, 3.0)
    hidden[:, 3] = np.nan
    said = told.line(markers(0.3, hidden))
    assert [name for name, is_seen in said["seen"].items() if not is_seen] == ["cuff_1"]
    assert said["points"][3] is None and said["points"][4] == pytest.approx(hidden[-1, 4], abs=0.06)
    assert said["displacement"] == []


def test_what_the_devices_say_is_passed_on_in_words(tmp_path: Path) -> None:
    said = Told(tmp_path).line(
        Event("capture_started", "capture started", 0, "QTM"), Loss("/force", "overrun", 5, 40, 0, 0)
    )
    assert said["words"] == ["capture started", "lost 40 samples of /force: overrun"]


def test_the_disk_lasts_as_long_as_its_room_at_the_rate_that_was_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("station.session.telemetry.bytes_free", lambda folder: 210_000_000)
    told = Told(tmp_path)
    assert told.line()["disk_left_s"] is None
    for block in range(30):
        said = told.line(force(0.1 * block, 0.1, 0.0))
    assert said["disk_left_s"] == pytest.approx((210e6 - 50e6) / 16e3, rel=0.05), "16 bytes a sample, a kilohertz"


def test_a_console_that_is_gone_is_no_error(tmp_path: Path) -> None:
    told = Told(tmp_path)
    told.out.close()
    for block in range(3):
        told.view.offer(force(0.1 * block, 0.1, -0.25))
        told.view._refresh()
    told.view._out = told.out = io.StringIO()
    said = told.line(force(0.3, 0.1, -0.25))
    assert said["streams"]["/force"]["samples"] == 400 and said["dropped"] == 0, "it looked on all the while"


def test_a_view_that_nobody_reads_drops_and_says_how_much(tmp_path: Path) -> None:
    told = Told(tmp_path)
    for _ in range(2100):
        told.view.offer(Event("note", "x", 0, "QTM"))
    assert told.line()["dropped"] == 100


def test_the_curves_begin_at_the_sync_edge(tmp_path: Path) -> None:
    told = Told(tmp_path)
    numbers = np.arange(4000, 5000, dtype=np.uint64)
    sync = Samples("/sync", numbers, numbers.astype(np.int64) * 1_000_000, 5_004_000_000, np.zeros((1000, 1)))
    assert told.line(force(4.0, 1.0, 0.1), sync)["edge_s"] is None
    shown = Snapshot(TrialState.RECORDING, "recording", 4.9, 0.0, 3.0, 2, 1, STREAMS, edge_device_ns=4_250_000_000)
    told.view.show(shown)
    said = told.line()
    live = Live(TrialSpec("hand", "static", 1), StaticGuide((), 1.0))
    live.latest = said
    at_edge_s = said["edge_s"]
    assert live.from_edge([(at_edge_s - 0.5, 1.0), (at_edge_s, 2.0), (at_edge_s + 1.5, 3.0)]) == [
        (-0.5, 1.0),
        (0.0, 2.0),
        (1.5, 3.0),
    ]
    assert at_edge_s == pytest.approx(-0.749), "a quarter of a second into a block whose last sample came at time 0"
    live.latest = {**said, "edge_s": None}
    assert live.from_edge([(7.0, 1.0), (9.0, 2.0)]) == [(-2.0, 1.0), (0.0, 2.0)]


def test_a_line_says_when_it_was_written(tmp_path: Path) -> None:
    before = time.time()
    assert before <= Told(tmp_path).line()["at"] <= time.time()
