"""subject.toml, and the suit on the wearer: the simulated person's body, motion and cord, with their uncertainty.

The simulated person shares no code with the solver (drivers/simulators/wearer.py).
"""

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.simulators.settings import PersonSettings
from fitting.cuffs.wearable_cuff import with_interval_covariance
from fitting.wearer.wearer_trial import read_wearer_trial
from solver.bundled import bundled_model
from solver.suit.suit import PARTS, read_suit
from station.assessment import case
from station.assessment.assess import assess_cuffs, write_assessment
from station.assessment.assessment_file import read_assessment
from station.assessment.assessment_inputs import AssessmentInputs, read_cuffs_to_wear
from station.kinematics.marker_checks import PersonError
from station.messages.kinematics_messages import PersonCode, SubjectCode
from station.progress import silent
from station.report.page import write_report
from station.subject import assessed_subject
from station.subject.assessed_subject import (
    AssessedSubject,
    build_subject,
    compare_cord,
    cuff_on_cord,
    fit_suit,
    measure_subject,
    worn_arm_cuff,
)
from station.subject.subject_file import SUBJECT_FILE, Cord, Subject, SubjectError, read_subject, write_subject
from tests.refusals import raises_refusal
from tests.station.assessment.test_assess import write_cuffs
from tests.station.reported import few_people, unmarked_numbers
from tests.station.wearer import SPECS, WearerSession

GENERIC = bundled_model()
POSE, FREE, TIGHT = SPECS
MIDDLE = ("ij", "px", "EpL", "EpM")
CORD = PersonSettings().cord_rest_length_m
MARKED = Subject(mass_kg=61.5, vertical="y", markers={"acro mion": "aa", 'Él\u007f\t"': "ij"})
CORDED = Subject(
    mass_kg=75, hand_load_kg=2.0, marker_set=r"C:\sets\own.toml", cord=Cord(rest_length_m=0.73, cuff="hand")
)


@pytest.fixture(scope="module")
def folder(wearer: WearerSession, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wearer's session with the files that an analyst adds."""
    folder = tmp_path_factory.mktemp("subject")
    for spec in SPECS:
        shutil.copy(wearer.path(spec), folder)
    (folder / "subject.toml").write_text(f"mass_kg = 75.0\n[cord]\nrest_length_m = {CORD}\n", encoding="utf-8")
    write_cuffs(folder / "cuffs.json")
    return folder


@pytest.fixture(scope="module")
def person(folder: Path) -> AssessedSubject:
    return build_subject(folder, GENERIC)


@pytest.fixture(scope="module")
def plain(folder: Path, person: AssessedSubject) -> dict[str, Any]:
    inputs = AssessmentInputs(folder / "cuffs.json", subject=folder)
    cuffs = read_cuffs_to_wear(inputs.cuffs)
    with pytest.MonkeyPatch.context() as patch:  # the person takes seconds to estimate
        patch.setattr(case, "build_subject", lambda *_: person)
        assessed = assess_cuffs(cuffs, inputs, most_frames=20, most_rest_lengths=7, people=few_people(16, frames=12))
    write_assessment(assessed, folder)
    read_assessment(folder / "assessment.json")
    text = (folder / "assessment.json").read_text(encoding="utf-8")
    plain: dict[str, Any] = json.loads(text, parse_constant=pytest.fail)  # NaN and Infinity are not JSON
    return plain


def test_body_and_cord_are_those_of_the_simulated_person(person: AssessedSubject, wearer: WearerSession) -> None:
    estimate = person.body.estimate
    assert estimate.outcome == "converged"
    assert np.all(np.abs(estimate.factors - 1.0) < 3.0 * estimate.factor_errors)
    assert len(person.not_measured) == 2, person.not_measured  # no marker is on the forearm
    fitted = fit_suit(person, read_suit())
    assert fitted is not None
    places = wearer.person._shoulder.cord.values()
    for part, place in zip(PARTS, places, strict=True):
        np.testing.assert_allclose(getattr(fitted.suit, part).location, place[1], atol=0.008)
        assert fitted.spread[part] < 0.015


def test_the_arm_is_raised_as_far_as_it_was(person: AssessedSubject, wearer: WearerSession) -> None:
    """Glenohumeral and scapular angles are off by degrees, as the posture of the girdle is known by degrees; the drawn
    motions show by how many.
    """
    time = wearer.starts[person.assessed.file] + person.kinematics.time
    truth = wearer.person.coordinates(time)
    spread = np.std([drawn.kinematics.positions for drawn in person.drawn], axis=0)
    for name in ("shoulder_elv", "scapula_upward_rot", "plane_elv"):
        place = GENERIC.coordinate_index(name)
        error = person.kinematics.positions[:, place] - truth[:, wearer.person.coordinate_names.index(name)]
        assert np.degrees(np.sqrt(np.mean(error**2))) < 10.0, name
        assert np.sqrt(np.mean((error / spread[:, place]) ** 2)) < 2.5, name


def test_figures_are_of_the_wearer_and_the_measured_tension_is_beside_the_predicted(plain: dict[str, Any]) -> None:
    subject = plain["subject"]
    assert subject["motion"] == FREE.file_name(1) and subject["condition"] == "unsuited"
    assert plain["inputs"]["motion"].startswith(FREE.file_name(1)) and "wearer" in plain["inputs"]["model"]
    assert [trial["rms_m"] < 0.01 for trial in subject["trials"]] == [True] * 3
    low, high = plain["at_rigid_optimum"]["rigid"]["ci95"]
    assert 0.05 < high - low < 1.0, "with the body, muscles and motion of the budget"
    assert plain["unsolved"]["count"]["value"] == 0
    cord = plain["subject"]["cord"]
    assert cord["correlation"] > 0.95
    assert cord["rms_n"] < 5.0 and abs(cord["offset_n"]) < 8.0
    assert cord["arm_cuff"] is None, "two were fitted, and none is named"


def test_every_part_of_the_wearer_is_exchanged_for_that_of_the_study(plain: dict[str, Any]) -> None:
    """What the parts change together is the sum of the single changes and their interaction."""
    study = plain["against_study"]
    assert [answer["exchanged"] for answer in study["answers"]] == ["nothing", "cuffs", "body", "motion", "cord", "all"]
    efforts = (answer["effort"]["value"] for answer in study["answers"])
    assert len({round(effort, 6) for effort in efforts if effort is not None}) > 3
    for key in ("rest_length_m", "effort"):
        own, *single, everything = (answer[key]["value"] for answer in study["answers"])
        interaction = study[f"interaction_{key}"]["value"]
        if None in (own, *single, everything):
            assert interaction is None
        else:
            assert own + sum(one - own for one in single) + interaction == pytest.approx(everything, abs=1e-9)


def with_cord(folder: Path, tmp_path: Path, cuff: str | None, *, files: str = "*.mcap") -> Path:
    """The session with another cuff in the cord of subject.toml."""
    for path in folder.glob(files):
        shutil.copy(path, tmp_path)
    write_subject(tmp_path, Subject(mass_kg=75.0, cord=Cord(rest_length_m=CORD, cuff=cuff)))
    return tmp_path


def test_the_cord_is_compared_with_the_worn_cuff(folder: Path, person: AssessedSubject, tmp_path: Path) -> None:
    """All fitted cuffs count, as they do live: one that was worn need not be assessed, nor the reverse."""
    hand, waist = (read_cuffs_to_wear(folder / "cuffs.json")[name] for name in ("hand", "waist"))
    cuffs = {"hand": hand, "tube": replace(hand, name="tube"), "waist": waist}

    def worn(named: str | None, *fitted: str) -> str | None:
        return cuff_on_cord(with_cord(folder, tmp_path, named), [cuffs[name] for name in fitted])

    assert worn("tube", *cuffs) == "tube"
    assert worn(None, *cuffs) is None
    assert worn(None, "hand", "waist") == "hand"
    for named, *fitted in (("elbow", "hand", "waist"), ("waist", *cuffs)):
        with raises_refusal(SubjectCode.UNKNOWN_CUFF, kind=SubjectError):
            worn(named, *fitted)
    tube, belt = (with_interval_covariance(cuffs[name]) for name in ("tube", "waist"))
    tensions = [compare_cord(person, read_suit(), belt, arm) for arm in (tube, None)]
    assert [tension and tension.arm_cuff for tension in tensions] == ["tube", None]
    assert tensions[0] != tensions[1]


@pytest.mark.parametrize(("named", "code"), [("elbow", SubjectCode.UNUSABLE_CUFF), ("knee", SubjectCode.UNKNOWN_CUFF)])
def test_a_worn_cuff_that_cannot_be_used_is_refused_before_the_body_is_estimated(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: str, code: SubjectCode
) -> None:
    """The hand cuff is assessed; damping of the elbow cuff, which subject.toml names as worn, is not identified."""
    inputs = AssessmentInputs(
        folder / "cuffs.json", subject=with_cord(folder, tmp_path, named, files=TIGHT.file_name(1)), chosen=("hand",)
    )
    cuffs = read_cuffs_to_wear(inputs.cuffs)
    cuffs["elbow"] = replace(cuffs["elbow"], missing=("damping",))
    monkeypatch.setattr(case, "build_subject", lambda *_: pytest.fail("the body is estimated first"))
    with raises_refusal(code, named, kind=SubjectError):
        assess_cuffs(cuffs, inputs)


def test_a_cuff_that_no_measured_tension_needs_need_not_be_fitted(folder: Path, tmp_path: Path) -> None:
    subject = with_cord(folder, tmp_path, "knee", files=FREE.file_name(1))
    assert cuff_on_cord(subject, read_cuffs_to_wear(folder / "cuffs.json").values()) is None
    (tmp_path / SUBJECT_FILE).write_text('mass_kg = 75.0\n[cord]\ncuff = "knee"\n', encoding="utf-8")
    shutil.copy(folder / TIGHT.file_name(1), tmp_path)
    assert cuff_on_cord(subject, read_cuffs_to_wear(folder / "cuffs.json").values()) is None


def test_the_report_names_body_and_motion(plain: dict[str, Any], folder: Path) -> None:
    path = write_report(folder)
    page = path.read_text(encoding="utf-8")
    assert "scaled to the wearer" in page and FREE.file_name(1) in page
    assert "elbow_flexion" not in page  # a finding says that the forearm has no marker
    devices = "USB-6008 serial number 01C0FFEE", "QTM Version is 2024.3 (build 17700)"
    assert unmarked_numbers(path, folder.name, *devices) == []


@pytest.mark.parametrize(
    ("text", "code", "named"),
    [
        ("", SubjectCode.NO_MASS, "mass_kg"),
        ('vertical = "y"', SubjectCode.NO_MASS, "mass_kg"),
        ("mass_kg = -3", SubjectCode.INVALID_KEY, "mass_kg"),
        ("mass_kg = 70\nheight = 2", SubjectCode.INVALID_KEY, "height"),
        ('mass_kg = 70\nmarkers = { ij = "nose" }', SubjectCode.UNKNOWN_MARKERS, "nose"),
    ],
)
def test_a_wrong_subject_is_refused(folder: Path, tmp_path: Path, text: str, code: SubjectCode, named: str) -> None:
    for path in folder.glob("*.mcap"):
        shutil.copy(path, tmp_path)
    (tmp_path / "subject.toml").write_text(text, encoding="utf-8")
    with raises_refusal(code, named, kind=SubjectError):
        build_subject(tmp_path, GENERIC)


def test_a_mass_a_moving_pose_and_a_folder_without_motion_are_refused(folder: Path, tmp_path: Path) -> None:
    pose, *_ = assessed_subject.read_wearer_trials(folder)
    with raises_refusal(PersonCode.MASS_DOES_NOT_FIT, kind=PersonError):
        measure_subject(Subject(mass_kg=250.0), (pose,), GENERIC, silent)
    (motion,) = (trial for trial in assessed_subject.read_wearer_trials(folder) if trial.file == FREE.file_name(1))
    with raises_refusal(PersonCode.POSE_MOVES, kind=PersonError):
        assessed_subject.find_on_pose(replace(motion, manifest=replace(motion.manifest, test="pose")))
    shutil.copy(folder / "subject.toml", tmp_path)
    shutil.copy(folder / POSE.file_name(1), tmp_path)
    with raises_refusal(SubjectCode.NO_MOTION, kind=SubjectError):
        build_subject(tmp_path, GENERIC)


@pytest.mark.slow
def test_exchanged_labels_are_findings_of_a_body(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On every eighth frame: a raise of the arm takes seconds, and every step of the estimate solves all frames."""
    declared = Subject(mass_kg=75.0, markers=dict(zip(MIDDLE, reversed(MIDDLE), strict=True)))
    trials = assessed_subject.read_wearer_trials(folder)
    thinned = tuple(replace(trial, time=trial.time[::8], markers=trial.markers[::8]) for trial in trials)
    monkeypatch.setattr(assessed_subject, "read_wearer_trials", lambda _: thinned)
    monkeypatch.setattr(assessed_subject, "read_subject", lambda _: declared)
    monkeypatch.setattr(assessed_subject, "DRAWS", 0)
    body = build_subject(folder, GENERIC).body
    codes = {finding.code for finding in body.findings}
    assert {PersonCode.MARKER_FAR_OFF, PersonCode.NOT_CONVERGED} <= codes and not body.is_whole


@pytest.mark.parametrize(
    "subject", [Subject(), MARKED, CORDED, Subject(cord=Cord(rest_length_m=0.7)), Subject(cord=Cord(cuff="hand"))]
)
def test_a_wearer_is_read_as_written(subject: Subject, tmp_path: Path) -> None:
    write_subject(tmp_path, subject)
    assert read_subject(tmp_path) == subject
    write_subject(tmp_path, Subject(vertical="y"))  # what is not known is left out
    assert tomllib.loads((tmp_path / SUBJECT_FILE).read_text()) == {"hand_load_kg": 0.0, "vertical": "y"}


def test_markers_are_where_the_person_had_them_and_the_tension_of_the_cord_is_there(wearer: WearerSession) -> None:
    trial = read_wearer_trial(wearer.path(FREE))
    truth = wearer.person.markers(wearer.starts[trial.file] + trial.time)
    recorded = [trial.labels.index(label) for label in trial.body.body]
    columns = [wearer.person.labels.index(label) for label in trial.body.body]
    error = 1e3 * trial.markers[:, recorded] - truth[:, columns]
    assert np.sqrt(np.nanmean(error**2)) < 0.5, "mm, of the cameras"
    tight = read_wearer_trial(wearer.path(TIGHT))
    assert tight.body.is_cord_measured and 20 < np.ptp(tight.force) < 80


@pytest.mark.parametrize(
    ("named", "arms", "worn"),
    [
        ("tube", ["hand", "tube"], "tube"),
        (None, ["hand"], "hand"),
        (None, ["hand", "tube"], None),
        (None, [], None),
        ("", ["hand"], "hand"),
    ],
)
def test_the_worn_cuff_is_the_named_one_or_the_only_one(named: str | None, arms: list[str], worn: str | None) -> None:
    assert worn_arm_cuff(named, arms) == worn
