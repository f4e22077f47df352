"""The end of a session, in one function for every front end: cuffs on the wearer, EMG; the list of sessions."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from documents.message import Message
from drivers.simulators.settings import PersonSettings
from fitting.results.codes import NoteCode
from fitting.results.sentences import Note
from fitting.results.trial_codes import TrialNoteCode
from solver.compile_ahead import COMPILER
from station.assessment.assessment_inputs import InputError
from station.checksums import JOURNAL_FILE
from station.config import StationConfig, parse_config
from station.fit import SessionError, fit_session_folder
from station.journal import Assignment, Setup, write_assigned, write_setup, write_verdict
from station.messages.assessment_messages import AssessmentCode
from station.messages.setup_messages import FolderCode
from station.progress import COMPILING
from station.session.open_session import EarlierSessions, list_sessions
from station.session.summary import NOT_ASSESSED, EndedSession, SummaryError, end_session, summarise
from station.subject.subject_file import Cord, Subject, write_subject
from tests.refusals import raises_refusal
from tests.station.foreign import static_and_dynamic
from tests.station.wearer import SPECS, WearerSession

POSE, FREE, TIGHT = (spec.file_name(1) for spec in SPECS)
SHORT: dict[str, Any] = {"most_frames": 6, "most_rest_lengths": 4, "people": None}
FRAMES_FOR_EMG = 45
"""EMG is compared with activations that are at most half a second apart."""
CUFF = {"anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"]}
BODY = {"markers": ["ij", "px", "c7"], "conditions": ["unsuited", "tight"]}


def record_hand(folder: Path) -> None:
    for truth in static_and_dynamic():
        truth.record(folder / f"cuff-hand_test-{truth.manifest.test}_run-1.mcap")


def end_wearer_session(
    folder: Path, wearer: WearerSession, subject: str, *files: str, most_frames: int = SHORT["most_frames"]
) -> EndedSession:
    """With the hand cuff, these recordings of the wearer, and subject.toml unless it is empty."""
    record_hand(folder)
    for file in files:
        shutil.copy(wearer.folder / file, folder)
    if subject:
        (folder / "subject.toml").write_text(subject, encoding="utf-8")
    return end_session(folder, options=SHORT | {"most_frames": most_frames})


def codes_of(folder: Path) -> dict[str, dict[str, Any]]:
    """Code → figures of the findings of the assessment."""
    assessed = json.loads((folder / "assessment.json").read_text(encoding="utf-8"))
    return {finding["code"]: finding["figures"] for finding in assessed["finding_codes"]}


@pytest.mark.slow
def test_a_session_is_assessed_on_the_wearer_who_was_recorded_with_emg(tmp_path: Path, wearer: WearerSession) -> None:
    subject = f"mass_kg = 75.0\n[cord]\nrest_length_m = {PersonSettings().cord_rest_length_m}\n"
    ended = end_wearer_session(tmp_path, wearer, subject, POSE, FREE, TIGHT, most_frames=FRAMES_FOR_EMG)
    assert ended.missing == () and ended.assessed is not None and ended.assessed.subject is not None
    assert ended.assessed.subject.motion == FREE and ended.assessed.subject.mass_kg == 75.0
    assert not {code for code in codes_of(tmp_path) if code.startswith("wearer.")}
    emg = json.loads((tmp_path / "emg.json").read_text(encoding="utf-8"))
    assert [change["channel"] for change in emg["changes"]] == ["deltoid", "trapezius"]
    assert all(change["emg_ratio"]["value"] < 1 for change in emg["changes"]), "the tight cord carries a part"


@pytest.mark.parametrize(
    ("subject", "files", "code", "reason"),
    [
        ("mass_kg = 75.0\n", (POSE,), AssessmentCode.WEARER_NOT_RECORDED, None),
        ("", (POSE, FREE), AssessmentCode.WEARER_NOT_ASSESSED, "subject.unreadable"),
        pytest.param(
            *("mass = 75.0\n", (POSE, FREE), AssessmentCode.WEARER_NOT_ASSESSED, "subject.invalid_key"),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_wearer_who_cannot_be_assessed_is_named_with_the_reason(
    tmp_path: Path,
    wearer: WearerSession,
    subject: str,
    files: tuple[str, ...],
    code: AssessmentCode,
    reason: str | None,
) -> None:
    ended = end_wearer_session(tmp_path, wearer, subject, *files)
    assert ended.assessed is not None and ended.assessed.subject is None
    assert codes_of(tmp_path)[code].get("reason_code") == reason
    assert "Body and motion are the bundled ones" in ended.page.read_text(encoding="utf-8")


def test_a_session_without_a_wearable_cuff_has_its_table_and_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse = Mock(side_effect=InputError("the cuff hand has the law creep"))
    monkeypatch.setattr("station.assessment.assessment_inputs.worn_cuffs", refuse)
    monkeypatch.setattr("station.assessment.assess.worn_cuffs", refuse)
    record_hand(tmp_path)
    summary = summarise(tmp_path)
    assert [row["cuff"] for row in summary.rows] == ["hand"]
    assert summary.findings == (
        NOT_ASSESSED,
        "not in the assessment: the cuff hand has the law creep",
        "no assessment: the cuff hand has the law creep",
    )
    assert (tmp_path / "report.html").is_file() and (tmp_path / "cuffs.json").is_file()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_cuff_without_migration_is_assessed_without_shift_and_named(tmp_path: Path) -> None:
    """An earlier static recording of the donning was redone without donning the cuff anew."""
    record_hand(tmp_path)
    static, _ = static_and_dynamic()
    earlier = replace(static.manifest, start_utc_ns=static.manifest.start_utc_ns - 10**11)
    replace(static, manifest=earlier).record(tmp_path / "cuff-hand_test-static_run-0.mcap")
    write_verdict(tmp_path, "cuff-hand_test-static_run-0.mcap", "redo", "the wearer coughed")
    summary = summarise(tmp_path)
    assert summary.rows[0]["migration [mm]"] == "not identified"
    assert f"hand: {NoteCode.NO_SHIFT.sentence()}" in summary.findings
    assessed = json.loads((tmp_path / "assessment.json").read_text())
    hand = assessed["cuffs"]["hand"]
    assert (hand["migration_m"]["value"], hand["migration_m"]["ci95"]) == (0.0, None)
    assert hand["assumed_codes"] == [NoteCode.NO_SHIFT]
    both, yielding = (assessed["at_rigid_optimum"]["hand"][condition] for condition in ("both", "visco_elastic"))
    assert both["value"] == pytest.approx(yielding["value"], rel=1e-9), "no shift"
    assert NoteCode.NO_SHIFT.sentence() in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_recording_that_was_assigned_is_fitted_as_the_other_trial(tmp_path: Path) -> None:
    record_hand(tmp_path)
    site = static_and_dynamic()[0].manifest.cuff
    assert site is not None
    for test in ("static", "dynamic"):
        given = Assignment(replace(site, name="elbow"), test, 2, "1")
        write_assigned(tmp_path, f"cuff-hand_test-{test}_run-1.mcap", given)
    fitted = fit_session_folder(tmp_path, None)
    assert list(fitted.cuffs) == ["elbow"]
    static = fitted.cuffs["elbow"].trials[0]
    assert (static.test, static.repeat, static.state) == ("static", 2, "used")
    assert Note(TrialNoteCode.ASSIGNED, {"recorded_as": "hand, static, 1"}) in static.notes


def test_an_empty_session_is_refused(tmp_path: Path) -> None:
    with raises_refusal(FolderCode.NO_RECORDING, kind=SummaryError):
        summarise(tmp_path)


def test_a_solver_that_is_compiled_at_the_end_of_a_session_is_a_stage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compile_a_kernel(*_: object) -> EndedSession:
        COMPILER.warning("compiling a kernel")
        raise SessionError(Message(FolderCode.NO_RECORDING))

    stages: list[tuple[str, int, int]] = []
    monkeypatch.setattr("station.session.summary.end_session", compile_a_kernel)
    monkeypatch.setattr("solver.compiled.keeps_code", lambda: False)  # starts no other process
    with pytest.raises(SummaryError):
        summarise(tmp_path, lambda *stage: stages.append(stage))
    assert {name for name, _, _ in stages} == {COMPILING}


def config_of(*cuffs: str) -> StationConfig:
    data = {"cuffs": dict.fromkeys(cuffs, CUFF), "body": BODY, "protocol": {"repeats": 2, "step_masses_kg": [1.5]}}
    return parse_config(data, "test")


def add_session(folder: Path, setup: Setup, hour: int, wearer: Subject | None = None) -> None:
    session = folder / f"sub-{setup.subject}_ses-{setup.number}"
    write_setup(session, setup)
    if wearer is not None:
        write_subject(session, wearer)
    os.utime(session / JOURNAL_FILE, (3600 * hour, 3600 * hour))


def earlier(folder: Path, *cuffs: str) -> EarlierSessions:
    return EarlierSessions(list_sessions(folder), config_of(*cuffs))


def test_the_last_plan_or_that_of_the_configuration_is_suggested(tmp_path: Path) -> None:
    """Without what the configuration no longer has."""
    suggested = earlier(tmp_path, "hand", "waist")
    assert suggested.setup == Setup("", "", ("hand", "waist"), 2, False, "1", (1.5,), ("unsuited", "tight"))
    assert (suggested.next_number("P01"), suggested.wearer("P01")) == ("1", Subject())
    add_session(tmp_path, Setup("P02", "late", ("waist", "tube"), 5, True, "1", (2.0, 2.0), ("slack",)), 2)
    add_session(tmp_path, Setup("P01", "early", ("hand",), 1), 1)
    expected = Setup("", "late", ("waist",), 5, False, "1", (2.0, 2.0), ("slack",))
    assert earlier(tmp_path, "hand", "waist").setup == expected


@pytest.mark.parametrize(("used", "suggested"), [(("1", "2"), "3"), (("3",), "4"), (("monday",), "1"), ((), "1")])
def test_the_next_number_of_the_subject_is_suggested(tmp_path: Path, used: tuple[str, ...], suggested: str) -> None:
    for hour, number in enumerate(used):
        add_session(tmp_path, Setup("P01", "", ("hand",), 1, number=number), hour)
    add_session(tmp_path, Setup("P02", "", ("hand",), 1, number="7"), 9)
    assert earlier(tmp_path, "hand").next_number("P01") == suggested


def test_the_laboratory_is_that_of_the_last_wearer_and_the_mass_of_the_same_one(tmp_path: Path) -> None:
    of_other = Subject(mass_kg=90.0, vertical="y", marker_set="isb", cord=Cord(rest_length_m=0.7, cuff="tube"))
    add_session(tmp_path, Setup("P01", "", ("hand",), 1), 1, Subject(mass_kg=61.5, hand_load_kg=2.0))
    add_session(tmp_path, Setup("P02", "", ("hand",), 1), 2, of_other)
    add_session(tmp_path, Setup("P02", "", ("hand",), 1, number="2"), 3)
    suggested = earlier(tmp_path, "hand").wearer("P01")
    assert suggested == Subject(mass_kg=61.5, vertical="y", marker_set="isb", cord=Cord(rest_length_m=0.7))
    assert earlier(tmp_path, "hand").wearer("P03").mass_kg is None
