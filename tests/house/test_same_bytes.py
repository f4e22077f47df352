"""The same seed gives the same samples, figures and report on any machine: idle, paused, or with a single core."""

import json
import os
import random
import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from benchmarks.under_load import Run, busy_loops, main, measure
from recordings.reader import open_recording
from recordings.samples import Event, Loss, Samples
from tests.house.sources import ROOT
from tests.timeout import scaled_timeout

LONGEST_PAUSE_S, LEAST_PAUSES = 0.1, 20
# The report names the hour alone where the last recording is of the same day as the first, and in its table of trials.
DATES = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?(\.\d+)?(\+\d\d:\d\d|Z)?|\d\d:\d\d(:\d\d)?(?= UTC|</td>)")
HASHES = re.compile(r"\b[0-9a-f]{12,64}\b")
ABOUT_THE_FILES = ("sha256", "sources", "recorded_utc", "inputs", "seal")
RESULTS = ("cuffs.json", "assessment.json", "report.json")


@pytest.mark.slow
def test_pauses_and_a_single_core_change_nothing(recorded_session: Path, tmp_path: Path) -> None:
    """The session of tests/house/one_cuff.py, made on all cores, and on one that its processes lose again and again."""
    is_pinned = ["--pinned"] if hasattr(os, "sched_setaffinity") else []
    command = [sys.executable, "-m", "tests.house.one_cuff", str(tmp_path), *is_pinned]
    with subprocess.Popen(command, cwd=ROOT) as program:  # noqa: S603
        try:
            assert pause_until_it_ends(program) > LEAST_PAUSES
        finally:
            program.kill()
    assert program.returncode == 0
    assert len(list(tmp_path.glob("*.mcap"))) == 6
    assert differences(recorded_session, tmp_path) == []


def pause_until_it_ends(program: subprocess.Popen[bytes]) -> int:
    """Suspend the program or a child of it, half of the time, as a busy computer does; the number of pauses.

    Busy loops would use as much processor time as the program, and take the core from it for milliseconds only.
    """
    draws, pauses, station = random.Random(1), 0, psutil.Process(program.pid)  # noqa: S311
    while program.poll() is None:
        with suppress(psutil.NoSuchProcess):
            paused = draws.choice([station, *station.children(recursive=True)])
            paused.suspend()
            pauses += 1
            _wait(program, draws.uniform(0.0, LONGEST_PAUSE_S))
            paused.resume()
        _wait(program, draws.uniform(0.0, LONGEST_PAUSE_S))
    return pauses


def _wait(program: subprocess.Popen[bytes], duration_s: float) -> None:
    with suppress(subprocess.TimeoutExpired):
        program.wait(duration_s)


def differences(one: Path, other: Path) -> list[str]:
    """The files of two sessions that differ by more: recordings by their samples, figures, and the report."""
    names = sorted({path.name for folder in (one, other) for path in folder.glob("*.mcap")})
    differing = [name for name in names if _items(one / name) != _items(other / name)]
    differing += [name for name in RESULTS if figures(one / name) != figures(other / name)]
    if _page(one) != _page(other):
        differing.append("report.html")
    return differing


def figures(path: Path) -> Any:
    """A document of results without dates and hashes; None where there is none."""
    return _without_the_files(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else None


def _items(path: Path) -> list[Any]:
    """Everything in a recording; times of arrival count from its first sample, for they carry the date."""
    if not path.is_file():
        return []
    items = list(open_recording(path).items())
    begun_ns = next(item.host_time_ns for item in items if isinstance(item, Samples))
    plain: list[Any] = []
    for item in items:
        if isinstance(item, Samples):
            arrays = (item.sample_numbers, item.device_time_ns, item.values)
            plain.append((item.stream, item.host_time_ns - begun_ns, *(array.tobytes() for array in arrays)))
        elif isinstance(item, Loss):
            plain.append((item.stream, item.cause, item.first_missing, item.count, item.host_time_ns - begun_ns))
        elif isinstance(item, Event):
            plain.append((item.kind, item.host_time_ns - begun_ns))
    return plain


def _without_the_files(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_the_files(inner) for key, inner in value.items() if key not in ABOUT_THE_FILES}
    return [_without_the_files(inner) for inner in value] if isinstance(value, list) else value


def _page(folder: Path) -> str:
    page = (folder / "report.html").read_text(encoding="utf-8")
    return HASHES.sub("", DATES.sub("", page.replace(str(folder), "").replace(folder.name, "")))


# The load beside a command is there while the command runs, is measured, and none of it is left behind.


WORK = "sum(range(20_000_000))"  # a few tenths of a second of processor: tenths are printed


def _python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def test_a_command_keeps_its_exit_code_and_is_measured(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["--loops", "2", "--", *_python(f"{WORK}; raise SystemExit(3)")]) == 3
    line = r"(\S+) s, (\S+) s of processor, \d+% of the cores, load average \S+, 2 busy loops, exit code 3"
    ((wall, processor),) = re.findall(line, capfd.readouterr().out)
    assert float(wall) > 0 and (float(processor) > 0 or os.name == "nt")


def test_loops_end_with_the_command_or_after_their_time(capfd: pytest.CaptureFixture[str]) -> None:
    with busy_loops(1, at_most_s=0.01) as loops:
        assert loops[0].wait(scaled_timeout(20)) == 0
        assert measure(_python("pass"), loops).loops == 0
    with busy_loops(2, at_most_s=600.0) as loops:
        processes = [psutil.Process(loop.pid) for loop in loops]
        assert measure(_python("pass"), loops).loops == 2
        assert {process.nice() for process in processes} == {psutil.Process().nice()}, "of equal priority"
    assert not any(process.is_running() for process in processes)


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
