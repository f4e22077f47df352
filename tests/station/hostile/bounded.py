"""A verb in its own process, with limits of processor time and memory for hostile files."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tests.station.command import Ran

MOST_PROCESSOR_S = 10
MOST_MEMORY = 10**9
"""Bytes of its resident set."""
ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Cost:
    """Cost of one run: processor time of all threads, and the largest resident set."""

    processor_s: float
    memory: int


def run_bounded(*words: object, folder: Path) -> tuple[Ran, Cost]:
    """Run `station` with these arguments. It is killed at the limit of processor time, and allocations beyond the limit
    of the address space fail; the time-out of the test ends a run that waits.
    """
    memory_file = folder / "memory"
    memory_file.unlink(missing_ok=True)
    command = [sys.executable, "-c", _LIMITED.format(memory_file=str(memory_file)), *map(str, words)]
    with (folder / "out").open("w+b") as out, (folder / "err").open("w+b") as err:
        child = subprocess.Popen(  # noqa: S603  (our own arguments)
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=err, cwd=ROOT
        )
        try:
            _, status, used = os.wait4(child.pid, 0)
        except BaseException:
            child.kill()
            child.wait()
            raise
        child.returncode = os.waitstatus_to_exitcode(status)
    # ru_maxrss includes the memory of the parent at the fork; it is used for a child that was killed.
    memory = int(memory_file.read_text(encoding="utf-8")) if memory_file.exists() else used.ru_maxrss
    cost = Cost(used.ru_utime + used.ru_stime, memory * 1024)
    texts = [(folder / name).read_text(encoding="utf-8", errors="replace") for name in ("out", "err")]
    return Ran(child.returncode, *texts), cost


_LIMITED = f"""
import atexit, re, resource
from pathlib import Path
def write_memory():
    Path({{memory_file!r}}).write_text(re.search(r"VmHWM:\\s*(\\d+) kB", Path("/proc/self/status").read_text())[1])
atexit.register(write_memory)
resource.setrlimit(resource.RLIMIT_CPU, ({MOST_PROCESSOR_S}, {MOST_PROCESSOR_S + 1}))
resource.setrlimit(resource.RLIMIT_AS, ({8 * MOST_MEMORY}, {8 * MOST_MEMORY}))  # so that the machine survives a failure
from station.cli import main
main()
"""


def assert_ends_within_limits(*words: object, folder: Path, codes: tuple[int, ...] = (1, 2, 3)) -> Ran:
    """The verb ends by itself within the limits, with one of these codes and no traceback."""
    ran, cost = run_bounded(*words, folder=folder)
    assert ran.code != -signal.SIGXCPU, f"{words[0]} took more than {MOST_PROCESSOR_S} s of the processor"
    assert "Traceback" not in ran.err, ran.err[-2000:]
    assert ran.code in codes, (ran.code, ran.err[-500:])
    assert cost.memory < MOST_MEMORY, f"{words[0]} took {cost.memory / 1e6:.0f} MB"
    return ran
