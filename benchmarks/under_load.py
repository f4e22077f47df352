"""Run a command on a busy machine, and print its times and its share of the cores.

    python -m benchmarks.under_load [--loops 16] -- .venv/bin/pytest

Busy loops with the priority of the command run meanwhile, one process for each. They end with the command, and also by
themselves when this program ends, or after three hours. The exit code is that of the command.

Processor time is that of the command and of all descendants that it waited for; it is 0 on Windows, which does not
report it. The command is not informed of the load: tests scale their time-outs with the load average.
"""

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

    def __str__(self) -> str:
        share = self.processor_s / self.wall_s / (os.cpu_count() or 1)
        times = f"{self.wall_s:.1f} s, {self.processor_s:.1f} s of processor, {share:.0%} of the cores"
        return f"{times}, load average {self.load_average:.1f}, {self.loops} busy loops, exit code {self.exit_code}"


def main(arguments: Sequence[str]) -> int:
    """Print the times, and return the command's exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.under_load")
    parser.add_argument("--loops", type=int, default=16, help="busy loops beside the command")
    parser.add_argument("command", nargs="+", help="after --")
    options = parser.parse_args(arguments)
    with busy_loops(options.loops, AT_MOST_S) as loops:
        run = measure(options.command, loops)
    print(f"\n{run}")
    return run.exit_code


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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
