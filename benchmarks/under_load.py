"""Run a command on a busy machine, and print its times and its share of the cores.

    python -m benchmarks.under_load [--loops 16] [--compare] -- .venv/bin/pytest

Busy loops with the priority of the command run meanwhile, one process for each. They end with the command, and also by
themselves when this program ends, or after --at-most seconds. --compare first runs the command without them. The exit
code is that of the command under load.

Processor time is that of the command and of all descendants that it waited for; it is 0 on Windows, which does not
report it. The command is not informed of the load: tests scale their time-outs with the load average.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import psutil

LOOP = """
import os, sys, time
parent, end_s = int(sys.argv[1]), time.monotonic() + float(sys.argv[2])
while os.getppid() == parent and time.monotonic() < end_s:
    for _ in range(1_000_000):
        pass
"""
AT_MOST_S = 3 * 3600.0


@dataclass(frozen=True)
class Run:
    """Wall and processor seconds of a command, the load average at its end, and the number of loops then."""

    wall_s: float
    processor_s: float
    load_average: float
    loops: int
    exit_code: int

    @property
    def share_of_cores(self) -> float:
        """Share of all cores, 1 if the command kept them all busy."""
        return self.processor_s / self.wall_s / (os.cpu_count() or 1)


def main(arguments: Sequence[str]) -> int:
    """Print the table, and return the command's exit code."""
    options = _parse(arguments)
    runs = [measure(options.command)] if options.compare else []
    with busy_loops(options.loops, options.at_most) as loops:
        runs.append(measure(options.command, loops))
    print(f"\n{table(runs)}")
    if runs[-1].loops < options.loops:
        print(f"{options.loops - runs[-1].loops} loops ended before the command; raise --at-most")
    return runs[-1].exit_code


@contextmanager
def busy_loops(count: int, at_most_s: float) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Processes with busy loops, ended by their ids."""
    # The python.exe of a virtual environment on Windows only starts this one, and would be the parent.
    python = getattr(sys, "_base_executable", sys.executable)
    command = [python, "-c", LOOP, str(os.getpid()), str(at_most_s)]
    loops: list[subprocess.Popen[bytes]] = []
    try:
        loops.extend(subprocess.Popen(command) for _ in range(count))  # noqa: S603 (our own loop)
        yield loops
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def measure(command: Sequence[str], loops: Sequence[subprocess.Popen[bytes]] = ()) -> Run:
    """Run the command beside the loops. Their processor time is not included: no process has waited for them yet."""
    began_s, before = time.monotonic(), os.times()
    exit_code = subprocess.run(command, check=False).returncode  # noqa: S603 (what the user asks for)
    wall_s, after = time.monotonic() - began_s, os.times()
    running = sum(loop.poll() is None for loop in loops)
    processor_s = after.children_user + after.children_system - before.children_user - before.children_system
    return Run(wall_s, processor_s, _load_average(), running, exit_code)


def _load_average() -> float:
    try:
        return psutil.getloadavg()[0]
    except RuntimeError:  # Windows without performance counters, and Wine
        return math.nan


def table(runs: Sequence[Run]) -> str:
    """A row per run, and the ratios of the last one to the first where there are two."""
    rows = ["| busy loops | wall | processor | share of the cores | load average | exit code |", "|---:" * 6 + "|"]
    rows += [
        f"| {run.loops} | {run.wall_s:.1f} s | {run.processor_s:.1f} s | {run.share_of_cores:.0%} "
        f"| {run.load_average:.1f} | {run.exit_code} |"
        for run in runs
    ]
    if len(runs) > 1:
        first, last = runs[0], runs[-1]
        processor = f"{last.processor_s / first.processor_s:.2f}" if first.processor_s else ""
        rows.append(f"| ratio | {last.wall_s / first.wall_s:.2f} | {processor} | | | |")
    return "\n".join(rows)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.under_load")
    parser.add_argument("--loops", type=int, default=16, help="busy loops beside the command")
    parser.add_argument("--at-most", type=float, default=AT_MOST_S, help="seconds after which a loop ends by itself")
    parser.add_argument("--compare", action="store_true", help="run the command without loops first")
    parser.add_argument("command", nargs="+", help="after --")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
