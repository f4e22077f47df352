"""Activations beside EMG: a cut table, another trial and another unit of time are findings, not another result."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting.emg.shape import ShapeOutcome
from solver.time_series_table import read_table, write_table
from station.emg.emg_json import EmgTrialEntry, read_emg_document
from station.exit_code import DONE, FAILED
from station.messages.emg_messages import EmgCode
from tests.station.command import Ran, assert_refused
from tests.station.emg.measured import levels, write_activations, write_emg, write_setup

Station = Callable[..., Ran]


@pytest.fixture
def run(station: Station, tmp_path: Path) -> Callable[[Path], Ran]:
    """Compares a trial of 8 s with a file of activations."""
    write_emg(tmp_path / "lift.csv", levels(), seed=1)
    setup, output = write_setup(tmp_path / "emg.toml"), tmp_path / "results"
    words = ("--setup", setup, "--output", output)
    return lambda activations: station("emg", tmp_path / "lift.csv", "--activations", activations, *words)


def trial(folder: Path) -> EmgTrialEntry:
    (found,) = read_emg_document(folder / "results" / "emg.json").trials
    return found


def as_sto(path: Path, *, start: float = 0.0, end: float = 8.0) -> Path:
    """Frames of the same activations between start and end [s], under OpenSim's header of these."""
    names, table, _ = read_table(write_activations(path.with_suffix(".csv")))
    kept = table[(table[:, 0] >= start) & (table[:, 0] < end)]
    write_table(path, names[1:], kept[:, 0], kept[:, 1:])
    return path


def test_activations_of_the_same_time_have_no_finding(run: Callable[[Path], Ran], tmp_path: Path) -> None:
    """A few frames at both ends are missing where a motion is shorter than its EMG."""
    for ends in ({}, {"start": 0.1, "end": 7.8}):
        ran = run(as_sto(tmp_path / "rmr.sto", **ends))
        assert (ran.code, ran.err, trial(tmp_path).findings) == (DONE, "", [])


def test_a_cut_table_of_activations_is_a_finding(run: Callable[[Path], Ran], tmp_path: Path) -> None:
    path = as_sto(tmp_path / "rmr.sto")
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(lines[:-10]) + "\n", encoding="utf-8")
    ran = run(path)
    (finding,) = trial(tmp_path).findings
    assert (ran.code, finding.code) == (DONE, EmgCode.ROW_COUNTS)
    assert finding.figures == {"file": "rmr.sto", "stated": 800, "found": 790}
    assert str(finding) in ran.err


@pytest.mark.parametrize("shift", [-4.0, 0.5, 5.0])
def test_activations_that_begin_at_another_time_are_a_finding(
    run: Callable[[Path], Ran], tmp_path: Path, shift: float
) -> None:
    ran = run(write_activations(tmp_path / "rmr.csv", start=shift))
    (finding,) = trial(tmp_path).findings
    assert (ran.code, finding.code) == (DONE, EmgCode.PARTLY_COMMON)
    assert finding.figures["common_s"] == pytest.approx(8 - abs(shift), abs=0.02)
    assert finding.figures["model_start_s"] == pytest.approx(shift)
    assert str(finding) in ran.err


def test_activations_of_a_shorter_trial_are_a_finding(run: Callable[[Path], Ran], tmp_path: Path) -> None:
    run(as_sto(tmp_path / "rmr.sto", end=7.5))
    assert [finding.code for finding in trial(tmp_path).findings] == [EmgCode.PARTLY_COMMON]


def test_activations_at_times_in_milliseconds_are_refused(run: Callable[[Path], Ran], tmp_path: Path) -> None:
    names, table, _ = read_table(write_activations(tmp_path / "rmr.csv"))
    write_table(tmp_path / "ms.csv", names[1:], 1e3 * table[:, 0], table[:, 1:])
    assert_refused(run(tmp_path / "ms.csv"), FAILED, EmgCode.FEW_TIMES)


def test_activations_of_every_twentieth_frame_are_compared(run: Callable[[Path], Ran], tmp_path: Path) -> None:
    names, table, _ = read_table(write_activations(tmp_path / "rmr.csv"))
    write_table(tmp_path / "few.csv", names[1:], table[::20, 0], table[::20, 1:])
    run(tmp_path / "few.csv")
    (first, _), found = trial(tmp_path).channels, trial(tmp_path).findings
    assert first.shape is not None and first.shape.outcome is ShapeOutcome.COMPARED
    assert np.isfinite(first.shape.correlation.value or np.nan) and found == []
