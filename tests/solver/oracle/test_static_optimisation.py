"""Static optimisation of a leg on the ground beside OpenSim's StaticOptimization, from the same files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.redundancy.motion_solution import MotionSolution
from solver.redundancy.options import RedundancyOptions, static_optimisation
from solver.time_series_table import read_table
from station.assessment.given_motion import MotionCut, MuscleInputs
from station.assessment.rmr import SolvedMotion, solve_muscles
from tests.solver.legs import LEG, PELVIS, Step, actuators, step_in

opensim: Any = pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
opensim.Logger.setLevelString("error")
pytestmark = pytest.mark.oracle

Array = NDArray[np.float64]
START, END, EVERY = 0.1, 0.7, 6
OPTIONS = static_optimisation(RedundancyOptions(joint="thigh_joint"))


@dataclass(frozen=True)
class Controls:
    """(frames, muscles) activations and (frames, actuators) controls."""

    activations: Array
    controls: Array


@pytest.mark.parametrize("kind", ["Millard2012EquilibriumMuscle", "Thelen2003Muscle", "DeGrooteFregly2016Muscle"])
def test_activations_are_those_of_opensim(kind: str, tmp_path: Path) -> None:
    step = step_in(tmp_path, kind)
    solved = solve(step)
    assert_equal(solved, opensims(step, solved))
    found = solved.solution.activations
    least = 0.0 if kind == "DeGrooteFregly2016Muscle" else 0.01  # the default of min_control
    assert found.min() == pytest.approx(least, abs=1e-9)
    assert found.max() > 0.3


def test_limits_of_muscles_and_actuators_are_those_of_opensim(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    limits = "<min_control>0.05</min_control><max_control>0.2</max_control><max_isometric_force>"
    step.model.write_text(step.model.read_text().replace("<max_isometric_force>", limits))
    step.actuators.write_text(actuators(dict.fromkeys(PELVIS, 2000.0) | dict.fromkeys(LEG, 130.0), limit=1.0))
    solved = solve(step)
    found = solved.solution.activations
    assert (found.min(), found.max()) == (pytest.approx(0.05), pytest.approx(0.2))
    assert_equal(solved, opensims(step, solved))


def test_a_file_of_opensim_2_with_forces_at_a_point_and_torques_is_read_as_by_opensim(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    axes = {"X": "1 0 0", "Y": "0 1 0", "Z": "0 0 1"}
    limits = "<min_control> -infinity </min_control><max_control> infinity </max_control>"
    at_point = "".join(
        f'<PointActuator name="F{name}"><isDisabled> false </isDisabled>{limits}<body> pelvis </body><point> -0.07 0 0 '
        f"</point><point_is_global> false </point_is_global><direction> {axis} </direction><force_is_global> true "
        "</force_is_global><optimal_force> 400 </optimal_force></PointActuator>"
        for name, axis in axes.items()
    )
    torques = "".join(
        f'<TorqueActuator name="M{name}"><isDisabled> false </isDisabled>{limits}<bodyA> pelvis </bodyA><bodyB> ground '
        f"</bodyB><torque_is_global> true </torque_is_global><axis> {axis} </axis><optimal_force> 300 </optimal_force>"
        "</TorqueActuator>"
        for name, axis in axes.items()
    )
    reserves = "".join(
        f'<CoordinateActuator name="{name}_reserve"><coordinate> {name} </coordinate></CoordinateActuator>'
        for name in LEG
    )
    default = '<CoordinateActuator name="default"><optimal_force> 6 </optimal_force></CoordinateActuator>'
    step.actuators.write_text(
        f'<OpenSimDocument Version="20302"><ForceSet name="old"><defaults>{default}</defaults><objects>{at_point}'
        f"{torques}{reserves}</objects></ForceSet></OpenSimDocument>"
    )
    solved = solve(step)
    assert [one.optimal_force for one in solved.model.actuators] == [400.0] * 3 + [300.0] * 3 + [6.0] * 5
    assert_equal(solved, opensims(step, solved))


def assert_equal(solved: SolvedMotion, theirs: Controls) -> None:
    solution: MotionSolution = solved.solution
    assert solution.unsolved == 0
    np.testing.assert_allclose(solution.activations, theirs.activations, atol=1e-4)
    controls = solution.reserves / [actuator.optimal_force for actuator in solved.model.actuators]
    np.testing.assert_allclose(controls, theirs.controls, atol=1e-4)


def solve(step: Step) -> SolvedMotion:
    inputs = MuscleInputs(step.motion, str(step.model), step.loads, actuators=(step.actuators,))
    return solve_muscles(inputs, MotionCut(None, START, END, EVERY, "splines"), OPTIONS)


def opensims(step: Step, solved: SolvedMotion) -> Controls:
    model = opensim.Model(str(step.model))
    added = opensim.ForceSet(str(step.actuators), True)
    for index in range(added.getSize()):
        model.updForceSet().cloneAndAppend(added.get(index))
    model.initSystem()
    analysis = opensim.StaticOptimization()
    analysis.setConvergenceCriterion(1e-9)
    analysis.setMaxIterations(3000)
    model.updAnalysisSet().cloneAndAppend(analysis)
    tool = opensim.AnalyzeTool()
    tool.setModel(model)
    tool.setName("leg")
    tool.setCoordinatesFileName(str(step.motion))
    tool.setExternalLoadsFileName(str(step.loads))
    tool.setLoadModelAndInput(True)
    tool.setInitialTime(START)
    tool.setFinalTime(END)
    tool.setResultsDir(str(step.model.parent))
    assert tool.run()
    columns, table, _ = read_table(step.model.parent / "leg_StaticOptimization_activation.sto")
    rows = [int(np.abs(table[:, 0] - time).argmin()) for time in solved.solution.time]
    assert np.abs(table[rows, 0] - solved.solution.time).max() < 1e-9

    def picked(names: Any) -> Array:
        return table[np.ix_(rows, [columns.index(name) for name in names])]

    return Controls(picked(solved.solution.muscles), picked([one.name for one in solved.model.actuators]))
