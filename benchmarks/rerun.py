"""What showing a trial in Rerun costs the recorder: the same simulated trial without it, into a file, and to a viewer.

    python -m benchmarks.rerun [SECONDS] [ROUNDS]

Processor time of `station record`, all its threads, from its fifth second on, in % of a core; the three take turns, and
the least of the rounds counts. The viewer is Rerun's own server without its window, so that no display is needed.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from station.bench.simulation import SimulatedBench

SETTLED_S, ENDING_S = 5.0, 1.0
BOUND = 3.0
"""% of a core, what the issue allows."""
RECORD = """
import sys
import station.rerun.log
from station.cli import main

address = sys.argv.pop()
station.rerun.log.start_viewer = lambda: address
main()
"""
WAYS = {"no Rerun": [], "--rrd FILE": ["--rrd", "trial.rrd"], "--rerun": ["--rerun"]}
CUFF = """
[daq]
grpc_target = "127.0.0.1:{ni}"
[mocap]
port = {qtm}
[cuffs.waist]
anchor_markers = ["anchor_1", "anchor_2", "anchor_3", "anchor_4"]
cuff_markers = ["cuff_1"]
rope_markers = ["rope_1", "rope_2"]
"""


def main(seconds: float, rounds: int) -> None:
    with viewer_without_window() as address:
        shares = {way: min(_share(options, address, seconds) for _ in range(rounds)) for way, options in WAYS.items()}
    plain = shares["no Rerun"]
    print("| the daemon of a trial of 7 markers at 100 Hz, 2 channels at 1 kHz | % of a core | Rerun's part |")
    print("|---|---:|---:|")
    for way, share in shares.items():
        print(f"| {way} | {share:.2f} | {share - plain:+.2f} |")
    most = max(shares.values()) - plain
    print(f"\nRerun takes {most:.2f} % of a core, {'under' if most < BOUND else 'NOT UNDER'} {BOUND:.0f} %")


@contextmanager
def viewer_without_window() -> Iterator[str]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ["--serve-grpc", "--bind", "127.0.0.1", "--port", str(port), "--server-memory-limit", "500MB"]
    server = subprocess.Popen(  # noqa: S603  (our own words)
        [sys.executable, "-m", "rerun", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "RERUN_ANALYTICS_ENABLED": "false"},
    )
    try:
        while socket.socket().connect_ex(("127.0.0.1", port)):
            if server.poll() is not None:
                raise SystemExit("Rerun's server did not start")
            time.sleep(0.1)
        yield f"rerun+http://127.0.0.1:{port}/proxy"
    finally:
        server.terminate()
        server.wait()


def _share(options: list[str], address: str, seconds: float) -> float:
    settings = {"protocol": {"static": {"hold_s": seconds}}}
    with tempfile.TemporaryDirectory() as name, SimulatedBench(settings, 1.0, 1) as bench:
        folder = Path(name)
        (folder / "station.toml").write_text(CUFF.format(**bench.ready["ports"]), encoding="utf-8")
        trial = ["--session", "session", "--cuff", "waist", "--test", "static", "--duration", f"{seconds}"]
        child = subprocess.Popen(  # noqa: S603  (our own words)
            [sys.executable, "-c", RECORD, "record", "--config", "station.toml", *trial, *options, address],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        looks = list(_looks(psutil.Process(child.pid)))
        if child.wait() != 0:
            raise SystemExit(f"the trial with {options} ended with code {child.returncode}")
    settled = [look for look in looks if look[0] > SETTLED_S and look[0] < looks[-1][0] - ENDING_S]
    (first_s, first_cpu_s), (last_s, last_cpu_s) = settled[0], settled[-1]
    return 100 * (last_cpu_s - first_cpu_s) / (last_s - first_s)


def _looks(daemon: psutil.Process) -> Iterator[tuple[float, float]]:
    """Wall and processor seconds until it ends."""
    began_s = time.monotonic()
    while daemon.is_running() and daemon.status() != psutil.STATUS_ZOMBIE:
        used = daemon.cpu_times()
        yield time.monotonic() - began_s, used.user + used.system
        time.sleep(0.25)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0, int(sys.argv[2]) if len(sys.argv) > 2 else 3)
