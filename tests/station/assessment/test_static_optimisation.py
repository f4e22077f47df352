"""A leg on a free pelvis from files: residual and reserve actuators, what is refused without them, and the verb."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.redundancy.redundancy_options import RedundancyOptions, static_optimisation
from solver.time_series_table import read_table
from station.assessment.given_motion import MotionCut, MuscleInputs
from station.assessment.rmr import SolvedMotion, solve_muscles
from tests.refusals import raises_refusal
from tests.solver.legs import LEG, PELVIS, Step, actuators, step_in, write_motion
from tests.station.command import Ran, assert_refused

CUT = MotionCut(6.0, 0.2, 0.6, 5, "splines")
OPTIONS = static_optimisation(RedundancyOptions(joint="thigh_joint"))


@pytest.fixture(scope="module")
def step(tmp_path_factory: pytest.TempPathFactory) -> Step:
    return step_in(tmp_path_factory.mktemp("step"))


def solve(step: Step, options: RedundancyOptions = OPTIONS, effort: Path | None = None) -> SolvedMotion:
    added = () if effort else (step.actuators,)
    return solve_muscles(MuscleInputs(step.motion, str(step.model), step.loads, effort, actuators=added), CUT, options)


def test_a_pelvis_that_nothing_balances_is_refused_by_the_names_of_its_coordinates(step: Step, tmp_path: Path) -> None:
    inputs = MuscleInputs(step.motion, str(step.model), step.loads)
    with raises_refusal(SolverCode.NOT_BALANCED, naming=f"{', '.join(PELVIS)}; add") as refusal:
        solve_muscles(inputs, CUT, OPTIONS)
    assert "toe_angle" not in str(refusal.value)  # locked
    few = tmp_path / "few.xml"
    few.write_text(actuators(dict.fromkeys(PELVIS[1:], 500.0)))
    with raises_refusal(SolverCode.NOT_BALANCED, naming="balance the coordinates pelvis_tilt; add"):
        solve_muscles(replace(inputs, actuators=(few,)), CUT, OPTIONS)


def test_free_pelvis_coordinates_need_no_actuators_and_the_leg_still_follows_its_motion(
    step: Step, tmp_path: Path
) -> None:
    reserves = tmp_path / "reserves.xml"
    reserves.write_text(actuators(dict.fromkeys(LEG, 5.0)))
    solved = solve(replace(step, actuators=reserves), replace(OPTIONS, free_coordinates=PELVIS))
    assert solved.solution.unsolved == 0
    assert solved.solution.equality_residual.max() < 1e-8


def test_reserves_by_name_are_those_of_an_actuator_file(step: Step, tmp_path: Path) -> None:
    effort = tmp_path / "effort.toml"
    forces = dict.fromkeys(PELVIS, 500.0) | dict.fromkeys(LEG, 5.0)
    lines = [f"{name} = {{ optimal_force = {force} }}" for name, force in forces.items()]
    effort.write_text("\n".join(["[reserves]", *lines]))
    by_name, by_file = solve(step, effort=effort), solve(step)
    np.testing.assert_allclose(by_name.solution.activations, by_file.solution.activations, atol=1e-7)
    assert by_name.options.reserve_weight == 1.0  # that of static optimisation, because the file has none


def test_a_patella_without_data_follows_the_knee(step: Step, tmp_path: Path) -> None:
    motion = tmp_path / "step.sto"
    write_motion(motion, (*PELVIS, *LEG))
    found, expected = solve(replace(step, motion=motion)), solve(step)
    assert found.notes["without_data"] == "toe_angle, patella_angle"
    np.testing.assert_allclose(found.solution.activations, expected.solution.activations, atol=1e-6)


def test_with_activation_dynamics_the_leg_costs_no_less(step: Step) -> None:
    free = solve(step, replace(OPTIONS, has_activation_dynamics=False)).solution
    bound = solve(step, replace(OPTIONS, has_activation_dynamics=True)).solution
    assert bound.unsolved == 0
    assert (bound.effort >= free.effort - 1e-9).all()
    assert np.abs(bound.activations - free.activations).max() > 1e-3


def test_other_documents_are_no_actuator_files(step: Step) -> None:
    with raises_refusal(SolverCode.WRONG_DOCUMENT, naming="ForceSet"):
        solve(replace(step, actuators=step.loads))


def test_a_file_without_actuators_is_refused(step: Step, tmp_path: Path) -> None:
    empty = tmp_path / "empty.xml"
    empty.write_text(actuators({}), encoding="utf-8")
    with raises_refusal(SolverCode.WRONG_DOCUMENT, naming="ForceSet reserves has no forces"):
        solve(replace(step, actuators=empty))


def test_actuators_that_share_a_name_are_refused_by_it(step: Step, tmp_path: Path) -> None:
    inputs = MuscleInputs(step.motion, str(step.model), step.loads)
    with raises_refusal(SolverCode.UNSUPPORTED, naming="pelvis_tilt") as refusal:
        solve_muscles(replace(inputs, actuators=(step.actuators, step.actuators)), CUT, OPTIONS)
    assert "calf" not in str(refusal.value)
    as_muscle = tmp_path / "as_muscle.xml"
    name = re.search(r'CoordinateActuator name="(.*?)"', step.actuators.read_text())
    assert name is not None
    as_muscle.write_text(step.actuators.read_text().replace(f'name="{name[1]}"', 'name="calf"', 1))
    with raises_refusal(SolverCode.UNSUPPORTED, naming="of the name calf;"):
        solve_muscles(replace(inputs, actuators=(as_muscle,)), CUT, OPTIONS)


def test_the_verbs_write_moments_and_activations(station: Callable[..., Ran], step: Step, tmp_path: Path) -> None:
    common = [
        "--model",
        step.model,
        "--motion",
        step.motion,
        "--external-loads",
        step.loads,
        "--from",
        0.2,
        "--to",
        0.4,
    ]
    joint = ["--joint", "thigh_joint"]
    output, moments = tmp_path / "so.sto", tmp_path / "id.csv"
    ran = station("rmr", *common, *joint, "--static-optimisation", "--actuators", step.actuators, "--output", output)
    assert ran.code == 0, ran.err
    assert "6 Hz, order 3" in ran.err
    assert "Coordinates without data: toe_angle" in ran.err
    assert read_table(output)[1].shape[0] == 21
    assert "muscle_forces=opensim_static" in output.read_text()
    assert station("id", *common, "--output", moments).code == 0
    assert "hip_flexion_moment" in read_table(moments)[0]
    assert station("rmr", "--actuators", step.actuators, "--output", output).code == 2
    assert station("id", *common, "--output", tmp_path / "id.parquet").code == 2
    unbalanced = station("rmr", *common, *joint, "--no-glenoid", "--output", output)
    assert_refused(unbalanced, 1, SolverCode.NOT_BALANCED)


def test_a_paralysed_muscle_rests_and_every_frame_is_solved(step: Step, tmp_path: Path) -> None:
    model = tmp_path / "paralysed.osim"
    force = "<max_isometric_force>"
    model.write_text(step.model.read_text().replace(force, "<max_control>0</max_control>" + force, 1))
    solved, able = solve(replace(step, model=model)).solution, solve(step).solution
    assert solved.unsolved == 0
    assert solved.activations[:, 0].max() < 1e-5
    assert able.activations[:, 0].max() > 0.01


def test_generalised_forces_that_are_not_finite_are_refused(
    station: Callable[..., Ran], step: Step, tmp_path: Path
) -> None:
    text, output = step.model.read_text(encoding="utf-8"), tmp_path / "id.csv"
    assert "<gravity>0 -9.81 0</gravity>" in text
    step.model.write_text(text.replace("0 -9.81 0", "0 -1e308 0"), encoding="utf-8")
    ran = station("id", "--model", step.model, "--motion", step.motion, "--output", output)
    assert_refused(ran, 1, SolverCode.NOT_FINITE)
    assert not output.exists()
