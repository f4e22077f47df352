"""A simulated bench stays for the trial that is recorded when its console ends, as a real one does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from station.bench.simulation import SimulatedBench, practice_settings
from station.config import load_config
from tests.station.console.served import write_config
from tests.station.session.benched import Recorder, has_recorded
from tests.timeout import scaled_timeout

SPEED = 12.0


def kill(bench: SimulatedBench) -> None:
    """What remains of the console: the end of its pipe."""
    assert bench._child is not None
    bench._child.leave()
    bench._child = None


@pytest.mark.parametrize("end", [kill, SimulatedBench.close], ids=["killed", "closed"])
def test_a_trial_is_recorded_to_its_end_when_the_console_ends(
    tmp_path: Path, end: Callable[[SimulatedBench], None]
) -> None:
    folder = tmp_path / "simulated"
    folder.mkdir()
    config = load_config(write_config(folder, swing_s=8.0))
    with SimulatedBench(practice_settings(config), SPEED, 3, outlives=True) as bench:
        bench.request({"don": "hand"})
        bench.request({"trial": {"cuff": "hand", "test": "dynamic"}})
        assert bench._child is not None
        process = bench._child.process
        pointed, port = bench.configure(config), bench.clock_port
        with Recorder(pointed, folder / "session", port) as recorder:
            recorder.until(has_recorded(1.0))
            recorder.let_go()
            end(bench)
            result = recorder.end()
        assert result["result"]["accepted"], result
    assert process.wait(scaled_timeout(60.0)) == 0, "alone, the bench ends"
