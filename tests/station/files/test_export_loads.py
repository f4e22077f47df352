"""Force on the cuff for OpenSim: vector, gap-free segments, filled gaps, and the result of OpenSim's own Storage."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting.trial.trial import Trial, read_trial
from station.files.export_trial import Exported, export_recordings
from station.files.synchronised import ExportRefused
from station.messages.file_messages import ExportCode
from tests.refusals import raises_refusal
from tests.station.command import assert_refused
from tests.station.foreign import Truth, static_and_dynamic

HIDDEN = slice(700, 750)  # of the frames at 100 Hz: half a second


def recorded(folder: Path, hidden: slice, lost: slice = slice(0)) -> Path:
    """A static trial whose cuff marker is hidden in some frames, and of whose force some samples were lost."""
    truth = static_and_dynamic()[0]
    values = truth.tracks["/markers"].values.copy()
    values[hidden, -1] = np.nan
    tracks = truth.tracks | {"/markers": replace(truth.tracks["/markers"], values=values)}
    for name in ("/force", "/sync"):
        track = tracks[name]
        kept = np.delete(np.arange(len(track.values)), lost)
        fields = ("sample_numbers", "device_time_ns", "host_time_ns", "values")
        tracks[name] = replace(track, **{field: getattr(track, field)[kept] for field in fields})
    folder.mkdir(parents=True, exist_ok=True)
    return Truth(truth.manifest, tracks).record(folder / "cuff-hand_test-static_run-1.mcap")


@pytest.fixture(scope="module")
def static(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("session"), HIDDEN)


@pytest.fixture(scope="module")
def trial(static: Path) -> Trial:
    return read_trial(static)


def export(static: Path, to: str, output: Path, *, fills_gaps: bool = False) -> Exported:
    return export_recordings([static], to, output, "01", fills_gaps=fills_gaps)


def tables(done: Exported) -> list[np.ndarray]:
    """The rows of every table, parsed as plain text."""
    found = []
    for path in done.paths[:-1]:
        lines = path.read_text(encoding="utf-8").splitlines()
        head = lines.index("endheader")
        assert lines[0] == path.stem and "inDegrees=no" in lines
        assert lines[head + 1].split("\t")[:5] == ["time", *(f"cuff_force_v{axis}" for axis in "xyz"), "cuff_force_px"]
        found.append(np.array([line.split("\t") for line in lines[head + 2 :]], dtype=float))
        assert f"nRows={len(found[-1])}" in lines
    return found


def sidecar(done: Exported) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(done.paths[-1].read_text(encoding="utf-8"))
    return content


@pytest.mark.parametrize("to", ["mot", "sto"])
def test_the_force_is_a_pull_along_the_cuff_displacement(static: Path, trial: Trial, tmp_path: Path, to: str) -> None:
    done = export(static, to, tmp_path)
    ends = [path.name.removeprefix(static.stem) for path in done.paths]
    assert ends == [f"_force_1.{to}", f"_force_2.{to}", f".{to}.json"]
    rows = np.concatenate(tables(done))
    at = np.searchsorted(trial.force_time, rows[:, 0] - 1e-6)
    assert rows[:, 0] == pytest.approx(trial.force_time[at], rel=1e-9)
    assert np.abs(np.linalg.norm(rows[:, 1:4], axis=1) - np.abs(trial.force[at])).max() < 1e-6
    loaded = rows[trial.force[at] > 60, 1:4].mean(axis=0)
    assert loaded / np.linalg.norm(loaded) == pytest.approx([0.36, 0.48, 0.80], abs=0.02), "as the experiment pulls"
    assert rows[0, 4:7] == pytest.approx(trial.positions(("cuff_1",))[0, 0], abs=1e-3)
    assert not rows[:, 7:].any()


def test_a_hidden_marker_leaves_two_segments_and_every_row_left_out_is_counted(
    static: Path, trial: Trial, tmp_path: Path
) -> None:
    done = export(static, "mot", tmp_path)
    first, second = tables(done)
    assert (np.diff(first[:, 0]) < 1.1e-3).all() and (np.diff(second[:, 0]) < 1.1e-3).all()
    hidden = trial.marker_time[HIDDEN]
    assert first[-1, 0] < hidden[0] < hidden[-1] < second[0, 0]
    left_out = sidecar(done)["gaps"]["rows_left_out"]
    assert 490 <= left_out["marker_hidden"] <= 530
    assert len(first) + len(second) + sum(left_out.values()) == len(trial.force)
    assert [piece["rows"] for piece in sidecar(done)["gaps"]["pieces"]] == [len(first), len(second)]
    (note,) = done.notes
    assert (note.code, note.figures["rows"]) == (ExportCode.ROWS_LEFT_OUT, len(trial.force))
    assert (note.figures["left_out"], note.figures["files"]) == (sum(left_out.values()), 2)


def test_lost_samples_separate_segments(tmp_path: Path) -> None:
    done = export(recorded(tmp_path / "s", slice(0), lost=slice(3000, 3040)), "mot", tmp_path)
    first, second = tables(done)
    assert second[0, 0] - first[-1, 0] == pytest.approx(0.041, abs=1e-4)


def test_filled_gaps_are_one_file_whose_filled_rows_are_counted(tmp_path: Path) -> None:
    path = recorded(tmp_path / "s", HIDDEN, lost=slice(3000, 3040))
    done, trial = export(path, "mot", tmp_path, fills_gaps=True), read_trial(path)
    (rows,) = tables(done)
    assert np.diff(rows[:, 0]).max() < 1.1e-3
    filled = sidecar(done)["gaps"]["rows_filled"]
    assert filled["samples_lost"] == 40
    assert 490 <= filled["marker_hidden"] <= 530
    assert sidecar(done)["gaps"]["longest_gap_s"] == pytest.approx(0.51, abs=0.011)
    force = np.interp(rows[:, 0], trial.force_time, trial.force)
    assert np.abs(np.linalg.norm(rows[:, 1:4], axis=1) - np.abs(force)).max() < 1e-4, "measured, not filled"
    inside = (rows[:, 0] > trial.marker_time[700]) & (rows[:, 0] < trial.marker_time[749])
    assert np.abs(np.diff(rows[inside, 4:7], n=2, axis=0)).max() < 1e-8, "a straight line"
    assert [note.code for note in done.notes] == [ExportCode.INCOMPLETE, ExportCode.ROWS_FILLED]
    assert done.notes[1].figures["lost"] == 40


def test_without_gaps_there_is_one_file_and_no_note(tmp_path: Path) -> None:
    done = export(recorded(tmp_path / "s", slice(0)), "sto", tmp_path)
    assert [path.suffix for path in done.paths] == [".sto", ".json"]
    assert done.paths[0].stem.endswith("_force")
    assert not done.notes


def test_a_cuff_that_is_never_seen_is_refused(tmp_path: Path) -> None:
    with raises_refusal(ExportCode.NO_DIRECTION, kind=ExportRefused):
        export(recorded(tmp_path / "s", slice(None)), "mot", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.oracle
@pytest.mark.parametrize(
    ("to", "fills_gaps"),
    [
        ("mot", False),
        ("sto", True),
        pytest.param("mot", True, marks=pytest.mark.slow),
        pytest.param("sto", False, marks=pytest.mark.slow),
    ],
)
def test_opensims_storage_reads_every_row(
    static: Path, tmp_path: Path, trial: Trial, to: str, fills_gaps: bool
) -> None:
    opensim = pytest.importorskip("opensim")
    done = export(static, to, tmp_path, fills_gaps=fills_gaps)
    for path, rows in zip(done.paths[:-1], tables(done), strict=True):
        storage = opensim.Storage(str(path))
        assert storage.getSize() == len(rows)
        assert (storage.getFirstTime(), storage.getLastTime()) == (rows[0, 0], rows[-1, 0])
        column = opensim.ArrayDouble()
        storage.getDataColumn("cuff_force_vx", column)
        assert np.array([column.get(i) for i in range(column.getSize())]) == pytest.approx(rows[:, 1], rel=1e-12)
    rows = np.concatenate(tables(done))
    expected = len(trial.force) if fills_gaps else len(trial.force) - 509
    assert len(rows) == pytest.approx(expected, abs=20)


def test_the_verb_lists_the_codes_of_its_notes_and_fills_gaps_on_request(station, static: Path, tmp_path: Path) -> None:
    ran = station("export", static, "--to", "mot", "--output", tmp_path / "pieces")
    assert ran.code == 0
    assert len(ran.out.split()) == 3
    assert ran.err.strip()
    ran = station("export", static, "--to", "mot", "--fill-gaps", "--output", tmp_path / "filled", "--format", "json")
    assert ran.code == 0
    assert len(json.loads(ran.out)["written"]) == len(json.loads(ran.out)["notes"]) + 1 == 2
    assert json.loads(ran.out)["note_codes"][0]["code"] == ExportCode.ROWS_FILLED
    assert_refused(station("export", static, "--to", "csv", "--fill-gaps"), 2, ExportCode.FILL_GAPS_FORMAT)
