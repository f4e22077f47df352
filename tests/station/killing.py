"""Real daemons, each a process of its own, all recording one simulated capture at the wall's own pace until killed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from drivers.simulators.nidaq_server import NiDaqSimulator
from drivers.simulators.qtm_server import QualisysSimulator
from drivers.simulators.settings import DaqClockSettings, settings_from_dict
from drivers.simulators.world import World
from recordings.reader import Recording, open_recording
from recordings.recovery import recover
from station.bench.session_folder import SIMULATED_FOLDER
from tests.timeout import scaled_timeout

LOSS_BOUND_S = 0.5
DAEMONS = 7  # at once: QTM takes ten clients, and one that reconnects counts twice for a moment
PATIENCE_S = 60.0  # wall; a bound on failing runs, not an expectation
ARMED_S = 2.5  # wall, so that the whole pre-roll is there before the edge
RECORD = "from station.cli import main; main()"

CONFIG = """
[daq]
grpc_target = "127.0.0.1:{ni}"
[mocap]
port = {qtm}
[sync]
timeout_s = 600
[cuffs.hand]
anchor_markers = ["anchor_1", "anchor_2", "anchor_3", "anchor_4"]
cuff_markers = ["cuff_1"]
"""


@dataclass(frozen=True)
class Killed:
    """What one daemon left; killed_s is the moment of the kill in seconds after the edge, by the world's clock."""

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
    """A context manager: the servers of one world, in this process, with a DAQ for each daemon."""

    def __init__(self, folder: Path, daemons: int = DAEMONS) -> None:
        self._folder = folder / SIMULATED_FOLDER
        self._folder.mkdir()
        settings = settings_from_dict({"operator": {"capture": "remote"}, "protocol": {"static": {"hold_s": 60.0}}})
        self._world = World(settings)
        self._world.select_trial("hand", "static")
        self._qtm = QualisysSimulator(self._world)
        # Their crystals run true, so that device time at the kill follows from the world's.
        crystal = DaqClockSettings(offset_ppm=0.0, drift_ppm_per_hour=0.0)
        self._daqs = [NiDaqSimulator(self._world, clock=crystal, seed=i) for i in range(daemons)]
        self._running = ExitStack()
        self._rounds = 0

    def __enter__(self) -> KillBench:
        servers: list[NiDaqSimulator | QualisysSimulator] = [self._qtm, *self._daqs]
        for server in servers:
            server.start()
            self._running.callback(server.stop)
            self._world.clock.follow(server)
            self._running.callback(self._world.clock.unfollow, server)
        return self

    def __exit__(self, *_: object) -> None:
        self._running.close()

    def kill(self, instants_s: Sequence[float]) -> list[Killed]:
        """Starts a daemon for each instant (seconds after the edge), and kills it then."""
        self._rounds += 1
        folders = [self._folder / f"round-{self._rounds}-daemon-{i}" for i in range(len(instants_s))]
        with ExitStack() as stack:
            daemons = []
            for folder, daq in zip(folders, self._daqs, strict=False):
                daemon = stack.enter_context(_daemon(folder, daq.port, self._qtm.port))
                stack.callback(daemon.kill)
                _wait_until_armed(daemon, folder)  # seven that start at once would starve each other
                daemons.append(daemon)
            time.sleep(ARMED_S)
            edge_s = self._world.start_capture().start
            killed = []
            for instant_s, daemon, folder in sorted(zip(instants_s, daemons, folders, strict=True), key=lambda x: x[0]):
                time.sleep(max(0.0, edge_s + instant_s - self._world.now()))
                daemon.kill()
                killed.append(Killed(next(folder.glob("*.mcap")), self._world.now() - edge_s))
            self._world.stop_capture()
            return killed


def ensure_contiguous(recording: Recording) -> None:
    """What is left of each stream begins where it should and has no hole."""
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


def _daemon(folder: Path, ni: int, qtm: int) -> subprocess.Popen[bytes]:
    folder.mkdir()
    config = folder / "station.toml"
    config.write_text(CONFIG.format(ni=ni, qtm=qtm), encoding="utf-8")
    arguments = ["--config", config, "--session", folder, "--cuff", "hand", "--test", "static", "--repeat", "1"]
    with (folder / "stderr.txt").open("wb") as words:
        command = [sys.executable, "-c", RECORD, "record", *map(str, arguments)]
        home = {"HOME": str(folder.parent), "USERPROFILE": str(folder.parent)}  # of all rounds
        return subprocess.Popen(command, stderr=words, env={**os.environ, **home})  # noqa: S603


def _wait_until_armed(daemon: subprocess.Popen[Any], folder: Path) -> None:
    give_up_s = time.perf_counter() + scaled_timeout(PATIENCE_S)
    while not any(folder.glob("*.mcap")):
        assert daemon.poll() is None, (folder / "stderr.txt").read_text(encoding="utf-8")
        assert time.perf_counter() < give_up_s, "the daemon did not arm"
        time.sleep(0.02)
