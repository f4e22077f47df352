"""A session of one cuff, a killed recorder and the console's page in the Windows Python of .ci/windows-python."""

from __future__ import annotations

import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.house.sameness import figures
from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[2]
COMMAND = ROOT / ".ci" / "windows-python"
CANNOT = 77
PATIENCE_S = 240.0
RELATIVE, ABSOLUTE = 1e-7, 1e-12  # the two C libraries round exp and log differently
KILLED = (
    "tests/station/session/test_killed_recorder.py::"
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
    """Standard output of Windows' Python, which ends with 0."""
    ran = subprocess.run(  # noqa: S603
        [COMMAND, *map(str, words)],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=scaled_timeout(PATIENCE_S),
    )
    if ran.returncode == CANNOT:
        pytest.skip(ran.stderr.splitlines()[-1])
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout


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


def _differences(one: Any, other: Any, place: str = "") -> list[str]:
    """Places at which two documents differ: in a figure by more than rounding, in anything else at all."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return [found for key in one for found in _differences(one[key], other[key], f"{place}/{key}")]
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return [found for i in range(len(one)) for found in _differences(one[i], other[i], f"{place}/{i}")]
    if isinstance(one, float) and isinstance(other, float):
        return [] if math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE) else [f"{place}: {one} and {other}"]
    return [] if one == other else [f"{place}: {one} and {other}"]
