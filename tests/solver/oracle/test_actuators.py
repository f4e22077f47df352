"""Actuators along paths, at points and between bodies: what their controls do to accelerations and joint reaction."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.model import Array, Model
from tests.solver.oracle.two_bodies import (
    along_path,
    assert_written,
    difference_to,
    frame_of,
    given,
    idle_maps,
    idle_states,
    made,
    model_with,
    opensim,
    random_states,
    read_back,
    response,
    tilted_frame,
    vec3,
)
from tests.solver.references import relative_difference


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
    ADDED[kind](osim).setName("added")
    osim.addForce(given(made("CoordinateActuator", "motor", "second_coord_0", setOptimalForce=3.0)))
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
    assert_written(ours, osim, tmp_path)


def test_an_actuator_keeps_its_limits_and_one_with_activation_dynamics_is_of_its_activation(tmp_path: Path) -> None:
    osim = model_with()
    limits: dict[str, dict[str, float]] = {
        "free": {},
        "pushes": {"setMinControl": 0.0, "setMaxControl": 0.7},
        "held_below": {"setMinControl": -0.2},
    }
    for name, settings in limits.items():
        osim.addForce(given(made("CoordinateActuator", name, "second_coord_0", **settings)))
    settings = {"setOptimalForce": 12.0, "setMinControl": -0.5, "set_default_activation": 0.0}
    osim.addForce(given(made("ActivationCoordinateActuator", "motor", "second_coord_0", **settings)))
    ours = read_back(osim, tmp_path)
    found = {one.name: (one.optimal_force, one.min_control, one.max_control) for one in ours.actuators}
    ends = {"free": (-np.inf, np.inf), "pushes": (0.0, 0.7), "held_below": (-0.2, np.inf)}
    assert found == {name: (1.0, *both) for name, both in ends.items()} | {"motor": (12.0, -0.5, np.inf)}
    assert difference_to(osim, ours).is_nought()


def with_controls(model: Model, controls: Array) -> tuple[Array, Array]:
    """Accelerations and reaction at the second joint in the random states, without muscle forces."""
    maps, x = idle_maps(model, *random_states(model)), np.append(np.zeros(len(model.muscles)), controls)
    accelerations = maps.acceleration_at_rest + maps.acceleration_per_control @ x
    return accelerations, maps.reaction_at_rest + maps.reaction_per_control @ x


def opensims(osim: Any, model: Model, controls: Array) -> list[Array]:
    rows = []
    for state in idle_states(osim, model.coordinate_names, *random_states(model)):
        osim.realizeVelocity(state)
        applied = osim.updControls(state)
        for name, values in (("added", controls[:-1]), ("motor", controls[-1:])):
            actuator = opensim.Actuator.safeDownCast(osim.getForceSet().get(name))
            actuator.setControls(opensim.Vector(values.tolist()), applied)
        osim.setControls(state, applied)
        rows.append(response(osim, state, model.coordinate_names, "second"))
    return [np.array(column) for column in zip(*rows, strict=True)]
