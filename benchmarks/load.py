"""The load table of docs/reliability.md: processor time and memory of recording, largest rates, start-up time.

    python -m benchmarks.load [SECONDS]

The daemon (`station record`) and the simulated devices are two processes of this machine. The daemon's share of a core
is measured from its fifth to its last second; its memory is the resident set early and late in the trial.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from recordings.contents import contents_of
from recordings.manifest import TrialOutcome
from recordings.samples import Samples
from recordings.writer import RecordingWriter
from station.bench.session_folder import SIMULATED_FOLDER
from station.bench.simulation import SimulatedBench
from tests.recordings.trials import MANIFEST, STREAMS, frames, scalars

SETTLED_S = 5.0
BLOCK_S = 0.05
STATION = "from station.cli import main; main()"


@dataclass(frozen=True)
class Load:
    """daq_hz is that of each of two channels; seconds are the station's, at most speed times the wall's."""

    name: str
    daq_hz: float
    markers: int
    frame_hz: float
    seconds: float
    speed: float = 1.0


def main(seconds: float) -> None:
    _print_start_up()
    loads = (
        Load("1 kHz × 2, 30 markers at 100 Hz", 1000.0, 30, 100.0, seconds),
        Load("5 kHz × 2, 100 markers at 1 kHz", 5000.0, 100, 1000.0, seconds),
        Load("two hours at most at 30 × real time, 7 markers", 1000.0, 7, 100.0, 120 * seconds, speed=30.0),
    )
    print("\n| load | recorded | wall time | samples | lost | recorder | memory at 5 s | memory at the end | file |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|")
    for load in loads:
        print(_row(load), flush=True)
    print("\n" + _cost_of_syncing())
    print(_growth_of_the_index())


def _print_start_up() -> None:
    """The best of five, to exclude the load of other programs."""
    help_s, processor_s = min(_seconds([sys.executable, "-c", STATION, "--help"]) for _ in range(5))
    print(f"station --help: {help_s:.2f} s, of which {processor_s:.2f} s on the processor")
    with tempfile.TemporaryDirectory() as folder, SimulatedBench({"operator": {"capture": "remote"}}, 1.0, 1) as bench:
        ready_s = min(_ready_after(bench, Path(folder) / SIMULATED_FOLDER / str(attempt)) for attempt in range(5))
    print(f"station record, from its start to armed: {ready_s:.2f} s")


def _seconds(command: list[str]) -> tuple[float, float]:
    """Wall and processor seconds; the latter is 0 on Windows, which does not report it."""
    began_s, before = time.monotonic(), os.times()
    subprocess.run(command, check=True, capture_output=True)  # noqa: S603
    after = os.times()
    processor_s = after.children_user + after.children_system - before.children_user - before.children_system
    return time.monotonic() - began_s, processor_s


def _ready_after(bench: SimulatedBench, session: Path) -> float:
    began_s = time.monotonic()
    daemon = _record(bench, session, [])
    while not any(session.glob("*.mcap")):
        time.sleep(0.005)
    ready_s = time.monotonic() - began_s
    daemon.terminate()
    daemon.wait()
    return ready_s


def _row(load: Load) -> str:
    markers = {f"anchor_{i + 1}": (20.0 * i, 7.0 * (i % 5), 11.0 * (i % 3)) for i in range(load.markers - 3)}
    settings: dict[str, Any] = {
        "mocap": {"rate_hz": load.frame_hz, "anchor_markers_mm": markers},
        "protocol": {"static": {"hold_s": load.seconds}},
    }
    with tempfile.TemporaryDirectory() as folder, SimulatedBench(settings, load.speed, 1) as bench:
        session = Path(folder) / SIMULATED_FOLDER / "session"
        options = ["--duration", f"{load.seconds}"]
        if load.speed != 1:  # on the clock of the bench, unlike a real bench
            options += ["--speed", f"{load.speed}"]
        daemon = psutil.Process(_record(bench, session, options, load.daq_hz).pid)
        wall_s, share, early, late = _watched(daemon)
        (path,) = session.glob("*.mcap")
        contents = contents_of(path)
        samples = sum(stream.samples for stream in contents.streams.values())
        lost = sum(contents.lost(stream) for stream in contents.streams)
        cells = [load.name, f"{load.seconds:.0f} s", f"{wall_s:.0f} s", f"{samples:,}", str(lost)]
        cells += [f"{share:.1%} of a core", f"{early:.0f} MB", f"{late:.0f} MB", f"{path.stat().st_size / 1e6:.1f} MB"]
    return f"| {' | '.join(cells)} |"


def _record(
    bench: SimulatedBench, session: Path, options: list[str], daq_hz: float = 1000.0
) -> subprocess.Popen[bytes]:
    session.mkdir(parents=True)
    config = session / "station.toml"
    config.write_text(
        f"""
        [daq]
        grpc_target = "127.0.0.1:{bench.ready["ports"]["ni"]}"
        sample_rate_hz = {daq_hz}
        [mocap]
        port = {bench.ready["ports"]["qtm"]}
        [simulation.ports]
        clock = {bench.clock_port}
        [cuffs.waist]
        anchor_markers = ["anchor_1", "anchor_2", "anchor_3"]
        cuff_markers = ["cuff_1"]
        """,
        encoding="utf-8",
    )
    trial = ["--cuff", "waist", "--test", "static", "--repeat", "1"]
    command = [sys.executable, "-c", STATION, "record", "--config", str(config), "--session", str(session)]
    with (session / "words.txt").open("wb") as words:
        return subprocess.Popen([*command, *trial, *options], stdout=words, stderr=words)  # noqa: S603


def _watched(daemon: psutil.Process) -> tuple[float, float, float, float]:
    """Wall seconds until the daemon ended, its share of a core, and its memory early and late [MB]."""
    looks: list[tuple[float, float, float]] = []
    began_s = time.monotonic()
    while daemon.is_running() and daemon.status() != psutil.STATUS_ZOMBIE:
        cpu = daemon.cpu_times()
        looks.append((time.monotonic() - began_s, cpu.user + cpu.system, daemon.memory_info().rss / 1e6))
        time.sleep(0.25)
    settled = [look for look in looks if look[0] >= SETTLED_S][:-4]  # the last second closes the file
    (first_s, first_cpu_s, early), (last_s, last_cpu_s, late) = settled[0], settled[-1]
    return looks[-1][0], (last_cpu_s - first_cpu_s) / (last_s - first_s), early, late


def _cost_of_syncing() -> str:
    """Ten seconds of a typical trial, written in real time to the disk of the temporary files."""
    took_s: list[float] = []

    def sync(file: int) -> None:
        began_s = time.monotonic()
        os.fsync(file)
        took_s.append(time.monotonic() - began_s)

    with tempfile.TemporaryDirectory() as folder:
        writer = RecordingWriter(Path(folder) / "a.mcap", MANIFEST, STREAMS, sync=sync)
        for i in range(round(10 / BLOCK_S)):
            items: list[Samples] = [scalars("/force", 50 * i, 50), scalars("/sync", 50 * i, 50), frames(5 * i, 5)]
            for item in items:
                writer.write(item)
            time.sleep(BLOCK_S)
        writer.close(TrialOutcome(True, "closed", "ten seconds"))
    mean_ms, most_ms = 1000 * np.mean(took_s), 1000 * np.max(took_s)
    return f"fsync: {len(took_s)} in 10 s, {mean_ms:.1f} ms each, {most_ms:.1f} ms at most"


def _growth_of_the_index() -> str:
    """An hour of a typical trial with the chunks of real time, by a simulated clock."""
    wall_s, chunk_s = 0.0, 0.1
    with tempfile.TemporaryDirectory() as folder:
        writer = RecordingWriter(Path(folder) / "a.mcap", MANIFEST, STREAMS, clock=lambda: wall_s, sync=lambda _: None)
        items: list[Samples] = [scalars("/force", 0, 100), scalars("/sync", 0, 100), frames(0, 10)]
        for i in range(round(3600 / chunk_s)):
            wall_s = chunk_s * i
            for item in items:
                writer.write(item)
            if i == round(60 / chunk_s):
                early = psutil.Process().memory_info().rss
        grown = psutil.Process().memory_info().rss - early
        writer.close(TrialOutcome(True, "closed", "an hour"))
    return f"an hour's trial at the wall's pace: the writer grows by {grown / 1e6:.1f} MB, the index of its chunks"


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
