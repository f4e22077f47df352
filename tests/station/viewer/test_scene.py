"""Trials, bodies and live values in Rerun, on one timeline, as Rerun's own reader prints them."""

import json
import re
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import rerun as rr

from fitting.trial.analog_signals import AnalogSignals
from recordings.samples import Event, Samples, Stream
from solver.bundled import bundled_model
from solver.suit.suit import read_suit
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.bench.view import Snapshot, TrialState
from station.live.published import LiveFinding
from station.live.subscription import LiveSubscription, find_address
from station.sources import BUNDLED, named_hashes
from station.viewer.scene import LiveScene, emg_rms, log_scene, show_live
from station.viewer.viewer import DISTANCE, TIMELINE, BodyScene, RerunLog, SceneExtent
from tests.station.console.live_source import LiveSource
from tests.station.foreign import static_and_dynamic
from tests.station.wearer import SPECS, WearerSession

FRAMES = 50
COMPONENTS = "scalars|strips|text|positions"
UTC_NS = 1_750_000_000_000_000_000
EDGE_DEVICE_NS = 3_500_000_000
DELAY_NS = 5_000_000
STREAMS = (
    Stream("/force", "V", ("force",), 1000.0, "NI"),
    Stream("/sync", "V", ("sync",), 1000.0, "NI"),
    Stream("/markers", "mm", ("cuff_1", "rope_1"), 100.0, "QTM"),
)


def write_assessment(folder: Path, inputs: dict[str, str]) -> None:
    names = bundled_model().muscle_names
    rows = [",".join(["condition", "cuff", "time_s", *names])]
    rows += [",".join(["both", "hand", f"{t:g}", *["0.3"] * len(names)]) for t in np.linspace(0.0, 7.0, 20)]
    (folder / ACTIVATIONS_FILE).write_text("\n".join(rows) + "\n")
    (folder / ASSESSMENT_FILE).write_text(json.dumps({"inputs": inputs}))


def scene_of(recording: Path, file: Path) -> bytes:
    stream = rr.RecordingStream("test")
    stream.save(file)
    log_scene(stream, recording, UTC_NS, SceneExtent((0.1, 0.2, 1.2), 0.6))
    stream.disconnect()
    return file.read_bytes()


def test_fit_plateaus_body_and_suit_are_in_the_scene(tmp_path: Path) -> None:
    write_assessment(tmp_path, named_hashes(BUNDLED, None, None))
    for truth in static_and_dynamic():
        test = truth.manifest.test
        content = scene_of(truth.record(tmp_path / f"cuff-hand_test-{test}_run-1.mcap"), tmp_path / f"{test}.rrd")
        of_test = b"/fit/plateaus" if test == "static" else b"/fit/predicted"
        for name in (of_test, b"/fit/displacement", b"/body/muscles", b"/body/cord", b"/body/cuffs", b"Force [N]"):
            assert name in content


@pytest.mark.parametrize("is_straight", [False, True])
def test_cuffs_are_at_the_ends_of_any_cord_and_have_the_names_of_the_suit(is_straight: bool) -> None:
    suit = replace(read_suit(), is_straight=is_straight, names={"waist": "heel", "shoulder": "knee", "arm": "shank"})
    recording, model = Mock(spec=["log", "set_time"]), bundled_model()
    coordinates = model.default_coordinates[None]
    BodyScene(recording, model, suit).log(np.zeros(1, np.int64), coordinates, np.zeros((1, len(model.muscles))))
    logged = dict(call.args for call in recording.log.call_args_list)
    cord, cuffs = logged["body/cord"], logged["body/cuffs"]
    line = cord.strips.as_arrow_array().to_pylist()[0]
    assert len(line) == len(suit.parts)
    assert cuffs.positions.as_arrow_array().to_pylist() == [line[0], line[-1]]
    assert cuffs.labels.as_arrow_array().to_pylist() == ["heel", "shank"]


@pytest.mark.parametrize("role", ["model", "motion"])
def test_activations_of_another_body_or_motion_do_not_colour_the_bundled_one(tmp_path: Path, role: str) -> None:
    write_assessment(tmp_path, named_hashes(BUNDLED, None, None) | {role: "another"})
    truth, _ = static_and_dynamic()
    content = scene_of(truth.record(tmp_path / "cuff-hand_test-static_run-1.mcap"), tmp_path / "static.rrd")
    assert b"/fit/plateaus" in content
    assert b"/body" not in content


def test_elevation_and_emg_of_a_motion_are_in_the_scene(wearer: WearerSession, tmp_path: Path) -> None:
    tight = SPECS[-1]
    content = scene_of(wearer.path(tight), tmp_path / "tight.rrd")
    for name in (b"/wearer/elevation_deg", b"/wearer/emg_uv/deltoid", b"/wearer/emg_uv/trapezius", b"EMG RMS"):
        assert name in content
    assert b"/fit/" not in content


def test_the_rms_of_white_noise_is_its_standard_deviation_in_windows_of_a_tenth_of_a_second() -> None:
    numbers = np.arange(10_050)
    noise = np.random.default_rng(2).normal(0.0, [20e-6, 80e-6], (len(numbers), 2)) + 1.0
    emg = AnalogSignals(("a", "b"), "V", 1000.0, numbers, numbers / 1000.0, noise, 0.0)
    time, rms = emg_rms(emg)
    assert time[:2] == pytest.approx([0.0495, 0.1495]), "centres of the windows"
    assert rms.shape == (100, 2)
    assert np.sqrt(np.mean(rms**2, axis=0)) == pytest.approx([20e-6, 80e-6], rel=0.03)


def printed(path: Path, detail: str) -> str:
    words = [sys.executable, "-m", "rerun", "rrd", "print", detail, str(path)]
    return subprocess.run(words, check=True, capture_output=True, encoding="utf-8").stdout  # noqa: S603  (our own words)


def rows_in(file: Path) -> Counter[str]:
    """Rows over time by entity, counted by Rerun's own reader."""
    rows: Counter[str] = Counter()
    for count, name in re.findall(rf"with (\d+) rows .* - /([\w/]+) - .*:(?:{COMPONENTS})\]", printed(file, "-v")):
        rows[name] += int(count)
    return rows


def test_a_live_process_fills_body_curves_and_findings(tmp_path: Path) -> None:
    file = tmp_path / "live.rrd"
    findings = (LiveFinding("live.not_held", "elbow_flexion is an estimate"),)
    with LiveScene(file) as scene:
        with LiveSource(tmp_path, findings=findings) as source:
            address = find_address(tmp_path)
            assert address is not None
            subscription = LiveSubscription(address)
            for _ in range(FRAMES):
                source.publish()
        with subscription:
            show_live(subscription, [scene])
    rows = rows_in(file)
    for name in ("effort/slack", "effort/worn", "cord_force_n/predicted", "cord_force_n/measured", "emg_uv/deltoid"):
        assert rows[f"live/{name}"] == FRAMES, name
    for name in ("muscles", "bones", "cord"):
        assert rows[f"body/{name}"] == FRAMES, "frames are 0.04 s apart"
    assert rows["events"] == 2, "whose body it is, and a finding once"


def test_a_trial_s_force_markers_and_events_are_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "trial.rrd"
    numbers = np.arange(100, dtype=np.uint64)
    times = numbers.astype(np.int64) * 10_000_000
    markers = np.ones((100, 3, 4), dtype=np.float32)
    markers[:, 1] = np.nan
    with RerunLog(path) as log:
        log.offer(Event("armed", "all devices are open", UTC_NS, "station"))
        log.offer(Samples("/force", numbers, times, UTC_NS + 10**9, np.ones((100, 1))))
        log.offer(Samples("/markers", numbers, times, UTC_NS + 10**9, markers))
    content = path.read_bytes()
    assert content[:4] == b"RRF2"
    for name in (b"/force", b"/markers", b"/events"):
        assert name in content
    assert log.dropped == 0


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
            log.offer(Samples("/force", numbers, times, UTC_NS + int(times[-1]), np.ones((50, 1))))
        numbers = np.arange(200, dtype=np.uint64)
        log.offer(Samples("/markers", numbers, numbers.astype(np.int64) * 10_000_000, UTC_NS + 2 * 10**9, frames))
    rows = rows_in(path)
    assert 199 <= rows["force"] <= 202, "a hundred a second"
    assert 49 <= rows["markers"] <= 52, "twenty-five a second"
    assert 24 <= rows["rope"] <= 27, "while both ends are seen"


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
    return printed(path, "-vvv")


@pytest.mark.parametrize("entity", ["/force", "/sync", "/markers", "/events"])
def test_there_is_one_timeline(said: str, entity: str) -> None:
    names = {name for chunk in chunks(said, entity) for name in re.findall(r"index_name: (\w+)", chunk)}
    assert names == {TIMELINE}


@pytest.mark.parametrize(("entity", "spacing_ns"), [("/force", 10_000_000), ("/markers", 40_000_000)])
def test_late_samples_lie_where_the_clock_of_their_device_puts_them(said: str, entity: str, spacing_ns: int) -> None:
    after = [time for time in times_of(said, entity) if time >= EDGE_DEVICE_NS + DELAY_NS]
    assert len(after) >= 25
    assert set(np.diff(after)[1:].tolist()) == {spacing_ns}, (
        "but for the first, which the grid of the display cuts short"
    )


def test_the_edge_lies_with_the_first_frame_and_its_force_and_markers_have_labels(said: str) -> None:
    edge = EDGE_DEVICE_NS + DELAY_NS
    assert edge in times_of(said, "/events")
    assert times_of(said, "/markers")[0] == edge
    assert min(abs(time - edge) for time in times_of(said, "/force")) <= 10_000_000
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
