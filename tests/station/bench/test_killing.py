"""What a killed recorder loses, and what the next trial does with the task and the capture that it left."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from drivers.errors import DeviceCode
from drivers.simulators.daq_rpcs import NiDaqSimulator
from drivers.simulators.qtm_server import QualisysSimulator
from drivers.simulators.settings import DaqClockSettings, settings_from_dict
from drivers.simulators.simulated_bench import Bench, ControlServer
from drivers.simulators.world import World
from recordings.reader import Recording, open_recording
from recordings.recovery import recover
from recordings.samples import Event, Item
from station.bench.bench_clock import BenchClock
from station.bench.session_folder import SIMULATED_FOLDER
from station.bench.simulation import SimulatedBench, practice_settings
from station.bench.trial_recorder import TrialRecorder
from station.bench.view import Snapshot, TrialState
from station.config import StationConfig, load_config
from station.protocol import TrialSpec
from tests.drivers.tcp_proxy import TcpProxy
from tests.station.console.served import write_config
from tests.station.session.benched import Recorder, config_at, has_recorded, simulated_bench
from tests.timeout import scaled_timeout

SPEED = 12.0
LOSS_BOUND_S = 0.5
DAEMONS = 7  # at once: QTM takes ten clients, and one that reconnects counts twice for a moment
ARMED_S = 2.5  # world seconds: the pre-roll is complete before the edge
STATIC = TrialSpec("waist", "static", 1)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_kill_leaves_all_but_half_a_second(tmp_path: Path) -> None:
    """Seven daemons are killed one after another. At each kill, the files of those that record on are copied, too: a
    kill would leave the same.
    """
    random = np.random.default_rng(5)
    with KillBench(tmp_path) as bench:
        instants_s = (np.arange(DAEMONS) + random.uniform(size=DAEMONS)) * (10.0 / DAEMONS)
        left = bench.kill(instants_s.tolist())
    for one in left:
        assert max(one.losses_s().values()) <= LOSS_BOUND_S
        ensure_contiguous(open_recording(one.path))
        ensure_recovered(one.path)
    assert len(left) == DAEMONS * (DAEMONS + 1) // 2
    assert max(one.killed_s for one in left) - min(one.killed_s for one in left) > 8.0


@pytest.mark.slow
def test_the_trial_after_four_killed_recorders_is_recorded_and_saves_the_capture_that_they_left(tmp_path: Path) -> None:
    folder = tmp_path / "simulated"
    with simulated_bench(tmp_path / "bench", swing_s=60.0) as (bench, config):
        for kill in range(4):
            with Recorder(config, folder, bench.clock_port) as killed:
                killed.let_go()
                killed.until(has_recorded(0.5 * kill))
                killed.child.process.kill()
                killed.child.process.wait()
        result = record_after_a_kill(bench, config, folder)
    assert not result["lost_samples"], result["sentence"]
    assert result["file"] == "cuff-hand_test-dynamic_run-5.mcap"


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
        config = config_at({**bench.ports, "ni": link.port})
        result = TrialRecorder(config, clock, [breaks]).record(tmp_path, STATIC)
    assert len(breaks.broken_at_s) == 20
    assert result.accepted and result.lost_samples == 0 and result.path is not None, result.sentence
    recording = open_recording(result.path)
    for stream in ("/force", "/sync"):
        assert np.all(np.diff(recording.load(stream).sample_numbers) == 1)
    kinds = [item.kind for item in recording.items() if isinstance(item, Event)]
    assert kinds.count("connection_lost") == kinds.count("connection_restored") == 20


@pytest.mark.slow
def test_the_trial_after_a_killed_recorder_saves_a_capture_that_has_ended_meanwhile(tmp_path: Path) -> None:
    folder = tmp_path / "simulated"
    with simulated_bench(tmp_path / "bench", swing_s=3.0) as (bench, config):
        with Recorder(config, folder, bench.clock_port) as killed:
            killed.until(has_recorded(2.0))
            killed.child.process.kill()
            killed.child.process.wait()
        result = record_after_a_kill(bench, config, folder)
    assert result["file"] == "cuff-hand_test-dynamic_run-2.mcap"


def record_after_a_kill(bench: SimulatedBench, config: StationConfig, folder: Path) -> dict[str, Any]:
    """The result of a trial that is recorded whole, although a killed recorder began a capture."""
    with Recorder(config, folder, bench.clock_port) as recorder:
        recorder.let_go()
        result: dict[str, Any] = recorder.end()["result"]
    assert result["accepted"], result["sentence"]
    assert open_recording(folder / result["file"]).load("/markers").sample_numbers[0] == 1
    assert not (folder / ".capture").exists(), "what it began itself it has ended"
    return result


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


def kill(bench: SimulatedBench) -> None:
    """What remains of the console: the end of its pipe."""
    bench._child.leave()
    bench._child = None


@pytest.mark.slow
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
        process = bench._child.process
        pointed, port = bench.configure(config), bench.clock_port
        with Recorder(pointed, folder / "session", port) as recorder:
            recorder.until(has_recorded(1.0))
            recorder.let_go()
            end(bench)
            result = recorder.end()
        assert result["result"]["accepted"], result
    assert process.wait(scaled_timeout(60.0)) == 0, "alone, the bench ends"


@dataclass(frozen=True)
class RemainingFile:
    """What a kill of one daemon leaves; killed_s is its moment in seconds after the edge, by the world's clock."""

    path: Path
    killed_s: float

    def losses_s(self) -> dict[str, float]:
        """By stream, device time at the kill minus device time of the last readable sample; from the edge on at most.

        Device time at the kill is that of the edge and killed_s more: what waited in the simulators, the sockets, the
        drivers and the daemon counts as lost.
        """
        recording = open_recording(self.path)
        sync = recording.load("/sync")
        edge = np.flatnonzero(sync.values[:, 0] > 2.5)
        losses = {}
        for stream in ("/force", "/sync", "/markers"):
            times_ns = recording.load(stream).device_time_ns
            began_ns = 0 if stream == "/markers" else int(sync.device_time_ns[edge[0]]) if len(edge) else None
            reached_s = (int(times_ns[-1]) - began_ns) * 1e-9 if len(times_ns) and began_ns is not None else 0.0
            losses[stream] = self.killed_s - reached_s
        return losses


class KillBench:
    """A context manager: the servers of one world, in this process, with a DAQ for each daemon.

    The world has the pace of the wall, and waits for a daemon that a busy machine holds up: its loss is then its own.
    """

    def __init__(self, folder: Path, daemons: int = DAEMONS) -> None:
        self._folder = folder / SIMULATED_FOLDER
        self._folder.mkdir()
        settings = settings_from_dict({"operator": {"capture": "remote"}, "protocol": {"static": {"hold_s": 60.0}}})
        self.world = World(settings)
        self.clock, self.start_utc_ns, self.ports = self.world.clock, time.time_ns(), dict[str, int]()
        self.world.select_trial("waist", "static")
        self._qtm = QualisysSimulator(self.world)
        # Their crystals run true, so that device time at the kill follows from the world's.
        crystal = DaqClockSettings(offset_ppm=0.0, drift_ppm_per_hour=0.0)
        self._daqs = [NiDaqSimulator(self.world, clock=crystal, seed=i) for i in range(daemons)]
        self._running = ExitStack()

    def __enter__(self) -> KillBench:
        servers: list[NiDaqSimulator | QualisysSimulator] = [self._qtm, *self._daqs]
        for server in servers:
            server.start()
            self._running.callback(server.stop)
            self.clock.follow(server)
            self._running.callback(self.clock.unfollow, server)
        control = ControlServer(self)
        control.start()
        self._running.callback(control.stop)
        self.ports["clock"] = control.port
        return self

    def __exit__(self, *_: object) -> None:
        self._running.close()

    def sent(self) -> dict[str, dict[int, int | None]]:
        return {"qtm": self._qtm.sent()}

    def pending(self) -> list[str]:
        return ["qtm"] * self._qtm.has_pending_reply

    def kill(self, instants_s: Sequence[float]) -> list[RemainingFile]:
        """Starts a daemon for each instant (seconds after the edge, in order), and kills it then.

        Returns the files of killed daemons, and copies of the files of those that recorded on.
        """
        folders = [self._folder / f"daemon-{i}" for i in range(len(instants_s))]
        with ExitStack() as stack:
            daemons = []
            for folder, daq in zip(folders, self._daqs, strict=True):
                config = config_at({"ni": daq.port, "qtm": self._qtm.port}, sync={"timeout_s": 600.0})
                daemon = stack.enter_context(Recorder(config, folder, self.ports["clock"], spec=STATIC))
                daemon.let_go()
                daemon.until(is_armed)  # seven that start at once would starve each other
                daemons.append(daemon)
            with self.clock.attach("the kills") as world:
                world.advance_to(self.world.now() + ARMED_S)
                edge_s = self.world.start_capture().start
                paths = [next(folder.glob("*.mcap")) for folder in folders]
                left = []
                for number, (instant_s, daemon) in enumerate(zip(instants_s, daemons, strict=True)):
                    killed_s = world.advance_to(edge_s + instant_s) - edge_s  # where the world stands still
                    copies = [shutil.copyfile(path, path.with_stem(f"copy-{number}")) for path in paths[number + 1 :]]
                    daemon.child.process.kill()
                    left += [RemainingFile(path, killed_s) for path in (paths[number], *copies)]
            return left


def is_armed(message: dict[str, Any]) -> bool:
    return message.get("state") == TrialState.ARMED.value


def ensure_contiguous(recording: Recording) -> None:
    """The rest of each stream begins where it should and has no hole."""
    for stream in ("/force", "/sync", "/markers"):
        numbers = recording.load(stream).sample_numbers
        assert (np.diff(numbers) == 1).all()
        assert stream != "/markers" or not len(numbers) or numbers[0] == 1


def ensure_recovered(path: Path) -> None:
    """A recovery gives a file that the mcap package opens by its index, says what is missing, and harms nothing."""
    before = path.read_bytes()
    report = recover(path)
    recovered = report.output.read_bytes()
    assert recover(path) == report
    assert (path.read_bytes(), report.output.read_bytes()) == (before, recovered)
    with report.output.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None and summary.chunk_indexes
        assert sum(1 for _ in reader.iter_messages()) == summary.statistics.message_count
    sentences = "\n".join(report.sentences())
    assert "there is no outcome: the recording was cut" in sentences
    left = open_recording(path)
    for stream in left.streams:
        numbers = left.load(stream.name).sample_numbers
        assert not len(numbers) or f"{stream.name} keeps {len(numbers)} samples, the last is number {numbers[-1]}" in (
            sentences
        )
