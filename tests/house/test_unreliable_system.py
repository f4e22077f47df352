"""Sessions on a drive that refuses to flush and with a clock that is set back, on this system and on Windows (Wine).

Calls of the C library are replaced; those of Wine use the same.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from station.journal import read_journal
from station.messages.bench_messages import TrialCode
from tests.house.sources import ROOT
from tests.station.console.served import write_config
from tests.station.terminal.practice import Headless
from tests.timeout import scaled_timeout

CALLS = """
#define _GNU_SOURCE
#include <errno.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static int is_set(const char *name) {
    const char *path = getenv(name);
    return path && !access(path, F_OK);
}

int fsync(int file) {
    if (is_set("FLUSH_FAILS_WITH")) { errno = EIO; return -1; }
    return syscall(SYS_fsync, file);
}

int fdatasync(int file) { return fsync(file); }

int clock_gettime(clockid_t clock, struct timespec *now) {
    int result = syscall(SYS_clock_gettime, clock, now);
    if ((clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) && is_set("CLOCK_SET_BACK_WITH"))
        now->tv_sec -= 3600;
    return result;
}
"""
DECIDE_TWICE = """
import sys, time
from pathlib import Path
from station.bench.trial_recorder import start_time_after_all
folder = Path(sys.argv[1])
for _ in range(2):
    _, message = start_time_after_all(folder, time.time_ns())
    print(message and message.code.value)
    (folder / "now").touch()
"""
SESSION = Path("simulated", "monday")
PLAN = ("--config", "station.toml", "--simulated", "--speed", "30", "--subject", "P01", "--session", str(SESSION))
PATIENCE_S = 240.0
COMPILER = shutil.which("cc")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.skipif(
        COMPILER is None or sys.platform != "linux", reason="replaces calls of Linux, with a C compiler (cc)"
    ),
]


@pytest.fixture
def windows_python() -> str:
    windows = ROOT / ".ci" / "windows-python"
    if shutil.which("wine") is None or subprocess.run([windows, "-V"], check=False).returncode:  # noqa: S603
        pytest.skip("Windows' Python cannot be made")
    return str(windows)


@pytest.fixture
def calls(tmp_path: Path) -> Path:
    assert COMPILER is not None
    library = tmp_path / "calls.so"
    command = [COMPILER, "-shared", "-fPIC", "-x", "c", "-", "-o", library]
    subprocess.run(command, input=CALLS, text=True, check=True)  # noqa: S603
    return library


def bench(folder: Path) -> None:
    path = write_config(folder, hold_s=4.0, swing_s=5.0, migration_m=0.0)
    path.write_text(path.read_text().replace('control = "start"', 'control = "none"'))


@pytest.mark.parametrize("system", ["this system", "Windows"])
def test_a_drive_that_refuses_to_flush_is_refused_before_the_first_trial(
    tmp_path: Path, calls: Path, system: str, request: pytest.FixtureRequest
) -> None:
    program = sys.executable if system == "this system" else request.getfixturevalue("windows_python")
    bench(tmp_path)
    variables = {"LD_PRELOAD": str(calls), "FLUSH_FAILS_WITH": str(calls)}
    with Headless(tmp_path, *PLAN, program=program, variables=variables) as terminal:
        _, refusal = terminal.child.communicate(timeout=scaled_timeout(PATIENCE_S))
        assert terminal.child.returncode == 1 and b"[journal.not_written]" in refusal, refusal
    assert not list(tmp_path.rglob("*.mcap"))


def test_a_clock_set_back_by_an_hour_between_two_trials_is_a_note_of_the_second(tmp_path: Path, calls: Path) -> None:
    write_config(tmp_path, hold_s=4.0, swing_s=5.0, migration_m=0.0)  # a trial begins at our command
    signal = tmp_path / "now"
    variables = {"LD_PRELOAD": str(calls), "CLOCK_SET_BACK_WITH": str(signal)}
    with Headless(tmp_path, *PLAN, program=sys.executable, variables=variables) as terminal:
        for _ in range(2):
            terminal.until("waiting", what="start")
            terminal.send("arm")
            terminal.until("trial_ended")
            signal.touch()
    first, second = ([message.code for message in one.codes] for one in read_journal(tmp_path / SESSION).recorded)
    assert (TrialCode.CLOCK_SET_BACK in first, TrialCode.CLOCK_SET_BACK in second) == (False, True)


def test_a_clock_that_is_set_back_is_noticed_on_windows(tmp_path: Path, calls: Path, windows_python: str) -> None:
    """The decision alone, by the clock and the files' times that Windows tells; the session around it is above."""
    shutil.copy(ROOT / "tests" / "recordings" / "golden" / "format_1.mcap", tmp_path)
    (tmp_path / "format_1.mcap").touch()
    variables = {"LD_PRELOAD": str(calls), "CLOCK_SET_BACK_WITH": str(tmp_path / "now")}
    ran = subprocess.run(  # noqa: S603
        [windows_python, "-c", DECIDE_TWICE, str(tmp_path)],
        check=True,
        capture_output=True,
        text=True,
        timeout=scaled_timeout(PATIENCE_S),
        env={**os.environ, **variables},
    )
    assert ran.stdout.split() == ["None", TrialCode.CLOCK_SET_BACK.value]
