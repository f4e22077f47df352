"""The report's part on the cuffs: a picture of every repeat, what checks the law, and what other programs need."""

import json
import re
from dataclasses import replace
from functools import cache
from html import escape, unescape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from fitting.cuffs.cuff_fit import SessionFit
from fitting.cuffs.cuffs_file import cuffs_json
from fitting.results.codes import NoteCode
from fitting.results.cuffs_schema import CuffsDocument
from fitting.results.sentences import Note
from fitting.results.trial_codes import TensorCode
from fitting.session import fit_session
from fitting.spatial.tensors import Tensor, Tensors
from fitting.trial.trial import build_trial
from recordings.manifest import CuffSite, DataOrigin, LoadCell, Manifest, MeasurementProtocol
from recordings.samples import DeviceIdentity, Event
from station.charts.marks import Chart, Line, Panel, Points, Rule, Strip
from station.files.chain import trace_chain
from station.journal import Setup, write_mark, write_note, write_setup
from station.messages.study_messages import StudyCode
from station.report import session_facts as module
from station.report.cuff_section import adopt_normative, normative_section
from station.report.fit_figures import checks_figure, fit_figure
from station.report.muscle_figures import activation_figure, change_figure, muscle_changes
from station.report.page import write_report
from station.report.session_facts import UNKNOWN, recording_rows, session_facts
from station.report.verification import number_links
from station.study.sessions import StudyError
from tests.fitting.experiment import Session, published
from tests.recordings.trials import record
from tests.refusals import raises_refusal
from tests.station.reported import unmarked_numbers

MOST_BYTES_PER_TRIAL = 60_000
"""24 trials keep below 2 MB."""


@cache
def _fitted() -> SessionFit:
    session = Session(published("waist", hold=4.0, duration=12.0), 1)
    trials = []
    for repeat in (1, 2):
        trials.append(build_trial(*session.static(repeat), f"static-{repeat}", f"s{repeat}"))
        trials.append(build_trial(*session.dynamic(repeat), f"dynamic-{repeat}", f"d{repeat}"))
    return fit_session(trials)


def _panels(drawn: Chart) -> list[Panel]:
    return [panel for column in drawn.columns for panel in column]


@pytest.fixture(scope="module")
def received() -> list[tuple[str, int, int]]:
    """Progress of the page that was written."""
    return []


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, received: list[tuple[str, int, int]]) -> Path:
    return write_report(tmp_path_factory.mktemp("report"), _fitted(), lambda *step: received.append(step))


def test_a_cuff_has_two_figures_and_the_page_stays_small(written: Path, received: list[tuple[str, int, int]]) -> None:
    page = written.read_text(encoding="utf-8")
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page)
    assert [caption.split()[0] for caption in captions] == ["Held", "Checks"]
    assert written.stat().st_size < 4 * MOST_BYTES_PER_TRIAL
    assert not re.search(r"(src|href)=\"(?!data:|#)", page)
    assert all(rule in page for rule in ("@media (prefers-color-scheme: dark)", "@media print", "break-inside: avoid"))
    count = page.count("<figure")
    assert received == [("drawing figures", done, count) for done in range(count + 1)], "progress counts the figures"


def test_recordings_that_were_fitted_are_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cuff-waist_test-static_run-1.mcap").write_bytes(b"not a recording")
    monkeypatch.setattr("station.report.page.fit_session_folder", lambda *_: pytest.fail("read again"))
    assert write_report(tmp_path, _fitted()).is_file()


def test_the_same_session_gives_the_same_page(written: Path, tmp_path: Path) -> None:
    again = write_report(tmp_path / written.parent.name, _fitted())
    assert again.read_bytes() == written.read_bytes()


def test_a_page_has_the_principal_values_of_a_cuff_pulled_in_space(tmp_path: Path) -> None:
    fitted = _fitted()
    tensor = Tensor(np.diag([1000.0, 2000.0, 3000.0]), 25.0 * np.eye(6), 1.96, 5)
    reason = Note(TensorCode.NO_ROPE, {"quantity": "damping", "test": "dynamic"})
    cuff = replace(fitted.cuffs["waist"], tensors=Tensors(tensor, None, None, reason))
    path = write_report(tmp_path, replace(fitted, donnings={"waist": {"1": cuff}}))
    page = path.read_text(encoding="utf-8")
    assert "Stiffness in three dimensions" in page
    assert "Damping in three dimensions" not in page
    assert "2000.0 (1990.2\u00a0to\u00a02009.8)" in page
    assert unmarked_numbers(path, *(trial.file for trial in fitted.cuffs["waist"].trials), tmp_path.name) == []


def test_a_note_that_all_cuffs_have_is_shown_once(tmp_path: Path) -> None:
    fitted = _fitted()
    waist = fitted.cuffs["waist"]
    own = Note(NoteCode.STIFFNESS_RATIO, {"ratio": 1.25})
    hand = replace(waist, name="hand", notes=(*waist.notes, own))
    page = write_report(tmp_path, replace(fitted, donnings={"waist": {"1": waist}, "hand": {"1": hand}}))
    text = page.read_text(encoding="utf-8")
    read = re.sub(r"<svg.*?</svg>|<style.*?</style>|<[^>]*>", "", text, flags=re.DOTALL)
    breaking = re.findall(r".{20}\d %.{20}", read)
    assert "95\u00a0%" in unescape(read) and breaking == [], "no line ends before a percent sign"
    text = text.replace("\u00a0", " ")
    assert waist.notes and [text.count(escape(str(note))) for note in hand.notes] == [1] * len(hand.notes)


def test_the_drawn_lines_are_those_of_held_loads_and_tangents() -> None:
    fitted = _fitted()
    held, *_ = _panels(fit_figure(fitted.cuffs["waist"], [fitted.pulls["static-2"]], []))
    (points,) = (mark for mark in held.marks if isinstance(mark, Points))
    (line,) = (mark for mark in held.marks if isinstance(mark, Line))
    force = np.interp(points.x, line.x, line.y)
    assert len(points.x) > 5 and np.abs(force - points.y).max() < 0.2
    fitted = _fitted()
    fit, static = fitted.cuffs["waist"], [fitted.pulls["static-1"], fitted.pulls["static-2"]]
    _, beside = _panels(fit_figure(fit, static, []))
    (line,) = (mark for mark in beside.marks if isinstance(mark, Line))
    np.testing.assert_array_equal(line.y, [stiffness.value for _, stiffness in fit.held.tangents])
    assert len(_panels(fit_figure(replace(fit, held=None), static, []))) == 1


def test_a_figure_has_only_the_panels_of_its_trials() -> None:
    fitted = _fitted()
    fit, static, dynamic = fitted.cuffs["waist"], fitted.pulls["static-1"], fitted.pulls["dynamic-1"]
    assert [panel.y_label for panel in _panels(fit_figure(fit, [], [dynamic]))] == ["F − k x [N]"]
    assert "F − k x [N]" not in [panel.y_label for panel in _panels(fit_figure(fit, [static], []))]
    single = replace(fit, trials=tuple(trial for trial in fit.trials if trial.repeat == 1))
    labels = [panel.x_label for panel in _panels(checks_figure(single, [], {}))]
    assert "repeat" not in labels and "time lag [s]" not in labels, "no forest plot of one repeat"


def test_residuals_are_uncorrelated_and_normal_for_a_cuff_that_follows_the_law() -> None:
    fitted = _fitted()
    dynamic = [fitted.pulls["dynamic-1"], fitted.pulls["dynamic-2"]]
    *_, later, normal = _panels(checks_figure(fitted.cuffs["waist"], dynamic, {}))
    for line in (mark for mark in later.marks if isinstance(mark, Line)):
        assert np.abs(line.y).max() < 0.25
    line = next(mark for mark in normal.marks if isinstance(mark, Line))
    middle = np.abs(line.x) < 2
    np.testing.assert_allclose(line.y[middle], line.x[middle], atol=0.25)


def test_bands_and_repeats_are_drawn_beside_the_fit_and_the_true_values() -> None:
    fit = _fitted().cuffs["waist"]
    assert fit.damping
    stiffness, damping, _, bands = _panels(checks_figure(fit, [], {"stiffness_n_per_m": 2140.0}))
    for panel in (damping, bands):
        assert fit.damping.value in {mark.at for mark in panel.marks if isinstance(mark, Rule)}
        assert fit.damping.ci95 in {(mark.low, mark.high) for mark in panel.marks if isinstance(mark, Strip)}
    assert sum(len(mark.x) for mark in damping.marks if isinstance(mark, Points)) == 2
    assert 2140.0 in {mark.at for mark in stiffness.marks if isinstance(mark, Rule)}


def test_muscles_that_work_more_or_less_are_drawn_alike_and_those_at_rest_left_out() -> None:
    table = pd.DataFrame(
        {
            "time_s": 0.0,
            "condition": ["slack", "both"],
            "cuff": ["", "hand"],
            "SerratusAnterior_S": [0.0, 0.03],
            "TeresMajor": [0.05, 0.02],
            "PectoralisMinor": [0.0, 0.001],
        }
    )
    changes = muscle_changes(table, ["hand"])
    assert [muscle.muscle for muscle in changes if muscle.is_at_rest] == ["PectoralisMinor"]
    levels, differences = _panels(change_figure(changes))
    assert levels.y_names == differences.y_names == ("TeresMajor", "SerratusAnterior_S")
    (points,) = (mark for mark in differences.marks if isinstance(mark, Points))
    np.testing.assert_allclose(points.x, [-0.03, 0.03])
    table = pd.DataFrame(
        {"time_s": [0.0, 1.0], "condition": "slack", "cuff": "", "DeltoideusScapula_P": 0.0, "TrapeziusScapula_S": 0.5}
    )
    assert [panel.title for panel in _panels(activation_figure(table, "hand"))] == ["TrapeziusScapula_S"]


def test_equal_activations_and_equal_held_loads_do_not_hide_each_other() -> None:
    conditions = {"condition": ["slack", "both", "both"], "cuff": ["", "hand", "tube"]}
    table = pd.DataFrame({"time_s": 0.0, **conditions, "TeresMajor": [0.05, 0.02, 0.02]})
    for panel in _panels(change_figure(muscle_changes(table, ["hand", "tube"]))):
        places = [float(mark.y[0]) for mark in panel.marks if isinstance(mark, Points) and mark.label != "slack cord"]
        assert places[0] < places[1]
    fitted = _fitted()
    held, *_ = _panels(fit_figure(fitted.cuffs["waist"], [fitted.pulls["static-1"], fitted.pulls["static-2"]], []))
    first, last = (mark for mark in held.marks if isinstance(mark, Points))
    assert (first.is_hollow, last.is_hollow) == (True, False)
    assert (first.radius or 0) > (last.radius or 0)


def test_notes_and_names_of_marks_are_shown_with_their_trial_as_they_were_typed(tmp_path: Path) -> None:
    write_setup(tmp_path, Setup("P01", "ab", ("waist",), 2))
    write_note(tmp_path, "", "<script>alert(1)</script>")
    write_note(tmp_path, "static-2", '</td></table><data class="number" id="x">7</data>')
    write_mark(tmp_path, "static-2", 1, "coughed & laughed")
    (tmp_path / "missing.json").write_text('["hand, static, repeat 2: no edge came"]', encoding="utf-8")
    page = write_report(tmp_path, _fitted()).read_text(encoding="utf-8")
    facts, recordings = page[: page.index('class="section"')], page[page.index('id="recordings"') :]
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in facts and "<script>" not in page
    (row,) = (row for row in recordings.split("<tr>") if "coughed" in row)
    assert "static, repeat 2" in row or "static-2" in row
    assert "mark 1: coughed &amp; laughed" in row and "note: &lt;/td&gt;" in row
    assert 'id="x"' not in page
    assert page.index("hand, static, repeat 2: no edge came") < page.index("<h2>"), "what is missing comes first"


# A session's cuffs beside the normative table of a study.


def _entry(mean: float, low: float, high: float) -> dict[str, Any]:
    return {
        "mean": mean,
        "mean_ci95": [0.9 * mean, 1.1 * mean],
        "prediction95": [low, high],
        "volunteers": 12,
        "repeats": 3,
    }


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "study" / "normative.json"
    path.parent.mkdir()
    cuffs = {"waist": {"stiffness": _entry(3000.0, 2500.0, 3500.0), "migration": _entry(0.012, 0.006, 0.018)}}
    document = {"format": 1, "origin": "measured", "study_sha256": "0" * 64, "cuffs": cuffs}
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_a_value_is_below_within_or_above_the_prediction_interval(table: Path) -> None:
    fit = _fitted().cuffs["waist"]
    assert fit.stiffness and fit.migration and fit.stiffness.value < 2500.0 and 0.006 < fit.migration.value < 0.018
    worn = {"waist": fit.wearable()}
    section = normative_section(table.parent, worn, DataOrigin.MEASURED)
    assert section is not None and section.has_same_origin
    assert [(row.cuff, row.quantity, row.place) for row in section.rows] == [
        ("waist", "stiffness [N/m]", "below the interval"),
        ("waist", "migration [mm]", "within the interval"),
    ]
    assert str(section.rows[1].interval) == "6.0 to 18.0"
    assert normative_section(table.parent.parent, worn, DataOrigin.MEASURED) is None


def test_the_table_is_kept_with_the_session_shown_and_verified(table: Path, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    folder.mkdir()
    adopt_normative(table, folder)
    (folder / "cuffs.json").write_text(cuffs_json(_fitted()), encoding="utf-8")
    path = write_report(folder, _fitted())
    page = path.read_text(encoding="utf-8")
    assert 'id="normative"' in page and "2500 to 3500" in page
    assert unmarked_numbers(path, *(trial.file for trial in _fitted().cuffs["waist"].trials)) == []
    assert "report.json ← normative.json, 6 numbers" in {
        link.what for link in number_links(folder) if link.standing == "as recorded"
    }
    links = {link.what: link.standing for link in trace_chain(folder)}
    assert links["normative.json"] == "as recorded"
    adopt_normative(folder / "normative.json", folder)
    assert (folder / "normative.json").read_bytes() == table.read_bytes()


def test_another_file_is_refused_and_not_copied(tmp_path: Path) -> None:
    other = tmp_path / "study.json"
    other.write_text("{}", encoding="utf-8")
    with raises_refusal(StudyCode.WRONG_NORMATIVE, kind=StudyError):
        adopt_normative(other, tmp_path)
    assert not (tmp_path / "normative.json").exists()


# Facts of the session: subject and operator from the journal, devices and protocol from the recordings.


MANIFEST = Manifest(
    cuff=CuffSite("hand", "arm", ("a1",), ("c1",)),
    test="static",
    repeat=1,
    run=1,
    donning="1",
    start="sync_edge",
    sync_threshold_v=2.5,
    load_cell=LoadCell("daq", 98.0665, 1, serial_number="LC-7", capacity_kg=50.0, calibrated_on="2026-01-15"),
    start_utc_ns=1_780_000_000_000_000_000,
    protocol=MeasurementProtocol((1.5, 1.5), 7.0, 20.0),
    devices=(DeviceIdentity("NI Dev1", "USB-6008 serial number 01C0FFEE", False),),
)


def test_the_facts_of_a_session_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    facts = {fact.name: fact.text for fact in session_facts(tmp_path, [], None, DataOrigin.UNKNOWN)}
    assert facts["Subject"] == facts["Operator"] == UNKNOWN
    assert set(facts) == {"Subject", "Operator", "Data"}
    write_setup(tmp_path, Setup("P01", "MK", ("hand",), 1))
    later = replace(MANIFEST, test="dynamic", start_utc_ns=MANIFEST.start_utc_ns + 600 * 10**9)
    found = {"first.mcap": MANIFEST, "second.mcap": later}
    monkeypatch.setattr(module, "read_manifest", lambda path: found[path.name])
    listed = session_facts(tmp_path, [tmp_path / name for name in found], None, DataOrigin.MEASURED)
    facts = {fact.name: fact.text for fact in listed}
    assert facts["Subject"] == "P01"
    assert facts["Operator"] == "MK"
    assert facts["Data"] == "measured"
    assert facts["Devices"] == "USB-6008 serial number 01C0FFEE", "a device of several trials stands once"
    assert "LC-7" in facts["Load cell"] and "2026-01-15" in facts["Load cell"]
    assert facts["Protocol"].startswith("2 trials of 1 cuff in 1 donning; static: 2 weights, 3 kg together")
    assert facts["Recorded"] == "2026-05-28 20:26 to 20:36 UTC"


def test_a_named_mark_has_its_time_from_the_sync_edge(tmp_path: Path) -> None:
    zero_ns = 1_780_000_000_000_000_000
    at_s = {"sync_edge": (2.0,), "mark": (5.25, 9.5)}
    events = [Event(kind, "", zero_ns + round(1e9 * s), "station") for kind, times in at_s.items() for s in times]
    record(tmp_path / "a.mcap", events)
    write_mark(tmp_path, "a.mcap", 2, "coughed")
    (row,) = recording_rows(tmp_path, CuffsDocument(format=1, cuffs={}))
    assert row.remarks == ("mark 2 at 7.5 s: coughed",)
