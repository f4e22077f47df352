"""A recording through its simulated devices again: the same samples at the same times."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from recordings.errors import RecordingError
from recordings.reader import open_recording
from recordings.recovery import recover
from station.bench.bench_clock import BenchClock
from station.bench.simulation import simulator_settings
from station.bench.trial_recorder import TrialRecorder
from station.config import parse_config
from station.files.timed_replay import replay
from station.fit import fit_session_folder
from station.protocol import TrialSpec
from tests.station.bench.test_trial_recorder import SPEC, Rig
from tests.station.session.benched import ThreadedBench

AGAIN_SPEED = 500.0
CUFF = {
    "anchor_markers": ["anchor_1", "anchor_2", "anchor_3", "anchor_4"],
    "cuff_markers": ["cuff_1"],
    "rope_markers": ["rope_1", "rope_2"],
}


@pytest.mark.parametrize("duration_s", [None, 3.0], ids=["whole", "stopped by the operator"])
def test_a_replay_has_the_same_trial_samples_and_times(tmp_path: Path, duration_s: float | None) -> None:
    recorded = Rig().recorder().record(tmp_path / "live", SPEC, duration_s=duration_s).path
    assert recorded is not None
    result = replay(recorded, tmp_path / "again", AGAIN_SPEED)
    assert result.accepted, result.sentence
    assert result.path is not None
    before, after = open_recording(recorded), open_recording(result.path)
    manifest = after.manifest
    assert manifest.start_utc_ns == before.manifest.start_utc_ns, "the order of trials stays"
    assert TrialSpec(manifest.cuff.name, manifest.test, manifest.repeat, manifest.donning) == SPEC
    for stream in ("/force", "/sync", "/markers"):
        once, again = before.load(stream), after.load(stream)
        assert np.array_equal(once.sample_numbers, again.sample_numbers)
        assert np.array_equal(once.device_time_ns, again.device_time_ns)
        assert np.array_equal(once.values, again.values, equal_nan=True)


def test_an_empty_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "none.mcap"
    path.write_bytes(b"")
    with pytest.raises(RecordingError):
        replay(path, tmp_path / "again", AGAIN_SPEED)


@pytest.mark.slow
def test_live_recovered_and_replayed_give_the_same_fit_bit_for_bit(tmp_path: Path) -> None:
    live, recovered, replayed = (tmp_path / name for name in ("live", "recovered", "replayed"))
    for spec, path in record_pair(live):
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(path.read_bytes()[:-8])  # the closing magic is gone, the samples are there
        recovered.mkdir(exist_ok=True)
        recover(cut, recovered / spec.file_name(1))
        again = replay(path, replayed, AGAIN_SPEED)
        assert again.accepted and not again.lost_samples, again.sentence
    fits = [fit_session_folder(folder, None).cuffs["hand"] for folder in (live, recovered, replayed)]
    assert fits[0].stiffness is not None and fits[0].damping is not None
    for fit in fits[1:]:
        assert (fit.stiffness, fit.damping, fit.migration) == (fits[0].stiffness, fits[0].damping, fits[0].migration)


def record_pair(folder: Path) -> Iterator[tuple[TrialSpec, Path]]:
    """A static and a dynamic trial of the hand cuff on a simulated bench."""
    config = parse_config(
        {
            "cuffs": {"hand": CUFF},
            "mocap": {"control": "start"},
            "simulation": {
                "protocol": {"static": {"step_masses_kg": [2.0, 2.0], "hold_s": 5.0}, "dynamic": {"swing_s": 8.0}}
            },
        },
        "the test",
    )
    with ThreadedBench(simulator_settings(config), None, 5) as bench:
        for test in ("static", "dynamic"):
            bench.request({"trial": {"cuff": "hand", "test": test}})
            spec = TrialSpec("hand", test, 1)
            with BenchClock(bench.clock_port) as clock:
                result = TrialRecorder(bench.configure(config), clock).record(folder, spec)
            assert result.path is not None and not result.lost_samples, result.sentence
            yield spec, result.path
