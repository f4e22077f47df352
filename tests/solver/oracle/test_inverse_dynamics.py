"""Inverse dynamics, static optimisation and external loads against OpenSim's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.bundled import bundled_model, simulate_arm_raise
from solver.model import Model, with_point_mass
from solver.motion import Kinematics, decimate, differentiate
from solver.multibody.dynamics import equations_of_motion, inverse_dynamics
from solver.multibody.loads import load_wrenches
from solver.multibody.postures import postures
from solver.muscle import evaluate_paths, muscle_forces
from solver.osim.loads_document import read_external_loads
from solver.osim.model_reader import read_osim
from solver.redundancy.effort import RedundancyOptions, static_optimisation
from solver.redundancy.mechanics import response_maps
from solver.redundancy.motion_solution import MotionSolution, solve_motion
from solver.time_series_table import read_table, write_table
from station.assessment.given_motion import MotionCut, MuscleInputs, solve_inverse_dynamics
from station.assessment.rmr import SolvedMotion, solve_muscles
from tests.solver.legs import LEG, PELVIS, Step, actuators, step_in, write_motion
from tests.solver.oracle.two_bodies import along_path, model_with, opensim, random_states, read_back
from tests.solver.references import relative_difference

Array = NDArray[np.float64]
START, END, EVERY = 0.1, 0.4, 5  # OpenSim counts the steps from the first row of the motion
OPTIONS = static_optimisation(RedundancyOptions(joint="thigh_joint"))
certify: Any = pytest.importorskip("tests.solver.certify")
COLUMNS = [f"{part}_{axis}" for part in ("pull", "grip", "twist") for axis in "xyz"]
KINDS = {
    "a force at the body's origin": ("pull", "", "", "lower", "ground", ""),
    "a force at a point of the ground": ("pull", "grip", "", "lower", "ground", "ground"),
    "a force in the body's axes at a point of it": ("pull", "grip", "", "lower", "lower", "lower"),
    "a torque": ("", "", "twist", "upper", "ground", ""),
    "all in other bodies' axes": ("pull", "grip", "twist", "upper", "lower", "lower"),
}


@pytest.mark.parametrize(
    ("joint", "mass"),
    [("UniversalJoint", 1.3), ("FreeJoint", 0.0)],  # a free body without mass has no inverse of the mass matrix
)
def test_needed_forces_are_opensim_s_inverse_dynamics(joint: str, mass: float, tmp_path: Path) -> None:
    osim = model_with(getattr(opensim, joint))
    upper = osim.getBodySet().get("upper")
    upper.setMass(mass)
    upper.setInertia(opensim.Inertia(mass * 0.02, mass * 0.015, mass * 0.018))
    along_path(osim, opensim.PathSpring("spring", 0.5, 800.0, 0.3))
    ours = read_back(osim, tmp_path)
    q, u = random_states(ours)
    accelerations = 3.0 * np.random.default_rng(8).normal(size=q.shape)
    motion = Kinematics(np.arange(len(q)) / 100.0, 0.01, q, u, accelerations, None)
    state = osim.initSystem()
    for muscle in osim.getMuscles():
        muscle.set_appliesForce(False)
        muscle.setAppliesForce(state, False)
    coordinates = [osim.getCoordinateSet().get(name) for name in ours.coordinate_names]
    solver, theirs = opensim.InverseDynamicsSolver(osim), []
    for values, speeds, rates in zip(q, u, accelerations, strict=True):
        for coordinate, value, speed in zip(coordinates, values, speeds, strict=True):
            coordinate.setValue(state, float(value), False)
            coordinate.setSpeedValue(state, float(speed))
        theirs.append(solver.solve(state, opensim.Vector(rates.tolist())).to_numpy())
    assert relative_difference(inverse_dynamics(ours, motion), np.array(theirs)) < 1e-10


@pytest.mark.parametrize("cutoff", [None, 6.0])
def test_generalised_forces_are_those_of_opensim(cutoff: float | None, tmp_path: Path) -> None:
    step = step_in(tmp_path)
    ours = solved(step, cutoff)
    theirs = opensims(step, cutoff)
    assert set(ours) == set(theirs)
    for column, values in theirs.items():
        np.testing.assert_allclose(ours[column], values, atol=1e-6, err_msg=column)
    assert np.abs(ours["knee_angle_moment"]).max() > 20.0
    assert np.abs(ours["patella_angle_moment"]).max() > 1e-4  # its constraint does not act


def test_a_coordinate_without_data_keeps_its_default_as_in_opensim(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    write_motion(step.motion, tuple(name for name in (*PELVIS, *LEG, "patella_angle") if name != "hip_rotation"))
    ours, theirs = solved(step, None), opensims(step, None)
    for column, values in theirs.items():
        np.testing.assert_allclose(ours[column], values, atol=1e-6, err_msg=column)


def test_a_coupled_coordinate_without_data_follows_its_leader(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    complete = solved(step, None)
    write_motion(step.motion, (*PELVIS, *LEG))
    found = solve_inverse_dynamics(MuscleInputs(step.motion, str(step.model), step.loads), splines(None))
    assert found.notes["without_data"] == "toe_angle, patella_angle"
    for column, values in zip(found.columns, found.values.T, strict=True):
        np.testing.assert_allclose(values[5:-5], complete[column][5:-5], atol=1e-4, err_msg=column)


def splines(cutoff: float | None) -> MotionCut:
    return MotionCut(cutoff, 0.1, 0.7, derivatives="splines")


def solved(step: Step, cutoff: float | None) -> dict[str, Any]:
    found = solve_inverse_dynamics(MuscleInputs(step.motion, str(step.model), step.loads), splines(cutoff))
    return dict(zip(found.columns, found.values.T, strict=True))


def opensims(step: Step, cutoff: float | None) -> dict[str, Any]:
    tool = opensim.InverseDynamicsTool()
    tool.setModelFileName(str(step.model))
    tool.setCoordinatesFileName(str(step.motion))
    tool.setExternalLoadsFileName(str(step.loads))
    tool.setStartTime(0.1)
    tool.setEndTime(0.7)
    tool.setLowpassCutoffFrequency(cutoff or -1.0)
    without = opensim.ArrayStr()
    without.append("Muscles")
    tool.setExcludedForces(without)
    tool.setResultsDir(str(step.model.parent))
    tool.setOutputGenForceFileName("opensim_id.sto")
    assert tool.run()
    columns, table, _ = read_table(step.model.parent / "opensim_id.sto")
    return dict(zip(columns[1:], table.T[1:], strict=True))


@dataclass(frozen=True)
class Controls:
    """(frames, muscles) activations and (frames, actuators) controls."""

    activations: Array
    controls: Array


@pytest.mark.parametrize("kind", ["Millard2012EquilibriumMuscle", "Thelen2003Muscle", "DeGrooteFregly2016Muscle"])
def test_activations_are_those_of_opensim(kind: str, tmp_path: Path) -> None:
    step = step_in(tmp_path, kind)
    solved = solve(step)
    assert_equal(solved, optimised_by_opensim(step, solved))
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
    assert_equal(solved, optimised_by_opensim(step, solved))


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
    assert_equal(solved, optimised_by_opensim(step, solved))


def assert_equal(solved: SolvedMotion, theirs: Controls) -> None:
    solution: MotionSolution = solved.solution
    assert solution.unsolved == 0
    np.testing.assert_allclose(solution.activations, theirs.activations, atol=1e-4)
    controls = solution.reserves / [actuator.optimal_force for actuator in solved.model.actuators]
    np.testing.assert_allclose(controls, theirs.controls, atol=1e-4)


def solve(step: Step) -> SolvedMotion:
    inputs = MuscleInputs(step.motion, str(step.model), step.loads, actuators=(step.actuators,))
    return solve_muscles(inputs, MotionCut(None, START, END, EVERY, "splines"), OPTIONS)


def optimised_by_opensim(step: Step, solved: SolvedMotion) -> Controls:
    model = opensim.Model(str(step.model))
    added = opensim.ForceSet(str(step.actuators), True)
    for index in range(added.getSize()):
        model.updForceSet().cloneAndAppend(added.get(index))
    model.initSystem()
    analysis = opensim.StaticOptimization()
    analysis.setConvergenceCriterion(1e-9)
    analysis.setMaxIterations(3000)
    analysis.setStepInterval(EVERY)
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


# of what: force, point and torque columns, body, axes, origin


@pytest.mark.parametrize(
    ("kind", "rows"), [*zip(KINDS, (2, 3, 4, 50, 2), strict=True), *zip(KINDS, (50, 4, 2, 3, 50), strict=True)]
)
def test_a_load_accelerates_two_bodies_as_in_opensim(kind: str, rows: int, tmp_path: Path) -> None:
    osim = model_with(opensim.FreeJoint)
    ours = read_back(osim, tmp_path)
    file = written(tmp_path, rows, [KINDS[kind]])
    q, u = random_states(ours)
    time = np.random.default_rng(3).uniform(0.0, 1.0, len(q))
    state = postures(ours, q, u)
    equations, paths = equations_of_motion(ours, state, reaction_joint="second"), evaluate_paths(ours, state)
    loads = load_wrenches(sampled(file, ours, time), state)
    forces = muscle_forces(ours, paths.lengths, paths.speeds)
    still = np.zeros_like(forces.passive)
    maps = response_maps(ours, state, equations, paths, type(forces)(**vars(forces) | {"passive": still}), loads)
    accelerations, reactions = loads_of_opensim(osim, ours, file, q, u, time, "second")
    assert relative_difference(maps.acceleration_at_rest, accelerations) < 1e-10
    assert relative_difference(maps.reaction_at_rest, reactions) < 1e-10


def test_loads_on_the_bundled_model_reach_its_glenoid_as_in_opensim(tmp_path: Path) -> None:
    ours = bundled_model()
    osim = certify.build(ours)
    file = written(
        tmp_path, 40, [("pull", "grip", "twist", "hand", "ground", "hand"), ("pull", "", "", "thorax", "scapula", "")]
    )
    q, u = certify.chosen_states(ours)
    time = np.linspace(0.0, 1.0, len(q))
    state = postures(ours, q, u)
    equations, paths = equations_of_motion(ours, state), evaluate_paths(ours, state)
    forces = muscle_forces(ours, paths.lengths, paths.speeds)
    still = type(forces)(**vars(forces) | {"passive": np.zeros_like(forces.passive)})
    maps = response_maps(ours, state, equations, paths, still, load_wrenches(sampled(file, ours, time), state))
    accelerations, reactions = loads_of_opensim(osim, ours, file, q, u, time, "GlenoHumeral")
    assert relative_difference(maps.acceleration_at_rest, accelerations) < 1e-10
    assert relative_difference(maps.reaction_at_rest, reactions) < 1e-10


def test_a_weight_put_into_the_hand_of_an_osim_file_is_carried_as_a_point_mass(tmp_path: Path) -> None:
    ours = bundled_model()
    osim = certify.build(ours)
    hand, place = osim.getBodySet().get("hand"), ours.bodies[ours.body_index("hand")].mass_center
    hand.setMass(hand.getMass() + 2.0)
    osim.finalizeConnections()
    osim.printToXML(str(tmp_path / "loaded.osim"))
    motion = decimate(differentiate(simulate_arm_raise(ours)), 60)
    found = solve_motion(read_osim(tmp_path / "loaded.osim"), motion)
    expected = solve_motion(with_point_mass(ours, "hand", 2.0, place), motion)
    np.testing.assert_allclose(found.activations, expected.activations, atol=1e-6)
    assert expected.effort.sum() > 1.5 * solve_motion(ours, motion).effort.sum()


def written(folder: Path, rows: int, loads: list[tuple[str, ...]]) -> Path:
    """An XML of external loads as OpenSim prints it, with its data in the same folder over the times 0 to 1 s."""
    values = np.random.default_rng(rows).normal(size=(rows, len(COLUMNS))) * ([20.0] * 3 + [0.2] * 3 + [3.0] * 3)
    time = np.linspace(0.0, 1.0, rows) ** 1.3  # not evenly
    write_table(folder / "loads.sto", COLUMNS, time, values)
    external = opensim.ExternalLoads()
    external.setDataFileName("loads.sto")
    for index, (force, point, torque, body, axes, origin) in enumerate(loads):
        load = opensim.ExternalForce()
        load.setName(f"load_{index}")
        load.set_applied_to_body(body)
        load.set_force_expressed_in_body(axes)
        load.set_point_expressed_in_body(origin)
        load.set_force_identifier(force)
        load.set_point_identifier(point)
        load.set_torque_identifier(torque)
        external.cloneAndAppend(load)
    file = folder / "loads.xml"
    external.printToXML(str(file))
    return file


def sampled(file: Path, model: Model, time: Array) -> Any:
    """At times in any order: the reader wants those of a motion, which increase."""
    order = np.argsort(time)
    loads = read_external_loads(file, model, time[order])
    back = np.argsort(order)
    return [
        type(load)(**vars(load) | {name: getattr(load, name)[back] for name in ("force", "torque", "point")})
        for load in loads
    ]


def loads_of_opensim(
    osim: Any, model: Model, file: Path, q: Array, u: Array, time: Array, joint: str
) -> tuple[Array, Array]:
    """Accelerations and the joint's reaction on its parent, in the order of the states, with idle muscles."""
    osim.addModelComponent(opensim.ExternalLoads(str(file), True))
    state = osim.initSystem()
    for muscle in osim.getMuscles():
        muscle.overrideActuation(state, True)
        muscle.setOverrideActuation(state, 0.0)
    coordinates = [osim.getCoordinateSet().get(name) for name in model.coordinate_names]
    accelerations, reactions = [], []
    for moment, values, speeds in zip(time, q, u, strict=True):
        state.setTime(float(moment))
        for coordinate, value, speed in zip(coordinates, values, speeds, strict=True):
            coordinate.setValue(state, float(value), False)
            coordinate.setSpeedValue(state, float(speed))
        osim.realizeAcceleration(state)
        wrench = osim.getJointSet().get(joint).calcReactionOnParentExpressedInGround(state)
        accelerations.append([coordinate.getAccelerationValue(state) for coordinate in coordinates])
        reactions.append([wrench.get(part).get(axis) for part in range(2) for axis in range(3)])
    return np.array(accelerations), np.array(reactions)
