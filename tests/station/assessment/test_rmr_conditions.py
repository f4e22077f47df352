"""`station rmr` with a model that it refuses, or a frame without a solution: the message names what to do."""

import json
import re
import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cuffstation as cs
from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.forces.passive_forces import PathSpring
from solver.model import Model
from solver.motion import decimate, differentiate
from solver.multibody.postures import postures
from solver.muscle import evaluate_paths
from solver.osim.model_writer import osim_document
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.problem import FrameOutcome
from station.assessment.assessment_json import describe_unsolved
from station.assessment.given_motion import MotionCut, MuscleInputs
from station.assessment.rmr import SolvedMotion, left_out_findings, slack_muscles, solve_muscles
from station.messages.assessment_messages import AssessmentCode, InputCode
from tests.links import symlink
from tests.solver.legs import Step, step_in
from tests.station.command import Station, assert_one_sentence, assert_refused

MODEL = bundled_model()
CUT = MotionCut(every=60)
RAISE = decimate(differentiate(simulate_arm_raise(MODEL)), 60)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "own.osim"
    path.write_bytes(Xml.tostring(osim_document(bundled_model())))
    return path


@pytest.mark.parametrize("verb", ["rmr", "id"])
@pytest.mark.parametrize("read", ["motion", "data", "link"])
def test_a_result_does_not_replace_its_input(station: Station, tmp_path: Path, verb: str, read: str) -> None:
    step = step_in(tmp_path)
    symlink(tmp_path / "link.sto", step.motion)
    output = {"motion": step.motion, "data": step.loads.with_suffix(".sto"), "link": tmp_path / "link.sto"}[read]
    before = output.read_bytes()
    files = ("--model", step.model, "--motion", step.motion, "--external-loads", step.loads)
    ran = station(verb, *files, "--output", output)
    said = "".join(ran.err.replace("│", "").split())  # a long path is broken anywhere
    assert ran.code == 2 and output.name in said
    assert output.read_bytes() == before


def test_a_scaled_or_suited_model_does_not_replace_the_generic_one(station: Station, model: Path) -> None:
    before = model.read_bytes()
    ran = station("export", "--osim", "--model", model, "--output", model)
    scaled = station("scale", "--setup", model.with_name("setup.xml"), "--model", model, "--output", model)
    assert (ran.code, scaled.code, model.read_bytes()) == (2, 2, before)


def _changed(path: Path, *changes: tuple[str, str]) -> Path:
    text = path.read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text, before
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")
    return path


CONTROLLER = ("<BodySet", "<ControllerSet><objects><PrescribedController name='c'/></objects></ControllerSet><BodySet")
CONTACT = ("</CoordinateActuator>", "</CoordinateActuator><ElasticFoundationForce name='h'/>")
ROLLING = ("<PointConstraint ", "<RollingOnSurfaceConstraint name='w'/><PointConstraint ")
OBSTACLES = ("PrescribedController c", "ElasticFoundationForce h", "RollingOnSurfaceConstraint w")


@pytest.mark.parametrize(
    ("changes", "words", "named"),
    [
        ([("GlenoHumeral", "shoulder")], (), ("GlenoHumeral", "--joint", "shoulder", SolverCode.UNKNOWN_NAME)),
        ([("Glenoid_Center", "somewhere")], (), ("Glenoid_Center", "--no-glenoid")),
        ([CONTROLLER, CONTACT, ROLLING], (), OBSTACLES),
        ([CONTACT], ("--leave-out", "h"), ("ElasticFoundationForce h", "remove it", "ignore_forces")),
    ],
    ids=["no joint", "no glenoid", "every obstacle at once", "a force"],
)
def test_the_refusal_of_a_model_names_its_obstacles_and_what_to_do(
    station: Station, model: Path, tmp_path: Path, changes: list, words: tuple[str, ...], named: tuple[str, ...]
) -> None:
    _changed(model, *changes)
    ran = station("rmr", "--model", model, *words, "--output", tmp_path / "a.csv")
    assert_one_sentence(ran, 1, *named)
    assert "BushingForce" not in ran.err, "no list of all classes"


def test_forces_and_controllers_left_out_on_request_are_named(station: Station, model: Path, tmp_path: Path) -> None:
    short = ("rmr", "--to", "0.02", "--output")
    assert station(*short, tmp_path / "whole.csv", "--model", model).code == 0
    _changed(model, CONTROLLER, CONTACT)
    ran = station(*short, tmp_path / "a.csv", "--model", model, "--ignore-forces")
    assert ran.code == 0
    assert "PrescribedController c, ElasticFoundationForce h" in ran.err
    whole, left_out = ((tmp_path / name).read_text(encoding="utf-8").splitlines() for name in ("whole.csv", "a.csv"))
    assert left_out[-1] == whole[-1]
    assert [line for line in left_out if "left_out" in line and "ElasticFoundationForce h" in line]


@pytest.mark.parametrize("version", ["30501", "10905", "50000", "", "x", "-1", "9" * 400])
def test_a_file_of_no_released_version_is_refused(station: Station, tmp_path: Path, version: str) -> None:
    """One of a development version as OpenSim does it."""
    path = tmp_path / "old.osim"
    path.write_text(f'<OpenSimDocument Version="{version}"><Model name="m"/></OpenSimDocument>', encoding="utf-8")
    ran = station("rmr", "--model", path, "--output", tmp_path / "a.csv")
    command = ("expected one of OpenSim 2, 3 or 4", 'opensim.Model("old.osim").printToXML("new.osim")')
    assert_one_sentence(ran, 1, *(("version 30501", "save it with a release") if version == "30501" else command))


@pytest.mark.parametrize("has_glenoid", [True, False])
def test_the_message_of_an_infeasible_frame_names_the_glenoid_if_it_is_constrained(has_glenoid: bool) -> None:
    solved = solve_muscles(MuscleInputs(), MotionCut(start=0.0, end=0.05), RedundancyOptions(has_glenoid))
    outcomes = (FrameOutcome.INFEASIBLE, *solved.solution.outcomes[1:])
    (sentence, *_) = describe_unsolved(replace(solved.solution, outcomes=outcomes))
    assert ("glenoid" in sentence) == has_glenoid
    assert "misses accelerations" in sentence
    assert "inf" not in sentence
    assert np.isinf(solved.solution.cone_slack).all() == (not has_glenoid)


def test_another_model_without_motion_and_an_output_without_name_are_refused(station: Station, tmp_path: Path) -> None:
    ran = station("rmr", "--model", step_in(tmp_path).model, "--output", tmp_path / "a.csv")
    assert_refused(ran, 1, SolverCode.UNKNOWN_NAME, "--motion")
    assert_refused(station("rmr", "--output", "."), 2, InputCode.TABLE_FORMAT, "the output is ., expected")


# `station rmr` without some forces of its model: the results and a sentence have what that changes.


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled model with a spring, and with contact that the solver does not have."""
    path = MODEL.muscles[MODEL.muscle_names.index("DeltoideusScapula_M")].path
    spring = PathSpring("band", path, 0.05, 300.0, 0.0)
    text = Xml.tostring(osim_document(replace(MODEL, forces=(spring,))), encoding="unicode")
    written = tmp_path_factory.mktemp("model") / "own.osim"
    lost = "<ElasticFoundationForce name='sole'/></objects></ForceSet>"
    written.write_text(text.replace("</objects></ForceSet>", lost), encoding="utf-8")
    return written


def solved(file: Path, *left_out: str) -> SolvedMotion:
    return solve_muscles(MuscleInputs(None, str(file), None, None, True, left_out), CUT, RedundancyOptions())


def test_the_load_of_a_force_left_out_and_the_share_of_reserves_are_reported(file: Path) -> None:
    found, bare = solved(file, "band"), solve_muscles(MuscleInputs(), CUT, RedundancyOptions())
    np.testing.assert_allclose(found.solution.activations, bare.solution.activations, atol=1e-9)
    assert np.abs(solved(file).solution.activations - bare.solution.activations).max() > 0.01
    load = json.loads(found.notes["left_out_effect"])["loads"]["band"]
    assert next(iter(load)) in ("shoulder_elv", "scapula_upward_rot", "plane_elv")
    (sentence,) = map(str, left_out_findings(found.model, found.left_out))
    assert f"band would give {next(iter(load.values())):.3g} N m at {next(iter(load))}" in sentence
    found = solved(file)
    assert found.model.lacking == ("sole",)
    given, needed = json.loads(found.notes["left_out_effect"])["reserve_and_needed"]["ground_thorax_ty"]
    vertical = MODEL.coordinate_index("ground_thorax_ty")
    assert needed == pytest.approx(9.80665 * sum(body.mass for body in MODEL.bodies), rel=0.02)
    assert given == pytest.approx(np.sqrt((found.solution.reserves[:, 4] ** 2).mean()), rel=1e-12)
    assert MODEL.actuators[4].coordinate == vertical
    (sentence,) = map(str, left_out_findings(found.model, found.left_out))
    assert f"carry the loads of sole; reserves give {given:.3g} of {needed:.3g} N at ground_thorax_ty" in sentence


def test_the_options_reach_the_table(file: Path, station, tmp_path: Path) -> None:
    command = ("rmr", "--model", file, "--ignore-forces", "--to", "0.02", "--output", table := tmp_path / "a.csv")
    assert_one_sentence(station(*command, "--leave-out", "rope"), 1, "rope to leave out; it has band")
    ran = station(*command, "--leave-out", "band")
    assert ran.code == 0, ran.err
    assert "Left out of the model: ElasticFoundationForce sole, band. band would give" in ran.err
    assert "left_out_effect" in table.read_text(encoding="utf-8")


# Muscles whose tendon is longer than their path throughout a motion are named, in the results and as a finding.


@pytest.fixture
def step(tmp_path: Path) -> Step:
    """Its first muscle has a tendon of 5 m."""
    step = step_in(tmp_path)
    text = step.model.read_text(encoding="utf-8")
    step.model.write_text(re.sub("<tendon_slack_length>[^<]*", "<tendon_slack_length>5", text, count=1), "utf-8")
    return step


def with_tendon(muscle: int, length: float) -> Model:
    changed = replace(MODEL.muscles[muscle], tendon_slack_length=length)
    return replace(MODEL, muscles=(*MODEL.muscles[:muscle], changed, *MODEL.muscles[muscle + 1 :]))


def test_a_muscle_is_slack_if_its_tendon_is_longer_than_its_path_in_every_frame() -> None:
    assert slack_muscles(MODEL, RAISE, "opensim") == ()
    assert slack_muscles(with_tendon(3, 5.0), RAISE, "opensim") == (MODEL.muscle_names[3],)
    assert slack_muscles(replace(MODEL, muscles=()), RAISE, "opensim") == ()
    lengths = evaluate_paths(MODEL, postures(MODEL, RAISE.positions, RAISE.speeds, RAISE.time)).lengths
    muscle = int(np.argmax(lengths.max(axis=0) - lengths[0]))
    model = with_tendon(muscle, 0.5 * (lengths[0, muscle] + lengths[:, muscle].max()))
    assert slack_muscles(model, RAISE.cut(slice(1)), "opensim") == (MODEL.muscle_names[muscle],)
    assert slack_muscles(model, RAISE, "opensim") == ()


def test_verb_and_library_name_a_muscle_that_cannot_pull(station: Station, step: Step, tmp_path: Path) -> None:
    model = cs.load_model(step.model, actuators=[step.actuators])
    name, *_ = model.muscle_names
    files = ("--model", step.model, "--motion", step.motion, "--external-loads", step.loads)
    cut = ("--actuators", step.actuators, "--static-optimisation", "--from", 0.2, "--to", 0.22)
    ran = station("rmr", *files, *cut, "--output", tmp_path / "a.sto")
    assert f": {name}. " in ran.err and AssessmentCode.MUSCLES_SLACK in ran.err
    assert f"slack_muscles={name}\n" in (tmp_path / "a.sto").read_text(encoding="utf-8")
    motion = cs.load_motion(model, step.motion, cutoff_hz=6.0).cut(slice(20, 22))
    solution = cs.solve_motion(model, motion)
    assert {AssessmentCode.MUSCLES_SLACK} <= {finding.code for finding in solution.findings}
