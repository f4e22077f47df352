"""The example runs as it stands, on what comes with the solver and on files."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

from tests.solver.references import NO_WEIGHT, SHARED

EXAMPLE = Path(__file__).parents[2] / "examples" / "muscles_of_a_motion.py"


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> None:
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), *map(str, words)])
    runpy.run_path(str(EXAMPLE), run_name="__main__")


def test_the_example_tells_and_draws_who_raises_the_arm(monkeypatch, capsys, tmp_path: Path) -> None:
    run(monkeypatch, "--plot", tmp_path / "muscles.png")
    told = capsys.readouterr().out.splitlines()
    assert "0 of them unsolved; filter: Butterworth low-pass at 3 Hz" in told[0]
    assert told[-2].startswith("joint reaction up to ")
    assert {line.split()[0] for line in told[1:4]} & {"DeltoideusScapula_M", "SerratusAnterior_M", "TeresMajor"}
    assert (tmp_path / "muscles.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.shared
def test_the_example_takes_a_users_model_and_motion(monkeypatch, capsys, tmp_path: Path) -> None:
    motion = SHARED / "motions" / "SHRUG01.mot"
    run(monkeypatch, "--model", NO_WEIGHT, "--motion", motion, "--plot", tmp_path / "muscles.png")
    assert capsys.readouterr().out.startswith("ThoracoscapularShoulderModel-scaled: 462 frames")
