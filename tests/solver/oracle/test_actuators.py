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
from solver.muscle import evaluate_paths, muscle_forces
from solver.redundancy.mechanics import response_maps
from tests.solver.oracle.two_bodies import (
    along_path,
    difference,
    difference_to,
    frame_of,
    given,
    made,
    model_with,
    opensim,
    random_states,
    read_back,
    set_state,
    tilted_frame,
    vec3,
)
from tests.solver.references import relative_difference

Array = NDArray[np.float64]


def torque_in_an_offset_frame(model: Any) -> Any:
    tilted_frame(model, "lower")
    ends = frame_of(model, "lower"), frame_of(model, "upper"), vec3(0.3, 1, -2), False
    actuator = made("TorqueActuator", "", *ends, set_bodyA="/bodyset/lower/lower_tilted", setOptimalForce=5.0)
    model.addForce(given(actuator))
    return actuator


def added(kind: str, *arguments: Any, **settings: Any) -> Callable[[Any], Any]:
    """Adds an actuator; a name of a body among the arguments of one about bodies is that body."""

    def add(model: Any) -> Any:
        is_about_bodies = kind in ("TorqueActuator", "BodyActuator")
        given_to = [frame_of(model, one) if is_about_bodies and isinstance(one, str) else one for one in arguments]
        actuator = made(kind, "", *given_to, **settings)
        model.addForce(given(actuator))
        return actuator

    return add


def at_a_point(is_point_global: bool, is_force_global: bool) -> Callable[[Any], Any]:
    return added(
        "PointActuator",
        "lower",
        set_point=vec3(0.1, -0.2, 0.05),
        set_point_is_global=is_point_global,
        set_direction=vec3(1, -2, 0.5),
        set_force_is_global=is_force_global,
        setOptimalForce=30.0,
    )


def between_points(are_global: bool) -> Callable[[Any], Any]:
    points = {"set_pointA": vec3(0.1, -0.1, 0.2), "set_pointB": vec3(-0.1, 0.3, 0.02)}
    return added(
        "PointToPointActuator", "upper", "lower", **points, set_points_are_global=are_global, setOptimalForce=40.0
    )


AXIS, POINT = vec3(0.3, 1, -2), vec3(0.1, -0.1, 0.2)
ADDED: dict[str, Callable[[Any], Any]] = {
    "PathActuator": lambda model: along_path(model, made("PathActuator", "", setOptimalForce=70.0)),
    "PointActuator, all in the body": at_a_point(False, False),
    "PointActuator, all in ground": at_a_point(True, True),
    "PointActuator, direction in ground": at_a_point(False, True),
    "TorqueActuator about an axis of ground": added(
        "TorqueActuator", "lower", "upper", AXIS, True, setOptimalForce=5.0
    ),
    "TorqueActuator about an axis of the body": added(
        "TorqueActuator", "lower", "ground", AXIS, False, setOptimalForce=5.0
    ),
    "TorqueActuator about an axis of an offset frame": torque_in_an_offset_frame,
    "PointToPointActuator": between_points(False),
    "PointToPointActuator in ground": between_points(True),
    "BodyActuator in ground": added("BodyActuator", "lower", POINT, False, True),
    "BodyActuator in the body": added("BodyActuator", "lower", POINT, True, False),
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


def test_an_actuator_with_activation_dynamics_is_one_of_its_activation(tmp_path: Path) -> None:
    osim = model_with()
    settings = {"setOptimalForce": 12.0, "setMinControl": -0.5, "set_default_activation": 0.0}
    osim.addForce(given(made("ActivationCoordinateActuator", "motor", "second_coord_0", **settings)))
    ours = read_back(osim, tmp_path)
    assert [(one.name, one.optimal_force, one.min_control) for one in ours.actuators] == [("motor", 12.0, -0.5)]
    assert difference_to(osim, ours).is_nought()


def add_motor(osim: Any) -> None:
    osim.addForce(given(made("CoordinateActuator", "motor", "second_coord_0", setOptimalForce=3.0)))


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
        set_state(state, coordinates, values, speeds)
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


@pytest.mark.parametrize(
    ("joint", "coordinate"),
    [("PlanarJoint", "first_coord_0"), ("FreeJoint", "first_coord_2"), ("PlanarJoint", "second_coord_0")],
)
def test_a_spring_pulls_a_coordinate_to_its_rest(joint: str, coordinate: str, tmp_path: Path) -> None:
    model = model_with(getattr(opensim, joint))
    settings = {"setStiffness": 7.0, "setRestLength": 0.3, "setViscosity": 0.4}
    model.addForce(given(made("SpringGeneralizedForce", "", coordinate, **settings)))
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
