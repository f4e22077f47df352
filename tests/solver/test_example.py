"""The example runs as it stands, on what comes with the solver and on files."""

from __future__ import annotations

import runpy
import sys
import xml.etree.ElementTree as Xml
from pathlib import Path

import pytest

from solver.bundled import bundled_model
from solver.motion import write_table
from solver.osim.writer import osim_document
from solver.raise_arm import simulate_arm_raise

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


def test_the_example_takes_a_users_model_and_motion(monkeypatch, capsys, tmp_path: Path) -> None:
    model = bundled_model()
    raised = simulate_arm_raise(model)
    Xml.ElementTree(osim_document(model)).write(tmp_path / "mine.osim")
    write_table(tmp_path / "mine.mot", raised.names, raised.time[:100], raised.coordinates[:100])
    files = ("--model", tmp_path / "mine.osim", "--motion", tmp_path / "mine.mot")
    run(monkeypatch, *files, "--plot", tmp_path / "muscles.png")
    assert capsys.readouterr().out.startswith("thoracoscapular: 100 frames, 0 of them unsolved")
