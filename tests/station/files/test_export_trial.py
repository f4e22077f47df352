import csv
import gzip
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.testing import assert_allclose
from pyarrow import parquet

from fitting.trial.trial import Trial, read_trial
from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from recordings.contents import read_contents
from recordings.exchange.trc import read_trc
from recordings.manifest import BounceRig
from recordings.reader import open_recording
from station.files.export_trial import Exported, export_recordings
from station.files.foreign_files import ForceSource, MarkerSource
from station.files.import_trial import import_trial
from station.files.synchronised import ExportRefused
from station.fit import fit_session_folder
from station.messages.assessment_messages import InputCode
from station.messages.file_messages import ExportCode
from station.protocol import TrialSpec
from tests.refusals import raises_refusal
from tests.station.command import assert_refused
from tests.station.foreign import Truth, config, static_and_dynamic
from tests.station.wearer import BODY, GAIN, SPECS, WearerSession

POSE, FREE, TIGHT = SPECS
HIDDEN = slice(700, 750)  # of the frames at 100 Hz: half a second
LOST = np.r_[3000:3040]


def hide(truth: Truth, frames: slice) -> Truth:
    """The marker of the cuff is not seen in these frames."""
    values = truth.tracks["/markers"].values.copy()
    values[frames, -1] = np.nan
    return truth.with_track("/markers", values=values)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the station recorded of an experiment whose cuff marker is hidden for half a second."""
    folder = tmp_path_factory.mktemp("session")
    for truth in static_and_dynamic():
        hide(truth, HIDDEN).record(folder / f"cuff-hand_test-{truth.manifest.test}_run-1.mcap")
    return folder


@pytest.fixture(scope="module")
def static(session: Path) -> Path:
    return session / "cuff-hand_test-static_run-1.mcap"


@pytest.fixture(scope="module")
def trial(static: Path) -> Trial:
    return read_trial(static)


def export(recording: Path, to: str, output: Path) -> dict[str, Path]:
    """What was written, by the end of its name after the recording's."""
    done = export_recordings([recording], to, output, "01")
    assert not done.refused
    assert not list(output.glob(".*")), "no draft is left"
    return {path.name.removeprefix(recording.stem): path for path in done.paths}


def again(force: Path, mocap: Path, session: Path, test: str = "static") -> Path:
    spec = TrialSpec("hand", test, 1)  # type: ignore[arg-type]
    return import_trial(session, spec, config(), ForceSource(force), MarkerSource(mocap)).path


def assert_same_trial(found: Trial, expected: Trial, newtons: float, metres: float) -> None:
    """But for the last frame, which may stand after the last sample of the force that went out."""
    assert found.labels == expected.labels
    assert_allclose(found.force_time, expected.force_time[: len(found.force_time)], rtol=0, atol=2e-9)
    assert_allclose(found.force, expected.force[: len(found.force)], rtol=0, atol=newtons)
    frames = len(found.marker_time)
    assert frames >= len(expected.marker_time) - 1 and len(found.force) >= len(expected.force) - 1
    assert_allclose(found.marker_time, expected.marker_time[:frames], rtol=0, atol=2e-9)
    assert_allclose(found.markers, expected.markers[:frames], rtol=0, atol=metres)


@pytest.mark.parametrize(
    ("force", "markers"),
    [
        ("csv", "tsv"),
        ("tsv", "c3d"),
        pytest.param("tsv", "tsv", marks=pytest.mark.slow),
        pytest.param("csv", "trc", marks=pytest.mark.slow),
    ],
)
def test_exports_give_the_same_trial(static: Path, trial: Trial, tmp_path: Path, force: str, markers: str) -> None:
    out = export(static, force, tmp_path / "out") | export(static, markers, tmp_path / "out")
    mocap = out["_markers.tsv"] if markers == "tsv" else out[f".{markers}"]
    found = read_trial(again(out[f"_force.{force}"], mocap, tmp_path / "s"))
    assert_same_trial(found, trial, newtons=1e-9, metres=1e-7)
    assert np.isnan(found.positions(("cuff_1",))).all(axis=(1, 2)).sum() == 50


def test_a_session_exported_as_c3d_and_imported_has_the_same_fit(session: Path, tmp_path: Path) -> None:
    for path in session.glob("*.mcap"):
        file = export(path, "c3d", tmp_path)[".c3d"]
        again(file, file, tmp_path / "s", "static" if "static" in path.name else "dynamic")
    before, after = (fit_session_folder(folder, None).cuffs["hand"] for folder in (session, tmp_path / "s"))
    assert before.stiffness and after.stiffness and before.damping and after.damping
    assert after.stiffness.value == pytest.approx(before.stiffness.value, rel=1e-4)
    assert abs(after.damping.value - before.damping.value) < 0.2 * before.damping.standard_error


@pytest.mark.parametrize("to", ["c3d", "csv", "mot", "parquet", "trc"])
def test_a_full_disk_is_an_error(static: Path, tmp_path: Path, to: str, monkeypatch: pytest.MonkeyPatch) -> None:
    resource = pytest.importorskip("resource", reason="Windows has no limit of a file's size")
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # the writer is imported below: its bytecode would be cut
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        with pytest.raises(OSError, match=r"too large|No space"):
            export_recordings([static], to, tmp_path, "01")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


def test_c3d_has_the_force_at_a_multiple_of_the_frame_rate(static: Path, trial: Trial, tmp_path: Path) -> None:
    c3d = ezc3d.c3d(str(export(static, "c3d", tmp_path)[".c3d"]))
    assert c3d["parameters"]["ANALOG"]["LABELS"]["value"] == ["force_n"]
    assert c3d["parameters"]["ANALOG"]["UNITS"]["value"] == ["N"]
    assert c3d["parameters"]["ANALOG"]["RATE"]["value"][0] == 1000.0
    read = c3d["data"]["analogs"][0, 0]
    assert len(read) == 10 * c3d["data"]["points"].shape[2]
    time = trial.marker_time[0] + np.arange(len(read)) / 1000
    assert_allclose(read, np.interp(time, trial.force_time, trial.force), rtol=0, atol=1e-3)
    assert np.isnan(c3d["data"]["points"][0, -1]).sum() == 50
    points = dict(zip(c3d["parameters"]["POINT"]["LABELS"]["value"], c3d["data"]["points"].swapaxes(0, 1), strict=True))
    for label, axis, found in coordinates_of(trial):
        assert_allclose(points[label]["xyz".index(axis)], 1e3 * found, rtol=0, atol=1e-4)


def coordinates_of(trial: Trial) -> Iterator[tuple[str, str, np.ndarray]]:
    """Label, axis and metres of every frame, NaN where the marker is hidden."""
    for number, label in enumerate(trial.labels):
        for axis in range(3):
            yield label, "xyz"[axis], trial.markers[:, number, axis]


def test_tables_have_a_sidecar_with_units_rates_calibration_and_clock(static: Path, tmp_path: Path) -> None:
    out = export(static, "csv", tmp_path)
    plain = json.loads(out[".csv.json"].read_text(encoding="utf-8"))
    assert plain["files"] == [out["_force.csv"].name, out["_markers.csv"].name]
    assert (plain["force"]["unit"], plain["markers"]["unit"]) == ("N", "m")
    assert plain["force"]["calibration"]["newtons_per_unit"] == pytest.approx(98.0665)
    assert plain["force"]["rate_hz"] == pytest.approx(1000, rel=1e-4)
    assert plain["markers"]["missing_frames"]["cuff_1"] == 50
    assert plain["clock"]["zero"] == "the sync edge"
    assert plain["clock"]["zero_utc"].startswith("2023-11-14T22:13:2")
    header, first = out["_markers.csv"].read_text(encoding="utf-8").splitlines()[:2]
    assert header.startswith("time_s,anchor_1_x_m,anchor_1_y_m,anchor_1_z_m,")
    assert len(first.split(",")) == len(header.split(",")) == 16


def test_parquet_has_units_and_null_where_a_marker_is_missing(static: Path, trial: Trial, tmp_path: Path) -> None:
    out = export(static, "parquet", tmp_path)
    markers, force = (parquet.read_table(out[f"_{name}.parquet"]) for name in ("markers", "force"))
    assert markers.schema.field("cuff_1_x_m").metadata == {b"unit": b"m"}
    assert force.schema.field("force_n").metadata == {b"unit": b"N"}
    assert markers["cuff_1_x_m"].null_count == 50
    assert_allclose(force["force_n"], trial.force, rtol=1e-6, atol=1e-12)
    assert_allclose(force["time_s"], trial.force_time, rtol=1e-6, atol=1e-12)
    assert_allclose(markers["time_s"], trial.marker_time, rtol=1e-6, atol=1e-12)
    for label, axis, found in coordinates_of(trial):
        column = markers[f"{label}_{axis}_m"].to_numpy(zero_copy_only=False)
        assert_allclose(column, found, rtol=1e-6, atol=1e-12)
    assert json.loads(force.schema.metadata[b"station"])["test"] == "static"


def test_motion_bids_is_a_data_set_whose_columns_are_its_channels(session: Path, trial: Trial, tmp_path: Path) -> None:
    first, second = sorted(session.glob("*.mcap"))
    for path in (first, second, second):
        export_recordings([path], "bids", tmp_path, "S 07")
    described = json.loads((tmp_path / "dataset_description.json").read_text())
    assert described["BIDSVersion"] and described["DatasetType"] == "raw"
    assert (tmp_path / "participants.tsv").read_text() == "participant_id\nsub-S07\n"
    scans = (tmp_path / "sub-S07" / "sub-S07_scans.tsv").read_text().splitlines()
    assert len(scans) == 3 and scans[0] == "filename\tacq_time"
    name = "sub-S07_task-static_tracksys-omc_acq-hand_run-1"
    assert scans[2].startswith(f"motion/{name}_motion.tsv\t2023-11-14T22:13:2")
    folder = tmp_path / "sub-S07" / "motion"
    channels = [line.split("\t") for line in (folder / f"{name}_channels.tsv").read_text().splitlines()]
    assert channels[0] == ["name", "component", "type", "tracked_point", "units", "reference_frame"]
    assert channels[1] == ["anchor_1_x", "x", "POS", "anchor_1", "m", "lab"]
    rows = [line.split("\t") for line in (folder / f"{name}_motion.tsv").read_text().splitlines()]
    assert {len(row) for row in rows} == {len(channels) - 1} == {15}
    assert sum(row[-1] == "n/a" for row in rows) == 50
    names = [channel[0] for channel in channels[1:]]
    columns = {name: [float(row[at].replace("n/a", "nan")) for row in rows] for at, name in enumerate(names)}
    for label, axis, found in coordinates_of(trial):
        assert_allclose(columns[f"{label}_{axis}"], found, rtol=0, atol=1e-7)
    sidecar = json.loads((folder / f"{name}_motion.json").read_text())
    assert (sidecar["SamplingFrequency"], sidecar["TaskName"], sidecar["POSChannelCount"]) == (100.0, "static", 15)
    assert (folder / f"{name}_events.tsv").read_text() == "onset\tduration\ttrial_type\n0.0\t0\tsync_edge\n"
    physio = json.loads((folder / f"{name}_recording-loadcell_physio.json").read_text())
    force = gzip.decompress((folder / f"{name}_recording-loadcell_physio.tsv.gz").read_bytes()).decode().split()
    assert len(force) == len(trial.force) and physio["Columns"] == ["force"] and physio["force"]["Units"] == "N"
    assert physio["StartTime"] == pytest.approx(trial.force_time[0])
    assert_allclose([float(word) for word in force], trial.force, rtol=1e-6, atol=1e-12)


def test_names_of_the_console_become_entities_and_exports_are_reproducible(static: Path, tmp_path: Path) -> None:
    named = tmp_path / "sub-P3_ses-monday_task-static_acq-hand_run-1.mcap"
    named.write_bytes(static.read_bytes())
    written = export_recordings([named], "bids", tmp_path / "out", "01").paths
    folder = tmp_path / "out" / "sub-P3" / "ses-monday" / "motion"
    assert folder / "sub-P3_ses-monday_task-static_tracksys-omc_acq-hand_run-1_motion.tsv" in written
    for to in ("csv", "bids"):
        once, twice = (export_recordings([static], to, tmp_path / name, "01").paths for name in ("a", "b"))
        assert [path.read_bytes() for path in once] == [path.read_bytes() for path in twice]


def test_a_session_is_exported_and_damaged_recordings_are_reported(station, session: Path, tmp_path: Path) -> None:
    for path in session.glob("*.mcap"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    command = ("export", "--session", tmp_path, "--to", "trc", "--output", tmp_path / "out")
    ran = station(*command)
    assert ran.code == 0 and len(ran.out.split()) == 4 and all(Path(line).exists() for line in ran.out.split())
    (tmp_path / "cuff-hand_test-static_run-2.mcap").write_bytes(b"\x89MCAP0\r\n" + b"x" * 50)
    ran = station(*command)
    assert ran.code == 3 and len(ran.out.split()) == 4 and "run-2.mcap" in ran.err


def test_lost_samples_are_reported_by_an_export_and_by_info(station, session: Path, tmp_path: Path) -> None:
    truth = static_and_dynamic()[0]
    kept = np.delete(np.arange(len(truth.tracks["/force"].values)), slice(5000, 5100))
    lossy = truth.with_track("/force", kept).record(tmp_path / "lossy.mcap")
    (gap,) = read_contents(lossy).gaps
    assert (gap.stream, gap.count) == ("/force", 100)
    whole = session / "cuff-hand_test-dynamic_run-1.mcap"
    (tmp_path / whole.name).write_bytes(whole.read_bytes())
    ran = station("export", "--session", tmp_path, "--to", "bids", "--output", tmp_path / "out", "--format", "json")
    assert ran.code == station("info", lossy).code == 3
    (note,) = json.loads(ran.out)["note_codes"]
    assert note["code"] == ExportCode.INCOMPLETE
    assert note["figures"] == {"file": lossy.name, "reasons": read_contents(lossy).shortfalls[0]}
    assert station("export", whole, "--to", "csv", "--output", tmp_path / "out").code == 0


def test_a_stream_without_samples_and_a_bounce_are_exported(station, tmp_path: Path) -> None:
    truth = static_and_dynamic()[0]
    path = truth.with_track("/markers", slice(0)).record(tmp_path / "none.mcap")
    ran = station("export", path, "--to", "csv", "--output", tmp_path / "out")
    assert ran.code == 3
    titles, *rows = csv.reader((tmp_path / "out" / "none_markers_raw.csv").read_text().splitlines())
    assert len(titles) == 3 + 3 * len(truth.tracks["/markers"].stream.labels) and not rows
    truth = static_and_dynamic()[1]
    manifest = replace(truth.manifest, cuff=None, test="bounce", bounce=BounceRig(2.0, "cuff_1"))
    path = replace(truth, manifest=manifest).record(tmp_path / "test-bounce_run-1.mcap")
    with raises_refusal(ExportCode.BOUNCE, kind=ExportRefused):
        export_recordings([path], "mot", tmp_path, "01")
    assert set(export(path, "csv", tmp_path / "out")) == {"_force.csv", "_markers.csv", ".csv.json"}
    assert read_contents(path).complete


def test_a_wrong_command_is_refused(station, static: Path, tmp_path: Path) -> None:
    lacking = ((("--to", "csv"), "FILE or --session"), ((static,), "--to"), ((), "FILE or --session, --to"))
    for given, missing in lacking:
        assert_refused(station("export", *given), 2, ExportCode.INCOMPLETE_COMMAND, f"lacks {missing};")
    both = station("export", static, "--session", tmp_path, "--to", "csv")
    assert_refused(both, 2, ExportCode.UNUSED_OPTION)
    assert_refused(station("export", "--osim"), 2, ExportCode.INCOMPLETE_MODEL_COMMAND)
    assert_refused(
        station("export", static, "--to", "csv", "--osim", "--output", tmp_path / "model.osim"),
        2,
        ExportCode.UNUSED_OPTION,
        "FILE, --to",
    )
    assert_refused(station("export", "--session", tmp_path, "--to", "csv"), 1, ExportCode.NO_RECORDING)
    assert_refused(station("export", tmp_path / "none.mcap", "--to", "csv"), 1, ExportCode.NOT_EXPORTED, "none.mcap")
    assert station("export", static, "--to", "xlsx").code == 2


def test_an_output_that_is_a_file_is_wrong_usage(station, static: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    for output in (tmp_path / "file", tmp_path / "file" / "below"):
        ran = station("export", static, "--to", "csv", "--output", output)
        assert_refused(ran, 2, InputCode.OUTPUT_IS_FILE)
        assert_refused(station("replay", static, "--session", output), 2, InputCode.OUTPUT_IS_FILE)
    ran = station("export", "--osim", "--output", tmp_path / "file" / "model.osim")
    assert_refused(ran, 2, InputCode.OUTPUT_IS_FILE)
    (tmp_path / "model.osim").mkdir()
    assert station("export", "--osim", "--output", tmp_path / "model.osim").code == 2
    assert (tmp_path / "file").read_text() == "kept"


def test_only_csv_gives_the_raw_samples_where_the_sync_line_is_bad(station, tmp_path: Path) -> None:
    truth = static_and_dynamic()[0]
    path = truth.with_track("/sync", values=0 * truth.tracks["/sync"].values).record(tmp_path / "low.mcap")
    with raises_refusal(ExportCode.RAW_POSSIBLE, kind=ExportRefused):
        export_recordings([path], "parquet", tmp_path / "out", "01")
    assert not (tmp_path / "out").exists()
    ran = station("export", path, "--to", "csv", "--output", tmp_path / "out", "--format", "json")
    plain = json.loads(ran.out)
    assert ran.code == 3 and [reason["code"] for reason in plain["refused_codes"]] == [ExportCode.RAW_ONLY]
    written = {Path(line).name: Path(line) for line in plain["written"]}
    assert set(written) == {"low_force_raw.csv", "low_sync_raw.csv", "low_markers_raw.csv", "low_raw.csv.json"}
    titles, *rows = csv.reader(written["low_force_raw.csv"].read_text().splitlines())
    force = truth.tracks["/force"]
    assert titles == ["sample_number", "device_time_s", "arrived_utc_ns", "force_v"]
    assert [int(row[0]) for row in rows] == force.sample_numbers.tolist()
    np.testing.assert_array_equal([float(row[3]) for row in rows], force.values[:, 0])
    titles, *rows = csv.reader(written["low_markers_raw.csv"].read_text().splitlines())
    markers = truth.tracks["/markers"].values[..., :3]
    assert titles[3:6] == [f"{truth.tracks['/markers'].stream.labels[0]}_{axis}_mm" for axis in "xyz"]
    found = np.array([[float(word or "nan") for word in row[3:]] for row in rows], np.float32)
    np.testing.assert_array_equal(found, markers.reshape(len(markers), -1))
    sidecar = json.loads(written["low_raw.csv.json"].read_text())
    assert sidecar["files"]["low_force_raw.csv"]["unit"] == "V" and "sync line" in sidecar["clock"]


def test_a_recovered_copy_never_replaces_its_original_in_an_export(station, static: Path, tmp_path: Path) -> None:
    original = tmp_path / static.name
    original.write_bytes(static.read_bytes())
    (tmp_path / f"{static.stem}.recovered.mcap").write_bytes(static.read_bytes())
    for stem in (static.stem, f"{static.stem}.recovered"):
        ran = station("export", "--session", tmp_path, "--to", "csv", "--output", tmp_path / "out")
        assert {Path(line).name for line in ran.out.split()} == {
            f"{stem}{end}" for end in ("_force.csv", "_markers.csv", ".csv.json")
        }
        original.unlink(missing_ok=True)  # a recovered copy without its original is exported


def test_files_for_foxglove_are_in_a_separate_folder(station, static: Path, trial: Trial, tmp_path: Path) -> None:
    ran = station("export", static, "--to", "foxglove", "--output", tmp_path)
    assert ran.code == 0
    path = Path(ran.out.strip())
    assert path == tmp_path / "foxglove" / static.name
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        metadata = next(iter(make_reader(file).iter_metadata()))
    counts = {summary.channels[channel].topic: n for channel, n in summary.statistics.channel_message_counts.items()}
    assert counts["/force"] == len(trial.force)
    assert counts["/markers"] == counts["/tf"] > 100
    assert json.loads(metadata.metadata["station"])["recording"] == static.name
    assert not list(tmp_path.glob("*.mcap")), "a fit of the folder would take it for a recording"


# Force on the cuff for OpenSim: vector, gap-free segments, filled gaps, and the result of OpenSim's own Storage.


def record_static(folder: Path, hidden: slice, lost: Sequence[int] = ()) -> Path:
    """A static trial whose cuff marker is hidden in some frames, and of whose force some samples were lost."""
    truth = hide(static_and_dynamic()[0], hidden)
    for name in ("/force", "/sync"):
        truth = truth.with_track(name, np.delete(np.arange(len(truth.tracks[name].values)), lost))
    folder.mkdir(exist_ok=True)
    return truth.record(folder / "static.mcap")


def export_force(static: Path, to: str, output: Path, *, fills_gaps: bool = False) -> Exported:
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
    done = export_force(static, to, tmp_path)
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


def test_a_hidden_marker_leaves_two_segments_and_rows_are_counted(static: Path, trial: Trial, tmp_path: Path) -> None:
    done = export_force(static, "mot", tmp_path)
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
    done = export_force(record_static(tmp_path, slice(0), LOST), "mot", tmp_path)
    first, second = tables(done)
    assert second[0, 0] - first[-1, 0] == pytest.approx(0.041, abs=1e-4)


def test_filled_gaps_are_one_file_whose_filled_rows_are_counted(tmp_path: Path) -> None:
    path = record_static(tmp_path, HIDDEN, LOST)
    done, trial = export_force(path, "mot", tmp_path, fills_gaps=True), read_trial(path)
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


def test_without_gaps_there_is_one_file_and_an_unseen_cuff_is_refused(tmp_path: Path) -> None:
    done = export_force(record_static(tmp_path, slice(0)), "sto", tmp_path)
    assert [path.suffix for path in done.paths] == [".sto", ".json"]
    assert done.paths[0].stem.endswith("_force")
    assert not done.notes
    with raises_refusal(ExportCode.NO_DIRECTION, kind=ExportRefused):
        export_force(record_static(tmp_path / "unseen", slice(None)), "mot", tmp_path / "out")
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
def test_opensim_reads_every_row(static: Path, tmp_path: Path, trial: Trial, to: str, fills_gaps: bool) -> None:
    opensim = pytest.importorskip("opensim")
    done = export_force(static, to, tmp_path, fills_gaps=fills_gaps)
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


# A wearer's trials as files of other programs: markers, cord, EMG and cycles; info and replay of a motion.


@pytest.fixture(scope="module")
def wearer_trial(wearer: WearerSession) -> WearerTrial:
    return read_wearer_trial(wearer.path(TIGHT))


def test_csv_has_emg_in_volts_of_electrodes(wearer: WearerSession, wearer_trial: WearerTrial, tmp_path: Path) -> None:
    files = export(wearer.path(TIGHT), "csv", tmp_path)
    header, *_ = files["_emg.csv"].read_text(encoding="utf-8").splitlines()
    table = np.loadtxt(files["_emg.csv"], delimiter=",", skiprows=1)
    assert header == "time_s,deltoid_v,trapezius_v"
    np.testing.assert_array_equal(table[:, 0], wearer_trial.emg.time)
    np.testing.assert_array_equal(table[:, 1:], wearer_trial.emg.values)
    assert 0.05e-3 < table[:, 1].std() < 0.5e-3
    description = json.loads(files[".csv.json"].read_text(encoding="utf-8"))
    assert (description["condition"], description["body"]["is_cord_measured"]) == ("tight", True)
    emg = description["emg"]
    assert (emg["unit"], emg["rate_hz"], emg["lost_s"]) == ("V", 1000.0, [])
    electrodes = wearer.person.emg("deltoid", wearer.starts[wearer.path(TIGHT).name] + table[:, 0])
    assert np.corrcoef(electrodes, table[:, 1])[0, 1] > 0.9, "the clocks agree within a sample"
    assert table[:, 1].std() == pytest.approx(electrodes.std(), rel=0.05)
    assert table[:, 1].max() < 10 / GAIN, "the gain of the amplifier is divided out"


def test_trc_holds_the_markers_of_body_and_cuff_and_the_cycles(wearer: WearerSession, tmp_path: Path) -> None:
    files = export(wearer.path(TIGHT), "trc", tmp_path)
    assert {*BODY["markers"], *BODY["suit_markers"], "cuff_1"} <= set(read_trc(files[".trc"]).labels)
    cycles = json.loads(files[".trc.json"].read_text(encoding="utf-8"))["cycles"]
    assert len(cycles) == BODY["cycles"]
    assert all(cycle["start_s"] < cycle["peak_s"] < cycle["end_s"] for cycle in cycles)
    assert all(110 < cycle["highest_deg"] < 150 for cycle in cycles)


def test_ezc3d_reads_markers_and_emg(wearer: WearerSession, wearer_trial: WearerTrial, tmp_path: Path) -> None:
    c3d = ezc3d.c3d(str(export(wearer.path(TIGHT), "c3d", tmp_path)[".c3d"]))
    analog = c3d["parameters"]["ANALOG"]
    assert analog["LABELS"]["value"] == ["force_n", "deltoid", "trapezius"]
    assert analog["UNITS"]["value"] == ["N", "V", "V"]
    assert set(BODY["markers"]) <= set(c3d["parameters"]["POINT"]["LABELS"]["value"])
    emg = c3d["data"]["analogs"][0, 1:].T
    np.testing.assert_allclose(emg.std(axis=0), wearer_trial.emg.values.std(axis=0), rtol=0.01)
    middle = wearer_trial.emg.values[5000:5100]
    assert any(np.allclose(emg[start : start + 100], middle, rtol=1e-6) for start in range(4980, 5020)), "not filtered"


def test_bids_separates_the_conditions_and_keeps_emg_as_physio(wearer: WearerSession, tmp_path: Path) -> None:
    done = export_recordings([wearer.path(spec) for spec in SPECS], "bids", tmp_path, "01")
    names = [path.name for path in done.paths]
    assert len(set(names)) == len(names)
    stem = "sub-01_task-motion_tracksys-omc_acq-tight_run-1_recording-emg_physio"
    physio = next(path for path in done.paths if path.name == f"{stem}.tsv.gz")
    sidecar = json.loads(physio.with_name(f"{stem}.json").read_text(encoding="utf-8"))
    first = gzip.decompress(physio.read_bytes()).decode().splitlines()[0].split("\t")
    assert (sidecar["Columns"], sidecar["deltoid"], len(first)) == (["deltoid", "trapezius"], {"Units": "V"}, 2)
    assert sidecar["SamplingFrequency"] == pytest.approx(1000.0, rel=1e-3)


def test_foxglove_has_a_curve_of_every_channel_and_mot_is_refused(wearer: WearerSession, tmp_path: Path) -> None:
    with raises_refusal(ExportCode.NO_CUFF_FORCE, kind=ExportRefused):
        export_recordings([wearer.path(TIGHT)], "mot", tmp_path, "01")
    done = export_recordings([wearer.path(TIGHT)], "foxglove", tmp_path, "01")
    with done.paths[0].open("rb") as file:
        summary = make_reader(file).get_summary()
    topics = {channel.topic for channel in summary.channels.values()}
    assert {"/emg/deltoid", "/emg/trapezius", "/force", "/markers"} <= topics


def test_info_names_markers_elevation_and_emg_of_a_motion(station, wearer: WearerSession) -> None:
    table, plain = (station("info", wearer.path(TIGHT)), station("info", wearer.path(TIGHT), "--format", "json"))
    assert (table.code, plain.code) == (0, 0)
    for text in (*BODY["markers"], *BODY["suit_markers"], "ac to EpL relative to c7 to t8", "deltoid ×500"):
        assert text in table.out
    assert set(json.loads(plain.out)["topics"]) >= {"/emg", "/force", "/markers"}
    assert "cord_" not in station("info", wearer.path(FREE)).out, "the suit is not worn: none of its markers is missing"


def test_a_replayed_motion_is_the_same_trial_and_is_drawn(station, wearer: WearerSession, tmp_path: Path) -> None:
    rrd, folder = tmp_path / "motion.rrd", tmp_path / "simulated" / "again"
    ran = station("replay", wearer.path(TIGHT), "--session", folder, "--speed", 500, "--rrd", rrd)
    assert ran.code == 0, ran.err
    before, after = (read_wearer_trial(path) for path in (wearer.path(TIGHT), folder / TIGHT.file_name(1)))
    assert before.emg is not None and after.emg is not None
    np.testing.assert_array_equal(after.emg.values, before.emg.values)
    np.testing.assert_array_equal(after.emg.time, before.emg.time)
    np.testing.assert_array_equal(after.markers, before.markers)
    assert after.cycles == before.cycles
    assert open_recording(folder / TIGHT.file_name(1)).manifest.emg == before.manifest.emg
    content = rrd.read_bytes()
    assert b"/wearer/elevation_deg" in content and b"/wearer/emg_uv/deltoid" in content
