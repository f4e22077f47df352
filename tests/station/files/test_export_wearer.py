"""A wearer's trials as files of other programs: markers, cord, EMG and cycles; info and replay of a motion."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from mcap.reader import make_reader

from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from recordings.exchange.trc import read_trc
from recordings.reader import open_recording
from station.files.export_trial import export_recordings
from station.files.synchronised import ExportRefused
from station.messages.file_codes import ExportCode
from tests.station.refusals import raises_refusal
from tests.station.wearer import BODY, GAIN, SPECS, WearerSession

POSE, FREE, TIGHT = SPECS


@pytest.fixture(scope="module")
def trial(wearer: WearerSession) -> WearerTrial:
    return read_wearer_trial(wearer.path(TIGHT))


def export(wearer: WearerSession, to: str, output: Path) -> dict[str, Path]:
    """What was written of the tight motion, by the end of its name."""
    path = wearer.path(TIGHT)
    done = export_recordings([path], to, output, "01")
    assert not done.refused
    return {written.name.removeprefix(path.stem): written for written in done.paths}


def test_csv_has_a_table_of_emg_in_volts_at_the_electrodes(
    wearer: WearerSession, trial: WearerTrial, tmp_path: Path
) -> None:
    files = export(wearer, "csv", tmp_path)
    header, *_ = files["_emg.csv"].read_text(encoding="utf-8").splitlines()
    table = np.loadtxt(files["_emg.csv"], delimiter=",", skiprows=1)
    assert header == "time_s,deltoid_v,trapezius_v"
    assert trial.emg is not None
    np.testing.assert_array_equal(table[:, 0], trial.emg.time)
    np.testing.assert_array_equal(table[:, 1:], trial.emg.values)
    assert 0.05e-3 < table[:, 1].std() < 0.5e-3
    description = json.loads(files[".csv.json"].read_text(encoding="utf-8"))
    assert (description["condition"], description["body"]["is_cord_measured"]) == ("tight", True)
    emg = description["emg"]
    assert (emg["unit"], emg["rate_hz"], emg["lost_s"]) == ("V", 1000.0, [])


def test_the_cycles_of_the_arm_are_in_the_description(wearer: WearerSession, tmp_path: Path) -> None:
    cycles = json.loads(export(wearer, "trc", tmp_path)[".trc.json"].read_text(encoding="utf-8"))["cycles"]
    assert len(cycles) == BODY["cycles"]
    assert all(cycle["start_s"] < cycle["peak_s"] < cycle["end_s"] for cycle in cycles)
    assert all(110 < cycle["highest_deg"] < 150 for cycle in cycles)


def test_another_library_reads_markers_and_emg_of_the_c3d(
    wearer: WearerSession, trial: WearerTrial, tmp_path: Path
) -> None:
    c3d = ezc3d.c3d(str(export(wearer, "c3d", tmp_path)[".c3d"]))
    analog = c3d["parameters"]["ANALOG"]
    assert analog["LABELS"]["value"] == ["force_n", "deltoid", "trapezius"]
    assert analog["UNITS"]["value"] == ["N", "V", "V"]
    assert set(BODY["markers"]) <= set(c3d["parameters"]["POINT"]["LABELS"]["value"])
    emg = c3d["data"]["analogs"][0, 1:].T
    assert trial.emg is not None
    np.testing.assert_allclose(emg.std(axis=0), trial.emg.values.std(axis=0), rtol=0.01)
    middle = trial.emg.values[5000:5100]
    assert any(np.allclose(emg[start : start + 100], middle, rtol=1e-6) for start in range(4980, 5020)), "not filtered"


def test_trc_holds_the_body_s_markers_beside_the_cuff_s(wearer: WearerSession, tmp_path: Path) -> None:
    table = read_trc(export(wearer, "trc", tmp_path)[".trc"])
    assert {*BODY["markers"], *BODY["suit_markers"], "cuff_1"} <= set(table.labels)


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


def test_foxglove_has_a_curve_for_each_channel(wearer: WearerSession, tmp_path: Path) -> None:
    done = export_recordings([wearer.path(TIGHT)], "foxglove", tmp_path, "01")
    with done.paths[0].open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert {"/emg/deltoid", "/emg/trapezius", "/force", "/markers"} <= topics


def test_a_wearer_s_trial_has_no_load_on_a_cuff_to_export(wearer: WearerSession, tmp_path: Path) -> None:
    with raises_refusal(ExportRefused, ExportCode.NO_CUFF_FORCE):
        export_recordings([wearer.path(TIGHT)], "mot", tmp_path, "01")


def test_the_gain_of_the_amplifier_is_divided_out(wearer: WearerSession, trial: WearerTrial) -> None:
    assert trial.emg is not None
    person, start = wearer.person, wearer.starts[wearer.path(TIGHT).name]
    electrodes = person.emg("deltoid", start + trial.emg.time)
    assert np.corrcoef(electrodes, trial.emg.values[:, 0])[0, 1] > 0.9, "the clocks agree within a sample"
    assert trial.emg.values[:, 0].std() == pytest.approx(electrodes.std(), rel=0.05)
    assert trial.emg.values.max() < 10 / GAIN


def test_info_names_markers_elevation_and_emg_of_a_motion(station, wearer: WearerSession) -> None:
    table, plain = (
        station("info", wearer.path(TIGHT)),
        station("info", wearer.path(TIGHT), "--format", "json"),
    )
    assert (table.code, plain.code) == (0, 0)
    for text in (*BODY["markers"], *BODY["suit_markers"], "ac to EpL relative to c7 to t8", "deltoid ×500"):
        assert text in table.out
    assert set(json.loads(plain.out)["topics"]) >= {"/emg", "/force", "/markers"}


def test_markers_that_a_trial_does_not_need_are_not_occluded_in_it(station, wearer: WearerSession) -> None:
    assert "cord_" not in station("info", wearer.path(SPECS[1])).out, "the suit is not worn"


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
