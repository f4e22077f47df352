"""The recorder's process on a simulated bench: whatever becomes of its console, the trial is kept."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from pathlib import Path

import pytest

from recordings.contents import contents_of
from recordings.reader import open_recording
from recordings.samples import Event
from station.bench.simulation import SimulatedBench
from station.config import StationConfig
from station.journal import read_journal
from station.session.adoption import adopt_recordings
from tests.station.session.benched import Recorder, has_recorded, simulated_bench
from tests.timeout import scaled_timeout

SMALLEST_PIPE = 4096
PATIENCE_S = 120


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SimulatedBench, StationConfig]]:
    with simulated_bench(tmp_path_factory.mktemp("bench")) as both:
        yield both


@pytest.fixture
def config(running: tuple[SimulatedBench, StationConfig]) -> StationConfig:
    """The bench stands ready for one more dynamic trial."""
    running[0].tell({"trial": {"cuff": "hand", "test": "dynamic"}})
    return running[1]


def assert_whole(folder: Path) -> None:
    """One recording, accepted by its recorder, with its line in the journal."""
    (recorded,) = read_journal(folder).recorded
    contents = contents_of(folder / recorded.file)
    assert contents.complete and not contents.gaps
    assert contents.outcome is not None and contents.outcome.accepted
    assert recorded.accepted and recorded.sentence == "the mocap capture ended"


def test_a_trial_is_told_of_while_it_runs_and_marked_where_asked(
    running: tuple[SimulatedBench, StationConfig], config: StationConfig, tmp_path: Path
) -> None:
    with Recorder(config, tmp_path, running[0].clock_port) as recorder:
        said = recorder.until(has_recorded(4.0))
        recorder.wish({"mark": True})
        assert said["streams"]["/force"]["nominal_hz"] == 1000
        assert said["disk_left_s"] > 0
        assert all(said["seen"].values()) and said["force"] and said["displacement"]
        result = recorder.end()["result"]
        assert recorder.child.wait(scaled_timeout(PATIENCE_S)) == 0
        assert recorder.errors() == ""
    assert_whole(tmp_path)
    events = [item for item in open_recording(tmp_path / result["file"]).items() if isinstance(item, Event)]
    assert [event.text for event in events if event.kind == "mark"] == ["mark 1"]


@pytest.mark.slow
def test_a_console_that_stops_reading_costs_nothing(
    running: tuple[SimulatedBench, StationConfig], config: StationConfig, tmp_path: Path
) -> None:
    with Recorder(config, tmp_path, running[0].clock_port) as recorder:
        recorder.let_go()
        assert recorder.child.stdout is not None
        fcntl.fcntl(recorder.child.stdout, fcntl.F_SETPIPE_SZ, SMALLEST_PIPE)
        assert recorder.child.wait(scaled_timeout(PATIENCE_S)) == 0
    assert_whole(tmp_path)


def test_a_console_that_is_killed_costs_nothing(
    running: tuple[SimulatedBench, StationConfig], config: StationConfig, tmp_path: Path
) -> None:
    with Recorder(config, tmp_path, running[0].clock_port) as recorder:
        recorder.until(has_recorded(2.0))
        recorder.let_go()
        assert recorder.child.stdin is not None and recorder.child.stdout is not None
        recorder.child.stdin.close()
        recorder.child.stdout.close()
        assert recorder.child.wait(scaled_timeout(PATIENCE_S)) == 0
        assert recorder.errors() == ""
    assert_whole(tmp_path)


def test_what_a_killed_recorder_left_is_made_whole_and_waits_for_a_decision(tmp_path: Path) -> None:
    with (
        simulated_bench(tmp_path / "bench") as (bench, config),
        Recorder(config, tmp_path, bench.clock_port) as recorder,
    ):
        recorder.until(has_recorded(4.0))
        adopt_recordings(tmp_path)
        assert read_journal(tmp_path).recorded == (), "a recorder that is at work speaks for itself"
        recorder.child.kill()
        recorder.child.wait()
    for _ in range(2):
        adopt_recordings(tmp_path)
    (recorded,) = read_journal(tmp_path).recorded
    assert recorded.file.endswith(".recovered.mcap")
    assert not recorded.accepted
    assert recorded.sentence.startswith("the recorder was killed in mid trial; ")
    assert contents_of(tmp_path / recorded.file).streams["/force"].samples > 1000


def test_a_second_start_is_refused_and_the_first_goes_on_until_it_is_stopped(
    running: tuple[SimulatedBench, StationConfig], config: StationConfig, tmp_path: Path
) -> None:
    port = running[0].clock_port
    with Recorder(config, tmp_path, port) as recorder, Recorder(config, tmp_path, begins_at_once=False) as second:
        recorder.until(has_recorded(1.0))
        second.begin()
        assert second.end()["refused"].startswith("another trial is being recorded into ")
        recorder.wish({"stop": True})
        assert recorder.end()["result"]["sentence"] == "stopped by the operator"
    (recorded,) = read_journal(tmp_path).recorded
    assert recorded.accepted and not recorded.lost_samples


def test_a_stop_while_armed_records_nothing(running: tuple[SimulatedBench, StationConfig], tmp_path: Path) -> None:
    data = running[1].model_dump(mode="json")
    data["mocap"]["control"] = "none"
    with Recorder(StationConfig(**data), tmp_path, running[0].clock_port) as recorder:
        recorder.until(lambda said: said["state"] == "armed")
        recorder.wish({"stop": True})
        result = recorder.end()["result"]
    assert result["sentence"] == "cancelled by the operator before the sync edge; nothing was recorded"
    assert result["file"] == "" and read_journal(tmp_path).recorded == ()
    assert not list(tmp_path.glob("*.mcap"))


def test_a_device_that_is_lost_in_mid_trial_is_named_and_the_recording_kept(tmp_path: Path) -> None:
    with (
        simulated_bench(tmp_path / "bench") as (bench, config),
        Recorder(config, tmp_path, bench.clock_port) as recorder,
    ):
        recorder.until(has_recorded(4.0))
        bench.tell({"fault": {"device": "ni", "fault": "unplug", "for_s": 200.0}})
        result = recorder.end()["result"]
    assert not result["accepted"] and result["file"]
    assert "Dev1" in result["sentence"]
    assert contents_of(tmp_path / result["file"]).complete
    assert read_journal(tmp_path).recorded[0].sentence == result["sentence"]
