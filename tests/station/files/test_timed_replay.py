"""A recording through its simulated devices again: the same samples at the same times."""

from pathlib import Path

import numpy as np
import pytest

from recordings.errors import RecordingError
from recordings.reader import open_recording
from station.files.timed_replay import replay
from station.protocol import TrialSpec
from tests.station.bench.test_trial_recorder import SPEC, Rig

AGAIN_SPEED = 500.0


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
