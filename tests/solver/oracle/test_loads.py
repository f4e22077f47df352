"""External loads, which OpenSim prints and the solver reads, applied by both at the same states and times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.model import Model, with_point_mass
from solver.motion import decimate, differentiate
from solver.multibody.dynamics import equations_of_motion
from solver.multibody.loads import load_wrenches
from solver.multibody.postures import postures
from solver.muscle import muscle_forces
from solver.osim.loads_document import read_external_loads
from solver.osim.model_reader import read_osim
from solver.paths import evaluate_paths
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.mechanics import response_maps
from solver.redundancy.motion_solution import solve_motion
from solver.time_series_table import write_table
from tests.solver.oracle.two_bodies import model_with, opensim, random_states, read_back
from tests.solver.references import relative_difference

certify: Any = pytest.importorskip("tests.solver.certify")


Array = NDArray[np.float64]
COLUMNS = [f"{part}_{axis}" for part in ("pull", "grip", "twist") for axis in "xyz"]
# of what: force, point and torque columns, body, axes, origin
KINDS = {
    "a force at the body's origin": ("pull", "", "", "lower", "ground", ""),
    "a force at a point of the ground": ("pull", "grip", "", "lower", "ground", "ground"),
    "a force in the body's axes at a point of it": ("pull", "grip", "", "lower", "lower", "lower"),
    "a torque": ("", "", "twist", "upper", "ground", ""),
    "all in other bodies' axes": ("pull", "grip", "twist", "upper", "lower", "lower"),
}


@pytest.mark.parametrize("rows", [2, 3, 4, 50])
@pytest.mark.parametrize("kind", KINDS)
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
    accelerations, reactions = opensims(osim, ours, file, q, u, time, "second")
    assert relative_difference(maps.acceleration_at_rest, accelerations) < 1e-10
    assert relative_difference(maps.reaction_at_rest, reactions) < 1e-10


def test_loads_on_the_bundled_model_reach_its_glenoid_as_in_opensim(tmp_path: Path) -> None:
    ours = bundled_model()
    osim = certify.build(ours)
    file = written(
        tmp_path,
        40,
        [("pull", "grip", "twist", "hand", "ground", "hand"), ("pull", "", "", "thorax", "scapula", "")],
    )
    q, u = certify.chosen_states(ours)
    time = np.linspace(0.0, 1.0, len(q))
    state = postures(ours, q, u)
    equations, paths = equations_of_motion(ours, state), evaluate_paths(ours, state)
    forces = muscle_forces(ours, paths.lengths, paths.speeds)
    still = type(forces)(**vars(forces) | {"passive": np.zeros_like(forces.passive)})
    maps = response_maps(ours, state, equations, paths, still, load_wrenches(sampled(file, ours, time), state))
    accelerations, reactions = opensims(osim, ours, file, q, u, time, "GlenoHumeral")
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
    """An XML of external loads as OpenSim prints it, with its data beside it over the times 0 to 1 s."""
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


def opensims(osim: Any, model: Model, file: Path, q: Array, u: Array, time: Array, joint: str) -> tuple[Array, Array]:
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
