"""The load beside a command: it is there while the command runs, it is measured, and none of it is left behind."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from benchmarks.under_load import Run, busy_loops, main, measure
from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[2]
WORK = "sum(range(20_000_000))"  # a few tenths of a second of processor: tenths are printed


def _python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def test_a_command_keeps_its_exit_code_and_is_measured(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["--loops", "2", "--", *_python(f"{WORK}; raise SystemExit(3)")]) == 3
    line = r"(\S+) s, (\S+) s of processor, \d+% of the cores, load average \S+, 2 busy loops, exit code 3"
    ((wall, processor),) = re.findall(line, capfd.readouterr().out)
    assert float(wall) > 0 and (float(processor) > 0 or os.name == "nt")


def test_the_loops_keep_running_until_the_command_has_ended_and_end_with_it() -> None:
    with busy_loops(2, at_most_s=600.0) as loops:
        processes = [psutil.Process(loop.pid) for loop in loops]
        assert measure(_python("pass"), loops).loops == 2
        assert {process.nice() for process in processes} == {psutil.Process().nice()}, "of equal priority"
    assert not any(process.is_running() for process in processes)


def test_a_loop_ends_by_itself_after_its_time(capfd: pytest.CaptureFixture[str]) -> None:
    with busy_loops(1, at_most_s=0.01) as loops:
        assert loops[0].wait(scaled_timeout(20)) == 0
        assert measure(_python("pass"), loops).loops == 0


@pytest.mark.skipif(os.name == "nt", reason="Windows keeps a dead parent's number: loops end by their time")
def test_loops_end_when_the_program_is_killed() -> None:
    waits = _python("print('begun', flush=True); input()")
    program = subprocess.Popen(  # noqa: S603 (our own)
        [sys.executable, "-m", "benchmarks.under_load", "--loops", "2", "--", *waits],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert program.stdin and program.stdout
    assert program.stdout.readline().strip() == b"begun"
    children = psutil.Process(program.pid).children()
    assert len(children) == 3
    program.kill()
    program.communicate()  # closes the command's input as well
    assert psutil.wait_procs(children, timeout=scaled_timeout(20))[1] == []


def test_the_share_is_that_of_all_cores() -> None:
    assert f" {16 / 10 / (os.cpu_count() or 1):.0%} of the cores" in str(Run(10.0, 16.0, 1.0, 0, 0))
