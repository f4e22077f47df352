from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from documents.message import Message
from fitting.trial.trial import read_trial
from recordings.contents import read_contents
from recordings.exchange.qtm_tsv import write_qtm_tsv
from recordings.reader import Track, open_recording
from station.files.complete_trial import complete_trial
from station.files.foreign_files import ImportRefused, MarkerSource
from station.messages.file_messages import ImportCode
from station.recordings_of_session import recordings_in
from tests.refusals import raises_refusal
from tests.station.command import assert_refused
from tests.station.foreign import Truth, static_and_dynamic

NAME = "cuff-hand_test-static_run-1.mcap"


def only(track: Track, keep: np.ndarray) -> Track:
    arrays = {
        name: getattr(track, name)[keep] for name in ("sample_numbers", "device_time_ns", "host_time_ns", "values")
    }
    return replace(track, **arrays)


@pytest.fixture(scope="module")
def truth() -> Truth:
    return static_and_dynamic()[0]


@pytest.fixture
def lossy(truth: Truth, tmp_path: Path) -> Path:
    """The live stream of the trial: 60 frames were skipped, a marker hidden for a while, a label not yet known."""
    full = truth.tracks["/markers"]
    keep = np.ones(len(full.sample_numbers), dtype=bool)
    keep[400:430] = keep[900:930] = False
    values = full.values[:, 1:].copy()
    values[100:140, -1] = np.nan
    stream = replace(full.stream, labels=full.stream.labels[1:])
    live = only(replace(full, stream=stream, values=values), keep)
    return Truth(truth.manifest, truth.tracks | {"/markers": live}).record(tmp_path / NAME)


def export(truth: Truth, tmp_path: Path, **changes: object) -> Path:
    path = tmp_path / "export.tsv"
    path.write_text(write_qtm_tsv(replace(truth.markers, **changes)), encoding="utf-8")  # type: ignore[arg-type]
    return path


def test_the_completed_recording_has_every_frame_and_the_original_is_untouched(
    truth: Truth, lossy: Path, tmp_path: Path
) -> None:
    before = lossy.read_bytes()
    done = complete_trial(lossy, MarkerSource(export(truth, tmp_path)))
    completed = tmp_path / NAME.replace(".mcap", ".completed.mcap")
    assert done.path == completed
    assert lossy.read_bytes() == before
    added, labels, filled = done.notes
    assert (added.code, added.figures["added"], added.figures["frames"]) == (ImportCode.FRAMES_ADDED, 60, 2099)
    assert "401" in str(added.figures["first"])
    assert (labels.code, labels.figures) == (ImportCode.LABELS_ADDED, {"labels": "anchor_1"})
    assert (filled.code, filled.figures) == (ImportCode.MARKERS_FILLED, {"filled": "cuff_1 in 40"})
    contents = read_contents(completed)
    assert contents.complete and not contents.gaps and contents.outcome
    assert contents.outcome.accepted
    assert recordings_in(tmp_path) == [completed]
    whole = truth.record(tmp_path / "whole.mcap")
    found, expected = read_trial(completed), read_trial(whole)
    assert found.is_whole
    assert np.array_equal(found.force_time, expected.force_time) and np.array_equal(found.force, expected.force)
    assert np.array_equal(found.marker_time, expected.marker_time)
    assert np.array_equal(found.markers, expected.markers, equal_nan=True)


def test_live_preview_around_the_capture_is_left_out(truth: Truth, tmp_path: Path) -> None:
    full = truth.tracks["/markers"]
    second = np.arange(100)
    preview = Track(
        full.stream,
        (second + 50_000).astype(np.uint64),
        full.device_time_ns[0] - (100 - second) * 10_000_000 - 5_000_000,
        full.host_time_ns[0] - (100 - second) * 10_000_000,
        full.values[:100] + 900,
    )
    both = {
        name: np.concatenate((getattr(preview, name), getattr(full, name)))
        for name in ("sample_numbers", "device_time_ns", "host_time_ns", "values")
    }
    path = Truth(truth.manifest, truth.tracks | {"/markers": replace(full, **both)}).record(tmp_path / NAME)
    done = complete_trial(path, MarkerSource(export(truth, tmp_path)))
    assert done.notes[0].code == ImportCode.FRAMES_ADDED and done.notes[0].figures["added"] == 0
    numbers = open_recording(done.path).load("/markers").sample_numbers
    assert np.array_equal(numbers, np.arange(1, 2100))


def test_frames_that_a_cut_export_lacks_are_kept(truth: Truth, lossy: Path, tmp_path: Path) -> None:
    table = truth.markers
    part = {name: getattr(table, name)[500:2000] for name in ("time_s", "positions", "residuals")}
    done = complete_trial(lossy, MarkerSource(export(truth, tmp_path, **part)))
    assert done.notes[-1] == Message(ImportCode.FRAMES_KEPT, {"frames": 569})
    gaps = read_contents(done.path).gaps
    assert [(gap.first_missing, gap.count) for gap in gaps] == [(401, 30)]


def test_a_marker_hidden_in_the_export_is_hidden_in_the_completed_recording(
    truth: Truth, lossy: Path, tmp_path: Path
) -> None:
    positions = truth.markers.positions.copy()
    positions[1500:1510, 2] = np.nan
    done = complete_trial(lossy, MarkerSource(export(truth, tmp_path, positions=positions)))
    values = open_recording(done.path).load("/markers").values
    assert np.isnan(values[1500:1510, 2]).all()


def test_an_export_of_another_trial_is_refused(station, truth: Truth, lossy: Path, tmp_path: Path) -> None:
    ask = ("import", "--over", lossy, "--mocap")
    elsewhere = export(truth, tmp_path, positions=truth.markers.positions + np.array([30.0, 0, 0]))
    with raises_refusal(ImportCode.OTHER_TRIAL, kind=ImportRefused) as caught:
        complete_trial(lossy, MarkerSource(elsewhere))
    assert caught.value.cause.figures["distance_mm"] == pytest.approx(30.0, abs=0.5)
    later = export(truth, tmp_path, time_s=truth.markers.time_s + 500)
    assert_refused(station(*ask, later), 1, ImportCode.NOTHING_IN_COMMON)
    slower = export(truth, tmp_path, time_s=2 * truth.markers.time_s, rate_hz=50.0)
    assert_refused(station(*ask, slower), 1, ImportCode.FRAME_RATE)
    assert_refused(station(*ask, slower, "--force", slower), 2, ImportCode.UNUSED_OPTION)
    assert [path.name for path in tmp_path.glob("*.mcap*")] == [NAME]


def test_a_cut_recording_is_not_completed_and_a_completed_one_not_twice(
    station, truth: Truth, lossy: Path, tmp_path: Path
) -> None:
    tsv = export(truth, tmp_path)
    ran = station("import", "--over", lossy, "--mocap", tsv)
    assert ran.code == 0 and ran.out.strip() == str(tmp_path / NAME.replace(".mcap", ".completed.mcap"))
    assert len(ran.err.splitlines()) == 3
    assert_refused(station("import", "--over", lossy, "--mocap", tsv), 1, ImportCode.FILE_EXISTS)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(lossy.read_bytes()[:90000])
    assert_refused(station("import", "--over", cut, "--mocap", tsv), 1, ImportCode.CUT_RECORDING)
