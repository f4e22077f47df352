"""Cost of showing a trial in Rerun: processor time of its threads in the recorder, for a file and for a viewer.

    python -m benchmarks.rerun [SECONDS]

Times are read from the kernel by thread (schedstat, in ns), in % of a core from the fifth second of the trial, beside
all other threads of `station record`. Times by thread are less sensitive to other load than the difference of two runs.
The viewer is Rerun's server without a window, so that no display is needed. Linux only.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from station.bench.simulation import SimulatedBench

SETTLED_S = 5.0
BOUND = 3.0
"""Largest share accepted [% of a core]."""
OURS = "rerun log"
RERUNS = ("tokio-rt-worker", "jemalloc_bg_thd", "ChunkBatcher", "RecordingStream", "file_writer", "message_proxy")
"""Prefixes of the names of Rerun's threads."""
RECORD = """
import sys
from pathlib import Path
import station.viewer.log as log
from station.cli import main

def run(view, run=log.RerunLog._run):
    Path("/proc/thread-self/comm").write_text(view._thread.name)
    run(view)

address = sys.argv.pop()
log.start_viewer = lambda: address
log.RerunLog._run = run
main()
"""
WAYS = {"--rrd FILE": ["--rrd", "trial.rrd"], "--rerun": ["--rerun"]}
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


def main(seconds: float) -> None:
    title = "7 markers at 100 Hz, 2 channels at 1 kHz"
    print(f"| {title} | our thread | Rerun's threads | both | other threads of the recorder |")
    print("|---|---:|---:|---:|---:|")
    most = 0.0
    with viewer_without_window() as address:
        for way, options in WAYS.items():
            shares = _shares(options, address, seconds)
            ours = shares.pop(OURS)
            reruns = sum(share for name, share in shares.items() if name.startswith(RERUNS))
            others = sum(shares.values()) - reruns
            print(f"| {way} | {ours:.2f} % | {reruns:.2f} % | {ours + reruns:.2f} % | {others:.2f} % |", flush=True)
            most = max(most, ours + reruns)
    print(f"\nRerun takes {most:.2f} % of a core, {'under' if most < BOUND else 'NOT UNDER'} {BOUND:.0f} %")


@contextmanager
def viewer_without_window() -> Iterator[str]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = ["--serve-grpc", "--bind", "127.0.0.1", "--port", str(port), "--server-memory-limit", "500MB"]
    server = subprocess.Popen(  # noqa: S603  (our own options)
        [sys.executable, "-m", "rerun", *options],
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


def _shares(options: list[str], address: str, seconds: float) -> Counter[str]:
    """In % of a core, by the name of the thread; what is handed to our thread costs the others an append a block."""
    settings = {"protocol": {"static": {"hold_s": seconds}}}
    with tempfile.TemporaryDirectory() as name, SimulatedBench(settings, 1.0, 1) as bench:
        folder = Path(name)
        (folder / "station.toml").write_text(CUFF.format(**bench.ready["ports"]), encoding="utf-8")
        trial = ["--session", "simulated/session", "--cuff", "waist", "--test", "static", "--duration", f"{seconds}"]
        child = subprocess.Popen(  # noqa: S603  (our own options)
            [sys.executable, "-c", RECORD, "record", "--config", "station.toml", *trial, *options, address],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        looks = list(_looks(child))
        if child.wait() != 0:
            raise SystemExit(f"the trial with {options} ended with code {child.returncode}")
    logging = [look for look in looks if look[0] > SETTLED_S and any(name == OURS for _, name in look[1])]
    (first_s, first), (last_s, last) = logging[0], logging[-1]
    shares: Counter[str] = Counter()
    for thread, used_s in last.items():
        shares[thread[1]] += 100 * (used_s - first.get(thread, 0.0)) / (last_s - first_s)
    return shares


def _looks(daemon: subprocess.Popen[bytes]) -> Iterator[tuple[float, dict[tuple[str, str], float]]]:
    """Wall seconds, and the processor seconds of each thread by its number and name, until the daemon ends."""
    began_s = time.monotonic()
    while daemon.poll() is None:
        used = {}
        for thread in Path(f"/proc/{daemon.pid}/task").glob("*"):
            with suppress(OSError):  # it has ended meanwhile
                name = (thread / "comm").read_text().strip()
                used[thread.name, name] = int((thread / "schedstat").read_text().split()[0]) * 1e-9
        yield time.monotonic() - began_s, used
        time.sleep(0.5)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 35.0)
