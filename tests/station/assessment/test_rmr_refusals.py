"""`station rmr` with a model that it refuses, or a frame without a solution: the message names what to do."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.osim.model_writer import osim_document
from solver.redundancy.problem import FrameOutcome
from solver.redundancy.redundancy_options import RedundancyOptions
from station.assessment.given_motion import MotionCut, MuscleInputs
from station.assessment.outcomes import describe_unsolved
from station.assessment.rmr import solve_muscles
from station.messages.codes import InputCode
from tests.links import symlink
from tests.solver.legs import step_in
from tests.station.command import Ran, assert_one_sentence, assert_refused

Station = Callable[..., Ran]


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "own.osim"
    path.write_bytes(Xml.tostring(osim_document(bundled_model())))
    return path


@pytest.mark.parametrize("verb", ["rmr", "id"])
@pytest.mark.parametrize("read", ["motion", "data", "link"])
def test_a_result_does_not_replace_what_it_was_computed_from(
    station: Station, tmp_path: Path, verb: str, read: str
) -> None:
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


def test_without_the_joint_the_option_is_named_and_the_joints_there_are(
    station: Station, model: Path, tmp_path: Path
) -> None:
    _changed(model, ("GlenoHumeral", "shoulder"))
    ran = station("rmr", "--model", model, "--output", tmp_path / "a.csv")
    assert ran.code == 1
    assert "GlenoHumeral" in ran.err.splitlines()[-1] and "--joint" in ran.err.splitlines()[-1]
    assert SolverCode.UNKNOWN_NAME in ran.err
    assert "shoulder" in ran.err.splitlines()[-1]


def test_without_the_glenoid_s_markers_the_option_is_named(station: Station, model: Path, tmp_path: Path) -> None:
    _changed(model, ("Glenoid_Center", "somewhere"))
    ran = station("rmr", "--model", model, "--output", tmp_path / "a.csv")
    assert ran.code == 1
    assert "Glenoid_Center" in ran.err and "--no-glenoid" in ran.err


def test_every_obstacle_is_named_at_once(station: Station, model: Path, tmp_path: Path) -> None:
    _changed(
        model,
        ("<BodySet", "<ControllerSet><objects><PrescribedController name='c'/></objects></ControllerSet><BodySet"),
        ("</CoordinateActuator>", "</CoordinateActuator><ElasticFoundationForce name='h'/>"),
        ("<PointConstraint ", "<RollingOnSurfaceConstraint name='w'/><PointConstraint "),
    )
    ran = station("rmr", "--model", model, "--output", tmp_path / "a.csv")
    assert ran.code == 1
    last = ran.err.splitlines()[-1]
    for name in ("PrescribedController c", "ElasticFoundationForce h", "RollingOnSurfaceConstraint w"):
        assert name in last


def test_the_refusal_of_a_force_says_what_to_do_and_does_not_list_every_class(
    station: Station, model: Path, tmp_path: Path
) -> None:
    _changed(model, ("</CoordinateActuator>", "</CoordinateActuator><ElasticFoundationForce name='h'/>"))
    ran = station("rmr", "--model", model, "--leave-out", "h", "--output", tmp_path / "a.csv")
    assert_one_sentence(ran, 1, "ElasticFoundationForce h", "remove it", "ignore_forces")
    assert "BushingForce" not in ran.err


def test_forces_and_controllers_are_left_out_on_request_and_named(
    station: Station, model: Path, tmp_path: Path
) -> None:
    short = ("rmr", "--to", "0.02", "--output")
    assert station(*short, tmp_path / "whole.csv", "--model", model).code == 0
    _changed(
        model,
        ("<BodySet", "<ControllerSet><objects><PrescribedController name='c'/></objects></ControllerSet><BodySet"),
        ("</CoordinateActuator>", "</CoordinateActuator><ElasticFoundationForce name='h'/>"),
    )
    ran = station(*short, tmp_path / "a.csv", "--model", model, "--ignore-forces")
    assert ran.code == 0
    assert "PrescribedController c, ElasticFoundationForce h" in ran.err
    whole, left_out = ((tmp_path / name).read_text(encoding="utf-8").splitlines() for name in ("whole.csv", "a.csv"))
    assert left_out[-1] == whole[-1]
    assert [line for line in left_out if "left_out" in line and "ElasticFoundationForce h" in line]


@pytest.mark.parametrize("version", ["10905", "50000", "", "x", "-1", "9" * 400])
def test_a_file_of_no_released_version_is_refused_with_the_command_that_converts_it(
    station: Station, tmp_path: Path, version: str
) -> None:
    path = tmp_path / "old.osim"
    path.write_text(f'<OpenSimDocument Version="{version}"><Model name="m"/></OpenSimDocument>', encoding="utf-8")
    ran = station("rmr", "--model", path, "--output", tmp_path / "a.csv")
    assert_one_sentence(ran, 1, "expected one of OpenSim 2, 3 or 4", 'opensim.Model("old.osim").printToXML("new.osim")')


def test_a_file_of_a_development_version_is_refused_as_by_opensim(station: Station, tmp_path: Path) -> None:
    path = tmp_path / "old.osim"
    path.write_text('<OpenSimDocument Version="30501"><Model name="m"/></OpenSimDocument>', encoding="utf-8")
    ran = station("rmr", "--model", path, "--output", tmp_path / "a.csv")
    assert_one_sentence(ran, 1, "version 30501", "save it with a release")


@pytest.mark.parametrize("has_glenoid", [True, False])
def test_the_message_of_an_infeasible_frame_names_the_glenoid_if_it_is_constrained(has_glenoid: bool) -> None:
    solved = solve_muscles(MuscleInputs(), MotionCut(start=0.0, end=0.05), RedundancyOptions(has_glenoid))
    outcomes = (FrameOutcome.INFEASIBLE, *solved.solution.outcomes[1:])
    (sentence, *_) = describe_unsolved(replace(solved.solution, outcomes=outcomes))
    assert ("glenoid" in sentence) == has_glenoid
    assert "misses accelerations" in sentence
    assert "inf" not in sentence
    assert np.isinf(solved.solution.cone_slack).all() == (not has_glenoid)


def test_a_model_that_the_bundled_raise_does_not_fit_needs_a_motion(station: Station, tmp_path: Path) -> None:
    ran = station("rmr", "--model", step_in(tmp_path).model, "--output", tmp_path / "a.csv")
    assert_refused(ran, 1, SolverCode.UNKNOWN_NAME)
    assert "--motion" in ran.err


def test_an_output_that_is_a_folder_without_a_name_is_named(station: Station) -> None:
    ran = station("rmr", "--output", ".")
    assert_refused(ran, 2, InputCode.TABLE_FORMAT)
    assert "the output is ., expected" in ran.err
