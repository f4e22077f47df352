"""What a killed recorder loses, and what the next trial does with the task and the capture that it left."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DeviceCode
from drivers.simulators.simulated_bench import Bench
from recordings.reader import open_recording
from recordings.samples import Event, Item
from station.bench.bench_clock import BenchClock
from station.bench.simulation import SimulatedBench, practice_settings
from station.bench.trial_recorder import TrialRecorder
from station.bench.view import Snapshot, TrialState
from station.config import StationConfig, load_config, parse_config
from station.protocol import TrialSpec
from tests.drivers.tcp_proxy import TcpProxy
from tests.station.console.served import write_config
from tests.station.killing import DAEMONS, LOSS_BOUND_S, KillBench, ensure_contiguous, ensure_recovered
from tests.station.session.benched import Recorder, has_recorded, simulated_bench
from tests.timeout import scaled_timeout


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_twenty_killed_daemons_leave_all_but_half_a_second(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    with KillBench(tmp_path) as bench:
        rounds = np.array_split(random.uniform(0, 10, 20), math.ceil(20 / DAEMONS))
        killed = [one for instants_s in rounds for one in bench.kill(instants_s.tolist())]
    for one in killed:
        assert max(one.losses_s().values()) <= LOSS_BOUND_S
        ensure_contiguous(open_recording(one.path))
        ensure_recovered(one.path)
    assert len(killed) == 20
    assert max(one.killed_s for one in killed) - min(one.killed_s for one in killed) > 8.0


@pytest.mark.slow
def test_the_trial_after_eight_killed_recorders_is_recorded(tmp_path: Path) -> None:
    with simulated_bench(tmp_path / "bench", swing_s=60.0) as (bench, config):
        for kill in range(8):
            with Recorder(config, tmp_path / "simulated" / "monday", bench.clock_port) as killed:
                killed.let_go()
                killed.until(has_recorded(0.25 * kill))
                killed.child.process.kill()
                killed.child.process.wait()
        with Recorder(config, tmp_path / "simulated" / "monday", bench.clock_port) as recorder:
            recorder.let_go()
            result = recorder.end()["result"]
    assert result["accepted"] and not result["lost_samples"], result["sentence"]
    assert result["file"] == "cuff-hand_test-dynamic_run-9.mcap"


class Breaks:
    """A view that breaks the link each time another half second is recorded, and mends it at the next look."""

    def __init__(self, link: TcpProxy, times: int) -> None:
        self._link, self._left, self.broken_at_s = link, times, list[float]()
        self._is_broken = False

    def offer(self, item: Item) -> None:
        if self._is_broken and isinstance(item, Event) and item.kind == "connection_lost":
            self._link.listen()
            self._is_broken = False

    def show(self, snapshot: Snapshot) -> None:
        since_s = snapshot.recorded_s - (self.broken_at_s[-1] if self.broken_at_s else 0.0)
        if snapshot.state is TrialState.RECORDING and since_s > 0.5 and self._left and not self._is_broken:
            self._left -= 1
            self._is_broken = True
            self.broken_at_s.append(snapshot.recorded_s)
            self._link.refuse()


def test_a_trial_continues_without_a_loss_over_twenty_broken_connections(
    simulated_bench: Callable[..., Bench], tmp_path: Path
) -> None:
    bench = simulated_bench(protocol={"static": {"lead_in_s": 1.0, "hold_s": 10.0, "step_masses_kg": [3.0]}})
    with TcpProxy(bench.ports["ni"]) as link, BenchClock(bench.ports["clock"]) as clock:
        breaks = Breaks(link, 20)
        config = config_for(link.port, bench.ports["qtm"])
        result = TrialRecorder(config, clock, [breaks]).record(tmp_path, TrialSpec("waist", "static", 1))
    assert len(breaks.broken_at_s) == 20
    assert result.accepted and result.lost_samples == 0 and result.path is not None, result.sentence
    recording = open_recording(result.path)
    for stream in ("/force", "/sync"):
        assert np.all(np.diff(recording.load(stream).sample_numbers) == 1)
    kinds = [item.kind for item in recording.items() if isinstance(item, Event)]
    assert kinds.count("connection_lost") == kinds.count("connection_restored") == 20


def config_for(ni: int, qtm: int) -> StationConfig:
    cuff = {"anchor_markers": ["anchor_1", "anchor_2", "anchor_3"], "cuff_markers": ["cuff_1"]}
    return parse_config(
        {"daq": {"grpc_target": f"127.0.0.1:{ni}"}, "mocap": {"port": qtm}, "cuffs": {"waist": cuff}}, "test"
    )


@pytest.mark.slow
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


@pytest.mark.slow
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


# A simulated bench stays for the trial that is recorded when its console ends, as a real one does.


SPEED = 12.0


def kill(bench: SimulatedBench) -> None:
    """What remains of the console: the end of its pipe."""
    assert bench._child is not None
    bench._child.leave()
    bench._child = None


@pytest.mark.parametrize(
    "end", [kill, pytest.param(SimulatedBench.close, marks=pytest.mark.slow)], ids=["killed", "closed"]
)
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
