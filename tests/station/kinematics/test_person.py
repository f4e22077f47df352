"""station scale without a set-up: from all trials of a person to a model, a set-up and a record."""

import json
import math
import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from recordings.exchange.joint_force import read_joint_force
from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.trc import read_trc, write_trc
from solver.errors import CoverageCode
from solver.inverse_kinematics.solve import solve_inverse_kinematics
from solver.motion import Motion, differentiate
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from solver.osim.tool_setups import read_ik_setup
from solver.redundancy.mechanics import force_agreement
from solver.redundancy.motion_solution import solve_motion
from station.kinematics.ik import IkInputs, solve_postures
from station.kinematics.marker_checks import PersonError
from station.kinematics.person import PersonInputs, measure_person, write_person
from station.messages.kinematics_messages import KinematicsCode, PersonCode
from station.validation.lifts import CUTOFF_HZ, PUBLISHED_VARIANTS
from tests.refusals import raises_refusal
from tests.solver.personalisation.simulated_person import MARKERS, MODEL, draw_person
from tests.solver.references import SHARED
from tests.station.command import Station
from tests.station.kinematics.test_ik import run as run_verb

SUBJECT = SHARED / "subject"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A generic model with the markers of the simulated person, and two of his trials."""
    folder = tmp_path_factory.mktemp("person")
    Xml.ElementTree(osim_document(replace(MODEL, markers=(*MODEL.markers, *MARKERS)))).write(folder / "generic.osim")
    for name, observed in zip(("raise", "reach"), draw_person(11, scatter=0.3).trials, strict=True):
        frames = len(observed)
        labels = tuple(marker.name for marker in MARKERS)
        time = np.arange(frames) / 20
        table = MarkerTable(labels, 20.0, time, 1e3 * observed, np.zeros(observed.shape[:2]))
        (folder / f"{name}.trc").write_text(write_trc(table, f"{name}.trc"), encoding="utf-8")
    return folder


def words(folder: Path, *more: object) -> tuple[object, ...]:
    trials = ("--markers", folder / "raise.trc", "--markers", folder / "reach.trc")
    return ("--model", folder / "generic.osim", *trials, "--output", folder / "person.osim", *more)


def test_a_person_is_written_with_the_set_up_and_the_record(folder: Path, station: Station) -> None:
    code, printed = run_verb(station, *words(folder, "--body-mass", 70, "--held-mass", 2), verb="scale")
    assert code == 0, printed
    person, setup = read_osim(folder / "person.osim"), read_ik_setup(folder / "person-ik.xml")
    masses = {body.name: body.mass for body in person.bodies}
    assert masses["humerus"] == pytest.approx(70 * 0.0263)
    assert masses["held_load"] == 2.0
    record = json.loads((folder / "person-body.json").read_text(encoding="utf-8"))
    assert [trial["name"] for trial in record["trials"]] == ["raise", "reach"]
    sizes = {size["name"]: size for size in record["sizes"]}
    assert 0 < sizes["upper arm"]["standard_error"] < sizes["upper arm"]["prior_standard_deviation"]
    observed = draw_person(11, scatter=0.3).trials[0]
    tasks = setup.tasks(person, [marker.name for marker in MARKERS], np.zeros(len(observed)))
    columns = [[marker.name for marker in MARKERS].index(marker.name) for marker in tasks.markers]
    solution = solve_inverse_kinematics(person, observed[:, columns], tasks)
    rms = 1e3 * float(np.sqrt(np.mean(solution.residuals**2)))
    assert rms == pytest.approx(record["trials"][0]["marker_rms_mm"], rel=1e-3)


def test_a_body_that_cannot_be_recorded_leaves_the_files_of_the_previous_one(folder: Path, tmp_path: Path) -> None:
    inputs = PersonInputs(str(folder / "generic.osim"), (folder / "raise.trc",), 70.0, 0.0)
    person = measure_person(inputs)
    write_person(tmp_path / "person.osim", person, inputs)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert len(before) == 3
    with pytest.raises(ValidationError):
        write_person(tmp_path / "person.osim", replace(person, model=MODEL, held_mass=math.inf), inputs)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_an_empty_column_is_not_a_marker_of_the_scapula(folder: Path) -> None:
    table = read_trc(folder / "raise.trc")
    positions = table.positions.copy()
    hidden = [label for label in table.labels if label.startswith("scapula")][2:]
    positions[:, [table.labels.index(label) for label in hidden]] = np.nan
    path = folder / "hidden.trc"
    path.write_text(write_trc(replace(table, positions=positions), path.name), encoding="utf-8")
    person = measure_person(PersonInputs(str(folder / "generic.osim"), (path,), 70.0, 0.0))
    figures = {finding.code: finding.figures for finding in person.findings}
    assert figures[KinematicsCode.NEVER_SEEN] == {"markers": ", ".join(sorted(hidden))}
    assert CoverageCode.FEW_SCAPULA_MARKERS in figures


@pytest.mark.parametrize("other", ["raise.trc", "tuesday/raise.trc", "tuesday/raise.c3d"])
def test_two_trials_of_one_name_are_wrong_usage(other: str, folder: Path) -> None:
    """Before, the second replaced the first without a message, and the record named both."""
    inputs = PersonInputs(str(folder / "generic.osim"), (folder / "raise.trc", folder / other), 70.0, 0.0)
    with pytest.raises(PersonError) as refused:
        measure_person(inputs)
    assert (refused.value.code, refused.value.exit_code) == (PersonCode.SAME_NAME, 2)


def test_a_marker_set_without_a_scapula_is_reported_in_body_and_postures(folder: Path, station: Station) -> None:
    """As the sports sets of camera makers are."""
    table = read_trc(folder / "raise.trc")
    kept = [k for k, label in enumerate(table.labels) if not label.startswith("scapula")]
    labels = tuple(table.labels[k] for k in kept)
    sports = replace(table, labels=labels, positions=table.positions[:, kept], residuals=table.residuals[:, kept])
    (folder / "sports.trc").write_text(write_trc(sports, "sports.trc"), encoding="utf-8")
    files = ("--model", folder / "generic.osim", "--markers", folder / "sports.trc")
    asked = (*files, "--body-mass", 70, "--output", folder / "sports.osim")
    code, printed = run_verb(station, *asked, verb="scale")
    assert code == 0, printed
    record = json.loads((folder / "sports-body.json").read_text(encoding="utf-8"))
    codes = {finding["code"] for finding in record["findings"]}
    assert CoverageCode.NO_SCAPULA_MARKERS in codes
    solved = solve_postures(IkInputs(str(folder / "sports.osim"), folder / "sports.trc", folder / "sports-ik.xml"))
    assert CoverageCode.NO_SCAPULA_MARKERS in {finding.code for finding in solved.findings}


@pytest.mark.parametrize(
    ("more", "said", "exit_code"),
    [(("--body-mass", 20), "give the person's mass, not the model's", 1), ((), "--body-mass are", 2)],
)
def test_a_mass_that_is_none_leaves_nothing(
    more: tuple[object, ...], said: str, exit_code: int, folder: Path, tmp_path: Path, station: Station
) -> None:
    asked = [tmp_path / "person.osim" if word == folder / "person.osim" else word for word in words(folder, *more)]
    code, printed = run_verb(station, *asked, verb="scale")
    assert code == exit_code
    assert said in " ".join(printed.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.shared
@pytest.mark.parametrize(
    ("body_mass", "held", "reason"),
    [(30.0, 2.4, PersonCode.MASS_DOES_NOT_FIT), (84.6, None, PersonCode.HAND_HOLDS_LOAD)],
)
def test_the_mass_or_held_load_of_a_model_is_refused(body_mass: float, held: float | None, reason: PersonCode) -> None:
    trials = (SUBJECT / "S8R_back.trc",)
    with raises_refusal(reason, kind=PersonError):
        measure_person(PersonInputs(str(SUBJECT / "generic.osim"), trials, body_mass, held))


@pytest.mark.shared
@pytest.mark.parametrize(("held", "is_large"), [pytest.param(2.4, False, marks=pytest.mark.slow), (24.0, True)])
def test_a_load_that_no_arm_holds_is_a_finding_on_the_joint_force(held: float, is_large: bool) -> None:
    """In this joint, 202 % of body weight were measured."""
    person = measure_person(PersonInputs(str(SUBJECT / "generic.osim"), (SUBJECT / "S8R_side.trc",), 84.6, held))
    found = [finding for finding in person.findings if finding.code is PersonCode.LARGE_JOINT_FORCE]
    assert len(found) == is_large
    assert all(float(finding.figures["percent"]) > 500 for finding in found)


@pytest.mark.shared
@pytest.mark.slow
def test_one_body_for_two_lifts_of_a_patient_agrees_with_the_force_in_his_joint(tmp_path: Path) -> None:
    """Published weights, circular cone, first lift, nothing locked (Hasan et al. 2025): marker residual [mm], and
    RMSE of the joint force [% of body weight].
    """
    weight, first_lifts = 830.0, {"side": 4.0, "back": 3.4}  # N, s
    files = tuple(SUBJECT / f"S8R_{lift}.trc" for lift in first_lifts)
    person = measure_person(PersonInputs(_renamed_generic(tmp_path), files, weight / 9.81, held_mass=2.4))
    model, options = PUBLISHED_VARIANTS[1].applied(person.model)
    for trial, (lift, end), most in zip(person.trials, first_lifts.items(), (40.0, 70.0), strict=True):
        motion = Motion(model.coordinate_names, trial.time, trial.postures.coordinates)
        solution = solve_motion(model, differentiate(motion, CUTOFF_HZ, 0.0, end), options)
        record = read_joint_force(SUBJECT / f"S8R_{lift}_measured_force_glenoid.txt")
        measured = np.interp(solution.time, record.time_s, record.resultant)
        error = force_agreement(np.linalg.norm(solution.reaction[:, 3:], axis=1), measured)
        assert trial.rms < 0.010
        assert 100 * error.rmse / weight < most
        assert error.correlation > 0.90


def _renamed_generic(folder: Path) -> str:
    """generic.osim of the patient, whose two wrist markers have each other's names, with the names of the trials."""
    model = read_osim(SUBJECT / "generic.osim")
    exchanged = {"US2": "RS2", "RS2": "US2"}
    markers = (replace(marker, name=exchanged.get(marker.name, marker.name)) for marker in model.markers)
    document = osim_document(replace(model, markers=tuple(markers)))
    Xml.ElementTree(document).write(folder / "generic.osim", encoding="utf-8")
    return str(folder / "generic.osim")
