"""Actuators along paths, at points and between bodies: what their controls do to accelerations and joint reaction."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.model import Model
from solver.multibody.dynamics import equations_of_motion
from solver.multibody.postures import postures
from solver.muscle import muscle_forces
from solver.paths import evaluate_paths
from solver.redundancy.mechanics import response_maps
from tests.solver.oracle.test_force_elements import lay
from tests.solver.oracle.test_paths import tilted
from tests.solver.oracle.two_bodies import (
    difference,
    difference_to,
    frame_of,
    given,
    model_with,
    opensim,
    random_states,
    read_back,
    vec3,
)
from tests.solver.references import relative_difference

Array = NDArray[np.float64]


def along_a_path(model: Any) -> Any:
    actuator = opensim.PathActuator()
    actuator.setOptimalForce(70.0)
    model.addForce(given(actuator))
    lay(model, actuator)
    return actuator


def at_a_point(is_point_global: bool, is_force_global: bool) -> Callable[[Any], Any]:
    def add(model: Any) -> Any:
        actuator = opensim.PointActuator("lower")
        actuator.set_point(vec3(0.1, -0.2, 0.05))
        actuator.set_point_is_global(is_point_global)
        actuator.set_direction(vec3(1, -2, 0.5))
        actuator.set_force_is_global(is_force_global)
        actuator.setOptimalForce(30.0)
        model.addForce(given(actuator))
        return actuator

    return add


def torque(is_global: bool, body_b: str) -> Callable[[Any], Any]:
    def add(model: Any) -> Any:
        bodies = (frame_of(model, "lower"), frame_of(model, body_b))
        actuator = opensim.TorqueActuator(*bodies, vec3(0.3, 1, -2), is_global)
        actuator.setOptimalForce(5.0)
        model.addForce(given(actuator))
        return actuator

    return add


def torque_in_an_offset_frame(model: Any) -> Any:
    frame = opensim.PhysicalOffsetFrame("turned", frame_of(model, "lower"), tilted())
    frame_of(model, "lower").addComponent(given(frame))
    model.finalizeConnections()
    actuator = torque(False, "upper")(model)
    actuator.set_bodyA("/bodyset/lower/turned")
    return actuator


def between_points(are_global: bool) -> Callable[[Any], Any]:
    def add(model: Any) -> Any:
        actuator = opensim.PointToPointActuator("upper", "lower")
        actuator.set_pointA(vec3(0.1, -0.1, 0.2))
        actuator.set_pointB(vec3(-0.1, 0.3, 0.02))
        actuator.set_points_are_global(are_global)
        actuator.setOptimalForce(40.0)
        model.addForce(given(actuator))
        return actuator

    return add


def on_a_body(is_point_global: bool, is_force_global: bool) -> Callable[[Any], Any]:
    def add(model: Any) -> Any:
        point = vec3(0.1, -0.1, 0.2)
        actuator = opensim.BodyActuator(frame_of(model, "lower"), point, is_point_global, is_force_global)
        model.addForce(given(actuator))
        return actuator

    return add


ADDED: dict[str, Callable[[Any], Any]] = {
    "PathActuator": along_a_path,
    "PointActuator, all in the body": at_a_point(False, False),
    "PointActuator, all in ground": at_a_point(True, True),
    "PointActuator, direction in ground": at_a_point(False, True),
    "TorqueActuator about an axis of ground": torque(True, "upper"),
    "TorqueActuator about an axis of the body": torque(False, "ground"),
    "TorqueActuator about an axis of an offset frame": torque_in_an_offset_frame,
    "PointToPointActuator": between_points(False),
    "PointToPointActuator in ground": between_points(True),
    "BodyActuator in ground": on_a_body(False, True),
    "BodyActuator in the body": on_a_body(True, False),
}


@pytest.mark.parametrize("kind", ADDED)
def test_controls_change_accelerations_and_reaction_as_in_opensim(kind: str, tmp_path: Path) -> None:
    osim = model_with(opensim.UniversalJoint)
    actuator = ADDED[kind](osim)
    actuator.setName("added")
    add_motor(osim)
    ours = read_back(osim, tmp_path)
    count = len(ours.actuators)
    names = ["added"] if count == 2 else [f"added_{k}" for k in range(6)]
    assert [one.name for one in ours.actuators] == [*names, "motor"]
    controls = np.random.default_rng(5).normal(size=count)
    found, reactions = with_controls(ours, controls)
    theirs, their_reactions = opensims(osim, ours, controls)
    assert relative_difference(found, theirs) < 1e-10
    assert relative_difference(reactions, their_reactions) < 1e-10
    still, _ = with_controls(ours, np.append(np.zeros(count - 1), controls[-1]))
    assert (np.abs(found - still).max(axis=1) > 0.1).sum() > 3


def test_without_controls_they_do_nothing(tmp_path: Path) -> None:
    osim = model_with(opensim.UniversalJoint)
    for index, (kind, add) in enumerate(ADDED.items()):
        if "offset" not in kind:
            add(osim).setName(f"added_{index}")
    assert difference_to(osim, read_back(osim, tmp_path)).is_nought()


def test_an_actuator_with_activation_dynamics_is_one_of_its_activation(tmp_path: Path) -> None:
    osim = model_with()
    actuator = opensim.ActivationCoordinateActuator("second_coord_0")
    actuator.setName("motor")
    actuator.setOptimalForce(12.0)
    actuator.setMinControl(-0.5)
    actuator.set_default_activation(0.0)
    osim.addForce(given(actuator))
    ours = read_back(osim, tmp_path)
    assert [(one.name, one.optimal_force, one.min_control) for one in ours.actuators] == [("motor", 12.0, -0.5)]
    assert difference_to(osim, ours).is_nought()


def add_motor(osim: Any) -> None:
    motor = opensim.CoordinateActuator("second_coord_0")
    motor.setName("motor")
    motor.setOptimalForce(3.0)
    osim.addForce(given(motor))


def with_controls(model: Model, controls: Array) -> tuple[Array, Array]:
    """Accelerations and reaction at the second joint in the random states, without muscle forces."""
    q, u = random_states(model)
    state = postures(model, q, u)
    paths, equations = evaluate_paths(model, state), equations_of_motion(model, state, reaction_joint="second")
    forces = muscle_forces(model, paths.lengths, paths.speeds)
    still = type(forces)(**vars(forces) | {"passive": np.zeros_like(forces.passive)})
    maps = response_maps(model, state, equations, paths, still)
    x = np.append(np.zeros(len(model.muscles)), controls)
    return maps.acceleration_at_rest + maps.acceleration_per_control @ x, maps.reaction_at_rest + (
        maps.reaction_per_control @ x
    )


def opensims(osim: Any, model: Model, controls: Array) -> tuple[Array, Array]:
    state = osim.initSystem()
    for muscle in osim.getMuscles():
        muscle.overrideActuation(state, True)
        muscle.setOverrideActuation(state, 0.0)
    coordinates = [osim.getCoordinateSet().get(name) for name in model.coordinate_names]
    accelerations, reactions = [], []
    for values, speeds in zip(*random_states(model), strict=True):
        for coordinate, value, speed in zip(coordinates, values, speeds, strict=True):
            coordinate.setValue(state, float(value), False)
            coordinate.setSpeedValue(state, float(speed))
        osim.realizeVelocity(state)
        applied = osim.updControls(state)
        added = opensim.Actuator.safeDownCast(osim.getForceSet().get("added"))
        added.setControls(opensim.Vector(controls[:-1].tolist()), applied)
        motor = opensim.Actuator.safeDownCast(osim.getForceSet().get("motor"))
        motor.setControls(opensim.Vector([float(controls[-1])]), applied)
        osim.setControls(state, applied)
        osim.realizeAcceleration(state)
        accelerations.append([coordinate.getAccelerationValue(state) for coordinate in coordinates])
        wrench = osim.getJointSet().get("second").calcReactionOnParentExpressedInGround(state)
        reactions.append([wrench.get(k).get(i) for k in range(2) for i in range(3)])
    return np.array(accelerations), np.array(reactions)


# What joints do to their coordinates by themselves, against OpenSim.


@pytest.mark.parametrize("coordinate", ["first_coord_0", "first_coord_2", "second_coord_0"])
@pytest.mark.parametrize("joint", ["PlanarJoint", "FreeJoint"])
def test_a_spring_pulls_a_coordinate_to_its_rest(joint: str, coordinate: str, tmp_path: Path) -> None:
    model = model_with(getattr(opensim, joint))
    spring = opensim.SpringGeneralizedForce(coordinate)
    spring.setStiffness(7.0)
    spring.setRestLength(0.3)
    spring.setViscosity(0.4)
    model.addForce(given(spring))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("coordinate", ["first_coord_0", "first_coord_1", "second_coord_0"])
def test_a_limit_pushes_a_coordinate_back(coordinate: str, tmp_path: Path) -> None:
    model = model_with(opensim.PlanarJoint)
    is_angle = coordinate != "first_coord_1"
    upper, lower, transition = (20.0, -15.0, 30.0) if is_angle else (0.3, -0.2, 0.5)
    model.addForce(given(opensim.CoordinateLimitForce(coordinate, upper, 0.2, lower, 0.3, 0.01, transition)))
    assert difference(model, tmp_path).is_nought()


def test_an_actuator_keeps_the_limits_of_its_control(tmp_path: Path) -> None:
    model = model_with()
    for name, limits in (("free", ()), ("pushes", (0.0, 0.7)), ("held_below", (-0.2,))):
        actuator = opensim.CoordinateActuator("second_coord_0")
        actuator.setName(name)
        for limit, setting in zip(limits, (actuator.setMinControl, actuator.setMaxControl), strict=False):
            setting(limit)
        model.addForce(given(actuator))
    found = {each.name: (each.min_control, each.max_control) for each in read_back(model, tmp_path).actuators}
    assert found == {"free": (-np.inf, np.inf), "pushes": (0.0, 0.7), "held_below": (-0.2, np.inf)}
