"""What the next trial does with a capture that runs: it ends the one that a killed recorder left, and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.errors import DeviceCode
from recordings.reader import open_recording
from tests.station.session.benched import Recorder, has_recorded, simulated_bench

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("swing_s", [3.0, 60.0], ids=["which has ended meanwhile", "which still runs"])
def test_the_trial_after_a_killed_recorder_saves_the_capture_that_it_left(tmp_path: Path, swing_s: float) -> None:
    folder = tmp_path / "simulated"
    with simulated_bench(tmp_path / "bench", swing_s=swing_s) as (bench, config):
        with Recorder(config, folder, bench.clock_port) as killed:
            killed.until(has_recorded(2.0))
            killed.child.process.kill()
            killed.child.process.wait()
        with Recorder(config, folder, bench.clock_port) as recorder:
            recorder.let_go()
            result = recorder.end()["result"]
    assert result["accepted"], result["sentence"]
    assert result["file"] == "cuff-hand_test-dynamic_run-2.mcap"
    assert open_recording(folder / result["file"]).load("/markers").sample_numbers[0] == 1
    assert not (folder / ".capture").exists(), "what it began itself it has ended"


def test_a_capture_of_another_session_is_reported_and_not_stopped(tmp_path: Path) -> None:
    folder = tmp_path / "simulated"
    with simulated_bench(tmp_path / "bench", swing_s=200.0) as (bench, config):
        with Recorder(config, folder / "theirs", bench.clock_port) as theirs:
            theirs.until(has_recorded(2.0))
            theirs.child.process.kill()
            theirs.child.process.wait()
        with Recorder(config, folder / "ours", bench.clock_port) as recorder:
            code = recorder.end()["code"]
    assert code == DeviceCode.CAPTURE_NOT_OURS
    assert not list((folder / "ours").glob("*.mcap"))
