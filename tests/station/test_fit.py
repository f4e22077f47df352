"""`station fit`: printed results and written files."""

import errno
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from tests.station.foreign import static_and_dynamic

GAIN_SD = 0.01


def test_a_typed_uncertainty_of_the_load_cell_reaches_the_stiffness(station, tmp_path: Path) -> None:
    truth, _ = static_and_dynamic()
    cell = replace(truth.manifest.load_cell, gain_relative_sd=GAIN_SD)
    typed = replace(truth, manifest=replace(truth.manifest, load_cell=cell))
    typed.record(tmp_path / "cuff-hand_test-static_run-1.mcap")
    assert station("fit", tmp_path).code == 0
    stiffness = json.loads((tmp_path / "cuffs.json").read_text(encoding="utf-8"))["cuffs"]["hand"]["stiffness_n_per_m"]
    assert stiffness["parts"]["gain"] == pytest.approx(GAIN_SD * stiffness["value"], rel=1e-6)


def test_the_published_method_is_printed_or_written_to_the_output_file_and_never_as_cuffs_json(
    station, given_fit: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    ran = station("fit", tmp_path, "--method", "paper", "--format", "json")
    assert ran.code == 0
    assert 0.5 < json.loads(ran.out)["cuffs"]["waist"]["predicted_part_of_damping_left"] < 0.95
    ran = station("fit", tmp_path, "--method", "paper", "--output", tmp_path / "paper.json")
    assert ran.code == 0 and "predicted" in ran.out
    assert json.loads((tmp_path / "paper.json").read_text(encoding="utf-8"))["method"] == "paper"
    assert station("fit", tmp_path, "--method", "guess").code == 2
    assert not (tmp_path / "cuffs.json").exists()


def test_the_fit_is_written_beside_the_recordings_and_printed_with_bound_law_and_likely_causes(
    station, given_fit: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    ran = station("fit", tmp_path)
    assert ran.code == 0
    assert json.loads((tmp_path / "cuffs.json").read_text(encoding="utf-8"))["cuffs"]["waist"]["complex_stiffness"]
    out = " ".join(ran.out.split())
    assert all(words in out for words in ("at best", "[mm]", "law slip", "likely: slip explains"))


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_fitted(
    station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cuff-hand_test-static_run-1.mcap").touch()
    monkeypatch.setattr("station.fit.read_journal", lambda folder: pytest.fail(f"{folder} is read"))
    monkeypatch.setattr("station.folders.os.access", lambda path, mode: not (path == tmp_path and mode == os.W_OK))
    for verb in ("fit", "report"):
        ran = station(verb, tmp_path)
        assert (ran.code, ran.err) == (1, f"station: {tmp_path} cannot be used: {os.strerror(errno.EACCES)}\n")
