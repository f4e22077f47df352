"""Where reserves give the force that a motion needs: residuals on bodies, and reserves in place of muscles."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.model import CoordinateActuator
from solver.osim.model_reader import read_osim
from solver.redundancy.effort import RedundancyOptions, static_optimisation
from station.assessment.given_motion import MotionCut, MuscleInputs
from station.assessment.reserves import coordinate_unit, reserve_findings
from station.assessment.rmr import SolvedMotion, left_out_findings, reserve_unit, solve_muscles
from station.messages.assessment_messages import AssessmentCode
from tests.solver.legs import LEG, PELVIS, Step, actuators, step_in
from tests.station.command import Ran

CUT = MotionCut(6.0, 0.2, 0.6, 5, "splines")
OPTIONS = static_optimisation(RedundancyOptions(joint="thigh_joint"))
AXES = {"X": "1 0 0", "Y": "0 1 0", "Z": "0 0 1"}


@pytest.fixture(scope="module")
def step(tmp_path_factory: pytest.TempPathFactory) -> Step:
    return step_in(tmp_path_factory.mktemp("step"))


def solve(step: Step, options: RedundancyOptions = OPTIONS) -> SolvedMotion:
    inputs = MuscleInputs(step.motion, str(step.model), step.loads, None, True, actuators=(step.actuators,))
    return solve_muscles(inputs, CUT, options)


def with_residuals_on_the_pelvis(step: Step, folder: Path) -> Step:
    """Forces at a point and torques in place of the pelvis's CoordinateActuators, and a contact that is lacking."""
    forces = "".join(
        f'<PointActuator name="F{name}"><body>pelvis</body><point>-0.05 0.15 0</point><direction>{axis}</direction>'
        "<force_is_global>true</force_is_global><optimal_force>500</optimal_force></PointActuator>"
        f'<TorqueActuator name="M{name}"><bodyA>pelvis</bodyA><bodyB>ground</bodyB><axis>{axis}</axis>'
        "<optimal_force>500</optimal_force></TorqueActuator>"
        for name, axis in AXES.items()
    )
    found = replace(step, model=folder / "own.osim", actuators=folder / "residuals.xml")
    text = actuators(dict.fromkeys(LEG, 5.0)).replace("</objects>", f"{forces}</objects>")
    found.actuators.write_text(text, encoding="utf-8")
    model = step.model.read_text(encoding="utf-8")
    lacking = "<ElasticFoundationForce name='sole'/></objects></ForceSet>"
    found.model.write_text(model.replace("</objects></ForceSet>", lacking), encoding="utf-8")
    return found


def test_residuals_on_bodies_give_what_the_pelvis_needs(step: Step, tmp_path: Path) -> None:
    """No muscle crosses the joint of the pelvis, so that actuators give all that inverse dynamics finds there."""
    solved = solve(with_residuals_on_the_pelvis(step, tmp_path))
    shares = json.loads(solved.notes["left_out_effect"])["reserve_and_needed"]
    assert {"pelvis_tx", "pelvis_ty", "pelvis_tilt", "pelvis_list"} < set(shares)
    for name in set(PELVIS) & set(shares):
        given, needed = shares[name]
        assert given == pytest.approx(needed, rel=1e-6)
    (found,) = left_out_findings(solved.model, solved.left_out)
    assert f"reserves give {shares['pelvis_ty'][0]:.3g} of {shares['pelvis_ty'][1]:.3g} N at pelvis_ty" in str(found)


def test_reserves_in_place_of_muscles_are_reported_and_residuals_are_not(step: Step, station, tmp_path: Path) -> None:
    strong = replace(step, actuators=tmp_path / "strong.xml")
    strong.actuators.write_text(actuators(dict.fromkeys((*PELVIS, *LEG), 500.0)), encoding="utf-8")
    solved = solve(strong)
    assert "knee_angle" in solved.large_reserves and set(solved.large_reserves) <= set(LEG)
    knee = solved.model.actuated_names.index("knee_angle")
    rms = np.sqrt((solved.solution.reserves[:, knee] ** 2).mean())
    assert solved.large_reserves["knee_angle"][0] == pytest.approx(rms, rel=1e-12)
    assert json.loads(solved.notes["large_reserves"])["knee_angle"][0] == pytest.approx(rms, rel=1e-12)
    files = ("--model", strong.model, "--motion", strong.motion, "--external-loads", strong.loads)
    cut = ("--actuators", strong.actuators, "--static-optimisation", "--from", 0.2, "--to", 0.6, "--every", 5)
    ran: Ran = station("rmr", *files, *cut, "--output", tmp_path / "a.csv")
    assert ran.code == 0
    (printed,) = [line for line in ran.err.splitlines() if "reserves.large" in line]
    assert "N m at knee_angle" in printed and "pelvis" not in printed


def test_residuals_that_carry_the_body_are_reported_with_its_weight(step: Step, tmp_path: Path) -> None:
    inputs = MuscleInputs(step.motion, str(step.model), None, None, True, actuators=(step.actuators,))
    solved = solve_muscles(inputs, CUT, OPTIONS)
    given, weight = solved.large_residuals["pelvis_ty"]
    assert weight == pytest.approx(58.6 * 9.81)
    assert given == pytest.approx(weight, rel=0.1)  # no foot carries it
    assert json.loads(solved.notes["large_residuals"])["pelvis_ty"] == [given, weight]
    codes = [found.code for found in reserve_findings(solved.model, {}, solved.large_residuals)]
    assert codes == [AssessmentCode.RESIDUALS_LARGE]
    supported = solve(step).large_residuals
    assert supported.get("pelvis_ty", (0.0, weight))[0] < 0.6 * given


@pytest.mark.parametrize(("has_loads", "residuals"), [(False, {"pelvis_tx", "pelvis_ty"}), (True, set())])
def test_unweighted_actuators_that_carry_the_body_are_reported_only_without_external_loads(
    step: Step, has_loads: bool, residuals: set[str]
) -> None:
    """As of a leg without a trunk, whose weights hide that the ground reaction was forgotten."""
    files = (step.motion, str(step.model), step.loads if has_loads else None, None, True)
    options = replace(OPTIONS, weights=dict.fromkeys(PELVIS, 0.0))
    solved = solve_muscles(MuscleInputs(*files, actuators=(step.actuators,)), CUT, options)
    assert set(solved.large_residuals) == residuals


@pytest.mark.parametrize(("is_static", "largest"), [(True, 200.0), (False, 10.0)])
def test_the_actuators_that_carry_thorax_and_forearm_are_not_reported(is_static: bool, largest: float) -> None:
    options = static_optimisation(RedundancyOptions()) if is_static else RedundancyOptions()
    solved = solve_muscles(MuscleInputs(), MotionCut(every=60), options)
    assert np.abs(solved.solution.reserves).max() > largest
    assert (solved.large_residuals if is_static else solved.large_reserves) == {}


def test_small_reserves_free_coordinates_and_actuators_without_weight_are_not_reported(step: Step) -> None:
    """The calf has an activation of 1 in this step, so that the ankle needs its reserve; the knee does not."""
    found = solve(step)
    assert set(found.large_reserves) == {"ankle_angle", "hip_rotation"}
    knee = found.model.actuated_names.index("knee_angle")
    assert np.abs(found.solution.reserves[:, knee]).max() > 0.0
    carried = solve(step, replace(OPTIONS, free_coordinates=("hip_rotation",), weights={"ankle_angle": 0.0}))
    assert (carried.large_reserves, carried.notes["large_reserves"]) == ({}, "none")


def test_the_unit_is_that_of_the_axes_that_a_coordinate_drives(step: Step) -> None:
    """Also where OpenSim calls the motion coupled, as of the distances of gait2392, which have a scaled function."""
    model = read_osim(step.model)
    model = replace(model, coordinates=tuple(replace(one, motion="coupled") for one in model.coordinates))
    units = {name: coordinate_unit(model, index) for index, name in enumerate(model.coordinate_names)}
    assert {name for name, unit in units.items() if unit == "N"} == set(PELVIS[3:])
    assert set(units.values()) == {"N", "N m"}
    reserves = (CoordinateActuator("knee", model.coordinate_index(LEG[3]), 5.0),)
    reserves += (CoordinateActuator("FY", model.coordinate_index(PELVIS[4]), 5.0),)
    assert [reserve_unit(model, reserve) for reserve in reserves] == ["N m", "N"]


def test_the_notes_and_columns_of_a_leg_have_nothing_of_a_shoulder(step: Step, station, tmp_path: Path) -> None:
    files = ("--model", step.model, "--motion", step.motion, "--external-loads", step.loads)
    cut = ("--actuators", step.actuators, "--from", 0.2, "--to", 0.6, "--every", 10)
    out = tmp_path / "leg.sto"
    ran: Ran = station("rmr", *files, *cut, "--output", out)
    assert "leaves out the columns" not in ran.err
    text = out.read_text(encoding="utf-8")
    assert "cone_slack" not in text and "thorax" not in text and "elbow" not in text
    moved = json.loads(text.split("reserve_coordinates=")[1].splitlines()[0])
    assert set(moved.values()) == {*PELVIS, *LEG}
    assert all(f"\treserve_n_m.{name}\t" in text or f"\treserve_n.{name}\t" in text for name in moved)
