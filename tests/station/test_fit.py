"""`station fit`: printed results and written files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from fitting.cuffs.cuff_fit import SessionFit
from fitting.cuffs.cuffs_file import cuffs_json
from fitting.session import fit_session
from fitting.trial.trial import build_trial
from recordings.manifest import TrialOutcome
from recordings.reader import Track
from recordings.samples import Samples
from station.files.import_trial import write_recording
from tests.fitting.experiment import Session, published

GAIN_SD = 0.01


def test_a_typed_uncertainty_of_the_load_cell_reaches_the_stiffness(station, tmp_path: Path) -> None:
    manifest, tracks = Session(published("hand"), 3).static()
    cell = replace(manifest.load_cell, gain_relative_sd=GAIN_SD)
    streams = [track.stream for track in tracks.values()]
    items = [_as_samples(name, track) for name, track in tracks.items()]
    accepted = TrialOutcome(True, "closed", "the capture ended")
    path = tmp_path / "cuff-hand_test-static_run-1.mcap"
    write_recording(path, replace(manifest, load_cell=cell), streams, items, accepted, "the test")
    assert station("fit", tmp_path).code == 0
    stiffness = json.loads((tmp_path / "cuffs.json").read_text(encoding="utf-8"))["cuffs"]["hand"]["stiffness_n_per_m"]
    assert stiffness["parts"]["gain"] == pytest.approx(GAIN_SD * stiffness["value"], rel=1e-6)


def _as_samples(name: str, track: Track) -> Samples:
    arrival_ns = int(track.host_time_ns[-1])
    return Samples(name, track.sample_numbers, track.device_time_ns, arrival_ns, track.values)


@pytest.fixture(scope="module")
def fitted() -> SessionFit:
    session = Session(published("waist", hold=4.0, duration=12.0), 3)
    return fit_session([build_trial(*session.static(), "s", "s"), build_trial(*session.dynamic(), "d", "d")])


@pytest.fixture
def folder(fitted: SessionFit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A session whose fit is given."""

    def fit(_folder: Path, output: Path | None, _progress: object) -> SessionFit:
        if output is not None:
            output.write_text(cuffs_json(fitted), encoding="utf-8")
        return fitted

    monkeypatch.setattr("station.fit.fit_session_folder", fit)
    return tmp_path


def test_the_published_method_is_printed_or_written_to_the_output_file_and_never_as_cuffs_json(
    station, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    ran = station("fit", folder, "--method", "paper", "--format", "json")
    assert ran.code == 0
    assert 0.5 < json.loads(ran.out)["cuffs"]["waist"]["predicted_part_of_damping_left"] < 0.95
    ran = station("fit", folder, "--method", "paper", "--output", folder / "paper.json")
    assert ran.code == 0 and "predicted" in ran.out
    assert json.loads((folder / "paper.json").read_text(encoding="utf-8"))["method"] == "paper"
    assert station("fit", folder, "--method", "guess").code == 2
    assert not (folder / "cuffs.json").exists()


def test_the_fit_is_written_beside_the_recordings_and_printed_with_bound_law_and_likely_causes(
    station, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    ran = station("fit", folder)
    assert ran.code == 0
    assert json.loads((folder / "cuffs.json").read_text(encoding="utf-8"))["cuffs"]["waist"]["complex_stiffness"]
    out = " ".join(ran.out.split())
    assert all(words in out for words in ("at best", "[mm]", "law slip", "likely: slip explains"))
