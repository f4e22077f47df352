"""From a camera frame on the wire to the value in a view: a trial through simulated QTM, recorder and live process.

    python -m benchmarks.live_wire --lag 0.05 --seconds 30

The bench runs in real time in a process of its own, as `station simulate` does; recorder, live process and view are
those of the station. Prints the time from the arrival of a frame's packet to its value in the view, which includes the
lag, how many frames were left out, and what the recorder lost. Requirement: lag + 25 ms, and nothing lost. The first
seconds pass while the live process prepares the body; their frames count as left out.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from recordings.samples import Item, Samples
from recordings.topics import MARKERS
from station.bench.simulation import SimulatedBench, practice_settings
from station.bench.snapshot import Snapshot
from station.bench.trial_recorder import TrialRecorder
from station.clock import RealClock
from station.config import parse_config
from station.demo import demo_config
from station.live.address import find_address
from station.live.subscription import LiveSubscription
from station.live.tap import live_views
from station.protocol import TrialSpec

SPEC = TrialSpec(None, "motion", 1, condition="tight")
ALLOWANCE_S = 0.025


@dataclass
class Arrivals:
    """A view of the recorder that notes when the packet of every frame arrived [s, Unix time], by frame number."""

    at: dict[int, float] = field(default_factory=dict)

    def offer(self, item: Item) -> None:
        if isinstance(item, Samples) and item.stream == MARKERS:
            self.at |= dict.fromkeys(item.sample_numbers.tolist(), 1e-9 * item.host_time_ns)

    def show(self, snapshot: Snapshot) -> None: ...


class Row(NamedTuple):
    """An update: when it arrived in the view [s, Unix time], its frame, and the counts of the live process."""

    at: float
    frame: int | None
    solved: int
    dropped: int
    every: int


def watch(folder: Path) -> None:
    """Print the time at which every update arrived, as JSON lines: what a view in a process of its own sees."""
    while (address := find_address(folder)) is None:
        time.sleep(0.05)
    rows: list[Row] = []
    with LiveSubscription(address) as subscription:
        while not subscription.wait_until_over(0.001):
            now = time.time()
            for update in subscription.take():
                how, frame = update.delivery, update.values.frame if update.values else None
                rows.append(Row(now, frame, how.solved_frames, how.dropped_frames, how.every))
    print(json.dumps(rows))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--lag", type=float, default=0.15)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--watch", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.watch is not None:
        return watch(options.watch)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "simulated"
        folder.mkdir()
        report(*run(folder, options.lag, options.seconds), options.lag)
    return None


def run(folder: Path, lag_s: float, seconds: float) -> tuple[Arrivals, list[Row], int]:
    """Record a motion while a view watches; returns what the recorder lost, too."""
    plain = demo_config().model_dump(mode="json")
    plain["live"] = {"enabled": True, "lag_s": lag_s}
    plain["mocap"]["control"] = "start"
    plain["sync"]["timeout_s"] = 300.0
    config = parse_config(plain, "the benchmark")
    arrivals = Arrivals()
    command = [sys.executable, "-m", "benchmarks.live_wire", "--watch", str(folder)]
    watcher = subprocess.Popen(command, stdout=subprocess.PIPE)  # noqa: S603
    with SimulatedBench(practice_settings(config), 1.0, 1) as bench:
        bench.request({"trial": {"cuff": None, "test": SPEC.test, "condition": SPEC.condition}})
        addressed = bench.configure(config)
        taps = live_views(addressed, folder, SPEC, RealClock())
        with taps[0]:
            result = TrialRecorder(addressed, RealClock(), [arrivals, *taps]).record(folder, SPEC, seconds)
        taps[0].wait(60)
    rows = [Row(*row) for row in json.loads(watcher.communicate(timeout=60)[0])]
    return arrivals, rows, result.lost_samples


def report(arrivals: Arrivals, rows: list[Row], lost: int, lag_s: float) -> None:
    print(f"{len(arrivals.at)} frames recorded, {lost} samples lost by the recorder, load {os.getloadavg()[0]:.1f}")
    # The last frames wait for the end of the recording, and not for their lag.
    before = max(arrivals.at, default=0) - 2 * round(100 * lag_s) - 1
    shown = [row for row in rows if row.frame is not None and row.frame < before and row.frame in arrivals.at]
    if not shown:
        print("no value reached the view")
        return
    delays = np.array([row.at - arrivals.at[row.frame] for row in shown if row.frame is not None])
    percentiles, limit = 1e3 * np.percentile(delays, [50, 99, 100]), 1e3 * (lag_s + ALLOWANCE_S)
    print(f"packet to view {percentiles.round(0)} ms (p50, p99, longest), lag {1e3 * lag_s:.0f}, limit {limit:.0f} ms")
    print(f"within the limit: {100 * (1e3 * delays <= limit).mean():.1f} % of {len(delays)} updates")
    last = rows[-1]
    print(f"frames solved {last.solved}, left out {last.dropped}, muscles in one of {last.every}")


if __name__ == "__main__":
    main()
