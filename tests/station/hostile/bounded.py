"""A verb in its own process, with limits of processor time and memory for hostile files."""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

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
    if not hasattr(os, "fork"):
        pytest.skip("the limits are those of POSIX: fork and setrlimit")
    (folder / "memory").unlink(missing_ok=True)
    limits = {"processor_s": MOST_PROCESSOR_S, "address_space": 8 * MOST_MEMORY}  # so that the machine survives
    try:
        answer = _server().request({"words": list(map(str, words)), "folder": str(folder), **limits})
    except BaseException:  # a time-out: the next test must not read this one's answer
        _server().close()
        _server.cache_clear()
        raise
    texts = [(folder / name).read_text(encoding="utf-8", errors="replace") for name in ("out", "err")]
    return Ran(os.waitstatus_to_exitcode(answer["status"]), *texts), Cost(answer["processor_s"], answer["memory"])


class _Server:
    """The process that forks one for each run; it ends with its standard input."""

    def __init__(self) -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-m", "tests.station.hostile.limited"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        atexit.register(self.close)

    def request(self, plain: dict[str, Any]) -> dict[str, Any]:
        assert self._child.stdin is not None and self._child.stdout is not None
        self._child.stdin.write(json.dumps(plain) + "\n")
        self._child.stdin.flush()
        answer: dict[str, Any] = json.loads(self._child.stdout.readline())
        return answer

    def close(self) -> None:
        with self._child:
            self._child.kill()


@cache
def _server() -> _Server:
    return _Server()


def assert_ends_within_limits(*words: object, folder: Path, codes: tuple[int, ...] = (1, 2, 3)) -> Ran:
    """The verb ends by itself within the limits, with one of these codes and no traceback."""
    ran, cost = run_bounded(*words, folder=folder)
    assert ran.code != -signal.SIGXCPU, f"{words[0]} took more than {MOST_PROCESSOR_S} s of the processor"
    assert "Traceback" not in ran.err, ran.err[-2000:]
    assert ran.code in codes, (ran.code, ran.err[-500:])
    assert cost.memory < MOST_MEMORY, f"{words[0]} took {cost.memory / 1e6:.0f} MB"
    return ran
