"""A session, a killed recorder, the page, a console and pip's launcher in the Windows Python of .ci/windows-python."""

import io
import math
import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import pytest

from tests.house.test_same_bytes import figures
from tests.station.terminal.test_record_session import on_a_terminal
from tests.timeout import scaled_timeout

distlib = pytest.importorskip("pip._vendor.distlib", reason="an environment without pip, as that under Wine")

ROOT = Path(__file__).parents[2]
COMMAND = ROOT / ".ci" / "windows-python"
CANNOT = 77
RECORDING = ROOT / "tests" / "recordings" / "golden" / "format_1.mcap"
PATIENCE_S = 240.0
RELATIVE, ABSOLUTE = 1e-7, 1e-12  # the two C libraries round exp and log differently
KILLED = (
    "tests/station/session/test_trial_daemon.py::"
    "test_the_next_trial_of_a_simulated_bench_ends_the_capture_of_a_killed_recorder"
)
PAGE = """
import pathlib, sys, urllib.request
from tests.station.console.served import ServedConsole, write_config
with ServedConsole(write_config(pathlib.Path(sys.argv[1])), "--simulated") as console:
    print(urllib.request.urlopen(console.address).read().decode())
"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.skipif(shutil.which("wine") is None, reason="no Wine; as root, .ci/windows-python installs it"),
]


def run_in_windows(*words: object) -> str:
    """Standard output of Windows' Python, which ends with 0.

    It is killed at the time-out, and nothing waits for processes that it leaves: they keep its standard output open.
    """
    with subprocess.Popen(  # noqa: S603
        [COMMAND, *map(str, words)],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as program:
        try:
            output, errors = program.communicate(timeout=scaled_timeout(PATIENCE_S))
        except subprocess.TimeoutExpired as error:
            program.kill()
            pytest.fail(f"{words} has not ended after {error.timeout:.0f} s: {error.stdout!r} {error.stderr!r}")
    if program.returncode == CANNOT:
        pytest.skip(errors.splitlines()[-1])
    assert program.returncode == 0, output + errors
    return output


def test_the_figures_of_a_session_are_those_of_this_system(recorded_session: Path, tmp_path: Path) -> None:
    run_in_windows("-m", "tests.house.one_cuff", tmp_path)
    here, there = (figures(folder / "cuffs.json") for folder in (recorded_session, tmp_path))
    assert "hand" in here["cuffs"] and _differences(here, there) == []
    assert (tmp_path / "report.html").is_file()


def test_the_trial_after_a_killed_recorder_is_recorded() -> None:
    options = ("-n", "0", "-q", "-p", "no:cacheprovider", "-m", "slow or not slow")
    assert "1 passed" in run_in_windows("-m", "pytest", *options, KILLED)


def test_the_console_serves_its_page(tmp_path: Path) -> None:
    assert "<title>station</title>" in run_in_windows("-c", PAGE, tmp_path)


@pytest.mark.parametrize("code_page", [1252, 65001])
def test_a_console_shows_signs_and_tables_whatever_its_code_page(tmp_path: Path, code_page: int) -> None:
    run_in_windows("-V")  # makes it
    run = f"import ctypes; ctypes.windll.kernel32.SetConsoleOutputCP({code_page}); from station.cli import main; main()"
    with on_a_terminal(tmp_path, str(COMMAND), "--console", "-c", run, "info", str(RECORDING)) as screen:
        screen.read_to_end()
    shown = "".join("".join(screen.lines()).split())  # the console moves the cursor instead of writing a space
    assert "│/sync│1000│" in shown
    assert "±0.29ms" in shown


def test_the_launcher_that_pip_makes_runs_a_verb(tmp_path: Path) -> None:
    python = run_in_windows("-c", "import sys; print(sys.executable)").strip()
    launcher = Path(distlib.__file__).with_name("t64.exe").read_bytes()  # pip appends the path of Python and a program
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as program:
        program.writestr("__main__.py", "from station.__main__ import main; main()")
    (tmp_path / "station.exe").write_bytes(launcher + f"#!{python}\n".encode() + archive.getvalue())
    run = "import subprocess, sys; sys.exit(subprocess.call(sys.argv[1:]))"
    assert "--signers" in run_in_windows("-c", run, tmp_path / "station.exe", "verify", "--help")


def _differences(one: Any, other: Any, place: str = "") -> list[str]:
    """Places at which two documents differ: in a figure by more than rounding, in anything else at all."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return [found for key in one for found in _differences(one[key], other[key], f"{place}/{key}")]
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return [found for i in range(len(one)) for found in _differences(one[i], other[i], f"{place}/{i}")]
    if isinstance(one, float) and isinstance(other, float):
        return [] if math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE) else [f"{place}: {one} and {other}"]
    return [] if one == other else [f"{place}: {one} and {other}"]
