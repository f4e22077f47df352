"""Inverse dynamics, static optimisation and external loads against OpenSim's."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.model import Array, Model, with_point_mass
from solver.motion import Kinematics, decimate, differentiate
from solver.multibody.dynamics import inverse_dynamics
from solver.osim.loads_document import read_external_loads
from solver.osim.model_reader import read_osim
from solver.redundancy.effort import RedundancyOptions, static_optimisation
from solver.redundancy.motion_solution import solve_motion
from solver.time_series_table import read_table, write_table
from station.assessment.given_motion import MotionCut, MuscleInputs, solve_inverse_dynamics
from station.assessment.rmr import SolvedMotion, solve_muscles
from tests.solver.legs import LEG, PELVIS, Step, actuators, step_in, write_motion
from tests.solver.oracle.two_bodies import (
    along_path,
    idle_maps,
    idle_states,
    made,
    model_with,
    opensim,
    printed,
    random_states,
    read_back,
    response,
)
from tests.solver.references import relative_difference

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
    solver = opensim.InverseDynamicsSolver(osim)
    theirs = [
        solver.solve(state, opensim.Vector(rates.tolist())).to_numpy()
        for state, rates in zip(idle_states(osim, ours.coordinate_names, q, u), accelerations, strict=True)
    ]
    assert relative_difference(inverse_dynamics(ours, motion), np.array(theirs)) < 1e-10


@pytest.mark.parametrize("cutoff", [None, 6.0])
def test_generalised_forces_are_those_of_opensim(cutoff: float | None, tmp_path: Path) -> None:
    ours = assert_generalised_forces(step_in(tmp_path), cutoff)
    assert np.abs(ours["knee_angle_moment"]).max() > 20.0
    assert np.abs(ours["patella_angle_moment"]).max() > 1e-4  # its constraint does not act


def assert_generalised_forces(step: Step, cutoff: float | None) -> dict[str, Any]:
    """Ours, which are those of OpenSim."""
    ours, theirs = solved(step, cutoff), opensims(step, cutoff)
    assert set(ours) == set(theirs)
    for column, values in theirs.items():
        np.testing.assert_allclose(ours[column], values, atol=1e-6, err_msg=column)
    return ours


def test_a_coordinate_without_data_keeps_its_default_as_in_opensim(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    write_motion(step.motion, tuple(name for name in (*PELVIS, *LEG, "patella_angle") if name != "hip_rotation"))
    assert_generalised_forces(step, None)


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
    without = opensim.ArrayStr()
    without.append("Muscles")
    tool = made(
        "InverseDynamicsTool",
        "leg",
        setModelFileName=str(step.model),
        setCoordinatesFileName=str(step.motion),
        setExternalLoadsFileName=str(step.loads),
        setStartTime=0.1,
        setEndTime=0.7,
        setLowpassCutoffFrequency=cutoff or -1.0,
        setExcludedForces=without,
        setResultsDir=str(step.model.parent),
        setOutputGenForceFileName="opensim_id.sto",
    )
    assert tool.run()
    columns, table, _ = read_table(step.model.parent / "opensim_id.sto")
    return dict(zip(columns[1:], table.T[1:], strict=True))


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
    limits = "<min_control> -infinity </min_control><max_control> infinity </max_control>"
    shared = f"<isDisabled> false </isDisabled>{limits}<optimal_force> {{force}} </optimal_force>"
    place = "<body> pelvis </body><point> -0.07 0 0 </point><point_is_global> false </point_is_global>"
    bodies = "<bodyA> pelvis </bodyA><bodyB> ground </bodyB><torque_is_global> true </torque_is_global>"
    objects = [
        f'<{kind} name="{name}{index}">{shared.format(force=force)}{where}<{tag}> {axis} </{tag}></{kind}>'
        for kind, name, force, where, tag in (
            ("PointActuator", "F", 400, f"{place}<force_is_global> true </force_is_global>", "direction"),
            ("TorqueActuator", "M", 300, bodies, "axis"),
        )
        for index, axis in enumerate(("1 0 0", "0 1 0", "0 0 1"))
    ]
    objects += [
        f'<CoordinateActuator name="{name}_reserve"><coordinate> {name} </coordinate></CoordinateActuator>'
        for name in LEG
    ]
    default = '<CoordinateActuator name="default"><optimal_force> 6 </optimal_force></CoordinateActuator>'
    step.actuators.write_text(
        f'<OpenSimDocument Version="20302"><ForceSet name="old"><defaults>{default}</defaults><objects>'
        f"{''.join(objects)}</objects></ForceSet></OpenSimDocument>"
    )
    solved = solve(step)
    assert [one.optimal_force for one in solved.model.actuators] == [400.0] * 3 + [300.0] * 3 + [6.0] * 5
    assert_equal(solved, optimised_by_opensim(step, solved))


def assert_equal(solved: SolvedMotion, theirs: tuple[Array, Array]) -> None:
    """(frames, muscles) activations and (frames, actuators) controls are those of OpenSim."""
    solution = solved.solution
    assert solution.unsolved == 0
    np.testing.assert_allclose(solution.activations, theirs[0], atol=1e-4)
    controls = solution.reserves / [actuator.optimal_force for actuator in solved.model.actuators]
    np.testing.assert_allclose(controls, theirs[1], atol=1e-4)


def solve(step: Step) -> SolvedMotion:
    inputs = MuscleInputs(step.motion, str(step.model), step.loads, actuators=(step.actuators,))
    return solve_muscles(inputs, MotionCut(None, START, END, EVERY, "splines"), OPTIONS)


def optimised_by_opensim(step: Step, solved: SolvedMotion) -> tuple[Array, Array]:
    model = opensim.Model(str(step.model))
    for actuator in opensim.ForceSet(str(step.actuators), True):
        model.updForceSet().cloneAndAppend(actuator)
    model.initSystem()
    criteria = {"setConvergenceCriterion": 1e-9, "setMaxIterations": 3000, "setStepInterval": EVERY}
    analysis = made("StaticOptimization", "StaticOptimization", **criteria)
    model.updAnalysisSet().cloneAndAppend(analysis)
    tool = made(
        "AnalyzeTool",
        "leg",
        setModel=model,
        setCoordinatesFileName=str(step.motion),
        setExternalLoadsFileName=str(step.loads),
        setLoadModelAndInput=True,
        setInitialTime=START,
        setFinalTime=END,
        setResultsDir=str(step.model.parent),
    )
    assert tool.run()
    columns, table, _ = read_table(step.model.parent / "leg_StaticOptimization_activation.sto")
    rows = [int(np.abs(table[:, 0] - time).argmin()) for time in solved.solution.time]
    assert np.abs(table[rows, 0] - solved.solution.time).max() < 1e-9
    names = solved.solution.muscles, [one.name for one in solved.model.actuators]
    activations, controls = (table[np.ix_(rows, [columns.index(name) for name in kind])] for kind in names)
    return activations, controls


# of what: force, point and torque columns, body, axes, origin


@pytest.mark.parametrize(
    ("kind", "rows"), [*zip(KINDS, (2, 3, 4, 50, 2), strict=True), *zip(KINDS, (50, 4, 2, 3, 50), strict=True)]
)
def test_a_load_accelerates_two_bodies_as_in_opensim(kind: str, rows: int, tmp_path: Path) -> None:
    osim = model_with(opensim.FreeJoint)
    ours = read_back(osim, tmp_path)
    q, u = random_states(ours)
    time = np.random.default_rng(3).uniform(0.0, 1.0, len(q))
    assert_loaded(ours, osim, loads_file(tmp_path, rows, [KINDS[kind]]), (q, u, time), "second")


def test_loads_on_the_bundled_model_reach_its_glenoid_as_in_opensim(tmp_path: Path) -> None:
    ours = bundled_model()
    loads = [("pull", "grip", "twist", "hand", "ground", "hand"), ("pull", "", "", "thorax", "scapula", "")]
    q, u = certify.chosen_states(ours)
    states = q, u, np.linspace(0.0, 1.0, len(q))
    assert_loaded(ours, certify.build(ours), loads_file(tmp_path, 40, loads), states, "GlenoHumeral")


def assert_loaded(ours: Model, osim: Any, file: Path, states: tuple[Array, Array, Array], joint: str) -> None:
    """At coordinates, speeds and times in any order, of which the reader wants those of a motion, which increase."""
    q, u, time = states
    order = np.argsort(time)
    back, names = np.argsort(order), ("force", "torque", "point")
    loads = [
        replace(load, **{name: getattr(load, name)[back] for name in names})
        for load in read_external_loads(file, ours, time[order])
    ]
    maps = idle_maps(ours, q, u, joint, loads)
    osim.addModelComponent(opensim.ExternalLoads(str(file), True))
    found = [
        response(osim, state, ours.coordinate_names, joint)
        for state in idle_states(osim, ours.coordinate_names, q, u, time)
    ]
    accelerations, reactions = (np.array(column) for column in zip(*found, strict=True))
    assert relative_difference(maps.acceleration_at_rest, accelerations) < 1e-10
    assert relative_difference(maps.reaction_at_rest, reactions) < 1e-10


def test_a_weight_put_into_the_hand_of_an_osim_file_is_carried_as_a_point_mass(tmp_path: Path) -> None:
    ours = bundled_model()
    osim = certify.build(ours)
    hand, place = osim.getBodySet().get("hand"), ours.bodies[ours.body_index("hand")].mass_center
    hand.setMass(hand.getMass() + 2.0)
    motion = decimate(differentiate(simulate_arm_raise(ours)), 60)
    found = solve_motion(read_osim(printed(osim, tmp_path / "loaded.osim")), motion)
    expected = solve_motion(with_point_mass(ours, "hand", 2.0, place), motion)
    np.testing.assert_allclose(found.activations, expected.activations, atol=1e-6)
    assert expected.effort.sum() > 1.5 * solve_motion(ours, motion).effort.sum()


def loads_file(folder: Path, rows: int, loads: list[tuple[str, ...]]) -> Path:
    """An XML of external loads as OpenSim prints it, with its data in the same folder over the times 0 to 1 s."""
    values = np.random.default_rng(rows).normal(size=(rows, len(COLUMNS))) * ([20.0] * 3 + [0.2] * 3 + [3.0] * 3)
    write_table(folder / "loads.sto", COLUMNS, np.linspace(0.0, 1.0, rows) ** 1.3, values)  # not evenly
    external, file = made("ExternalLoads", "loads", setDataFileName="loads.sto"), folder / "loads.xml"
    properties = [f"{part}_identifier" for part in ("force", "point", "torque")]
    properties += ["applied_to_body", "force_expressed_in_body", "point_expressed_in_body"]
    for index, texts in enumerate(loads):
        settings = {f"set_{name}": text for name, text in zip(properties, texts, strict=True)}
        external.cloneAndAppend(made("ExternalForce", f"load_{index}", **settings))
    external.printToXML(str(file))
    return file
