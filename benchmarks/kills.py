"""The kill matrix of docs/reliability.md: recorder processes, killed (SIGKILL) at random times of a recording.

    python -m benchmarks.kills [ROUNDS]

Ten recorders at once record a simulated capture in real time, each from its own DAQ, and are killed at random times,
uniform over the 10 s after the edge. The loss is the device time at the kill minus that of the last readable sample.
Every file is then checked for gaps and recovered twice.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from recordings.reader import open_recording
from tests.station.killing import DAEMONS, KillBench, ensure_contiguous, ensure_recovered


def main(rounds: int) -> None:
    random = np.random.default_rng(20)
    losses: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder, KillBench(Path(folder)) as bench:
        for _ in range(rounds):
            for killed in bench.kill(random.uniform(0, 10, DAEMONS).tolist()):
                losses.append(killed.losses_s())
                ensure_contiguous(open_recording(killed.path))
                ensure_recovered(killed.path)
            print(f"{len(losses)} daemons killed", file=sys.stderr, flush=True)
    print(f"{len(losses)} kills; every file a prefix without holes, every recovery whole, indexed and idempotent\n")
    print("| stream | loss, median | loss, 95 % | loss, maximum | limit |")
    print("|---|---:|---:|---:|---:|")
    for stream in losses[0]:
        lost_ms = 1000 * np.array([loss[stream] for loss in losses])
        median, most_of_them = np.percentile(lost_ms, [50, 95])
        print(f"| {stream} | {median:.0f} ms | {most_of_them:.0f} ms | {lost_ms.max():.0f} ms | 500 ms |")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
