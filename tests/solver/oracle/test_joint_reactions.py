"""Joint reactions against OpenSim's JointReaction: all kinds of joints and loads, both sides, all axes."""

from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.model import Array, CoordinateLock, Model
from solver.multibody.dynamics import Axes, JointReactions, ReactionRequest, Side, equations_of_motion, joint_reactions
from solver.multibody.loads import load_wrenches
from solver.multibody.postures import postures
from solver.muscle import evaluate_paths
from solver.osim.loads_document import read_external_loads
from tests.refusals import raises_refusal
from tests.solver.oracle.test_inverse_dynamics import loads_file
from tests.solver.oracle.test_joints import FUNCTIONS, HOLDING, coupler
from tests.solver.oracle.two_bodies import (
    frame_of,
    given,
    idle_states,
    made,
    model_with,
    opensim,
    random_states,
    read_back,
    vec3,
)
from tests.solver.references import relative_difference

TENSION, EFFORT = 130.0, 17.0  # N of the muscle, N or N m of the actuator
KINDS = ("PinJoint", "BallJoint", "FreeJoint", "UniversalJoint", "WeldJoint")


@pytest.mark.parametrize("kind", KINDS)
def test_reactions_of_every_joint_are_those_of_opensim(kind: str, tmp_path: Path) -> None:
    assert_as_in_opensim(model_with(getattr(opensim, kind)), tmp_path)


@pytest.mark.parametrize("kind", ["a point", "a distance", "a line along (0.3, -2.0, 0.4)", "a frame"])
@pytest.mark.parametrize("ends", [("ground", "lower"), ("lower", "upper"), ("lower", "third")])
def test_a_constraint_beside_the_joints_carries_its_share(kind: str, ends: tuple[str, str], tmp_path: Path) -> None:
    osim = model_with(opensim.FreeJoint)
    third = opensim.Body("third", 0.7, vec3(0.01, 0.02, 0.0), opensim.Inertia(0.004, 0.005, 0.006))
    osim.addBody(given(third))
    places = vec3(0.1, -0.1, 0.0), vec3(0.1, 0.3, 0.0), vec3(0.0, 0.05, 0.1), vec3(0.2, 0.0, 0.1)
    hinge = opensim.BallJoint("third_joint", frame_of(osim, "upper"), *places[:2], third, *places[2:])
    osim.addJoint(given(hinge))
    osim.finalizeConnections()
    osim.addConstraint(given(HOLDING[kind](*(frame_of(osim, end) for end in ends))))
    assert_as_in_opensim(osim, tmp_path)


def test_a_coupled_coordinate_and_a_lock_load_their_joints(tmp_path: Path) -> None:
    osim = model_with(opensim.UniversalJoint)
    osim.addConstraint(coupler(["first_coord_1"], "second_coord_0", FUNCTIONS["polynomial"]()))
    osim.getJointSet().get("first").upd_coordinates(0).set_locked(True)
    assert_as_in_opensim(osim, tmp_path)


def test_force_elements_load_the_joints_that_they_cross(tmp_path: Path) -> None:
    osim = model_with(opensim.BallJoint)
    frames = frame_of(osim, "ground"), frame_of(osim, "lower")
    stiffness, damping = (vec3(40, 30, 20), vec3(3, 2, 1)), (vec3(2, 3, 4), vec3(0.1, 0.2, 0.3))
    osim.addForce(given(opensim.BushingForce("bushing", *frames, *stiffness, *damping)))
    assert_as_in_opensim(osim, tmp_path)


def test_external_loads_count(tmp_path: Path) -> None:
    loads = [("pull", "grip", "twist", "lower", "upper", "lower")]
    assert_as_in_opensim(model_with(opensim.FreeJoint), tmp_path, loads_file(tmp_path, 20, loads))


def test_an_unknown_joint_is_refused_with_the_names_of_the_joints(tmp_path: Path) -> None:
    ours = read_back(model_with(), tmp_path)
    with raises_refusal(SolverCode.UNKNOWN_NAME, "elbow; it has first, second"):
        reactions(ours, *random_states(ours), "child", "ground", joints=("elbow",))


def assert_as_in_opensim(osim: Any, folder: Path, loads: Path | None = None) -> None:
    """Of all joints on both sides in all axes, with an actuator at the second joint."""
    osim.addForce(given(made("CoordinateActuator", "actuator", "second_coord_0", setOptimalForce=1.0)))
    ours = read_back(osim, folder)
    q, u = random_states(ours)
    for lock in ours.constraints:
        if isinstance(lock, CoordinateLock):
            q[:, lock.coordinate], u[:, lock.coordinate] = lock.value, 0.0
    time = np.linspace(0.1, 0.9, len(q))
    for side in get_args(Side):
        for axes in get_args(Axes):
            found = reactions(ours, q, u, side, axes, loads=loads, time=time)
            labels, expected = opensims(osim, ours, (q, u, time), side, axes, loads)
            assert list(found.labels) == labels
            for name, values in expected.items():
                assert relative_difference(getattr(found, name), values) < 1e-9, (side, axes, name)


def reactions(
    model: Model,
    q: Array,
    u: Array,
    side: Side,
    axes: Axes,
    *,
    joints: tuple[str, ...] = (),
    loads: Path | None = None,
    time: Array | None = None,
) -> JointReactions:
    """Under a tension of the muscle and an effort of the actuator."""
    state = postures(model, q, u)
    equations, paths = equations_of_motion(model, state, model.joints[0].name), evaluate_paths(model, state)
    wrenches = TENSION * paths.wrench_per_tension[:, 0]
    forces = TENSION * paths.mobility_per_tension[:, 0]
    for actuator in model.actuators:
        forces[:, actuator.coordinate] += EFFORT
    if loads is not None and time is not None:
        wrenches = wrenches + load_wrenches(read_external_loads(loads, model, time), state)
    joints = joints or tuple(joint.name for joint in model.joints)
    return joint_reactions(model, state, equations, wrenches, forces, ReactionRequest(joints, side, axes))


def opensims(
    osim: Any, model: Model, states: tuple[Array, Array, Array], side: str, axes: str, loads: Path | None
) -> tuple[list[str], dict[str, Array]]:
    """Labels and values of all joints as the analysis has them, which writes eight digits only."""
    osim, rows = osim.clone(), []
    if loads is not None:
        osim.addModelComponent(given(opensim.ExternalLoads(str(loads), True)))
    for state in idle_states(osim, model.coordinate_names, *states, tension=TENSION):
        actuator = opensim.ScalarActuator.safeDownCast(osim.getActuators().get("actuator"))
        actuator.overrideActuation(state, True)
        actuator.setOverrideActuation(state, EFFORT)
        osim.realizeAcceleration(state)
        rows.append([reaction(osim, joint, state, side, axes) for joint in osim.getJointSet()])
    labels = []
    for joint in osim.getJointSet():
        on, seen = (frame.findBaseFrame().getName() for frame in (frame_on(joint, side), axes_of(osim, joint, axes)))
        labels.append(f"{joint.getName()}_on_{on}_in_{seen}")
    return labels, dict(zip(("force", "moment", "point"), np.moveaxis(rows, 2, 0), strict=True))


def reaction(osim: Any, joint: Any, state: Any, side: str, axes: str) -> list[Array]:
    """Force, moment and point, by the lines of the analysis."""
    ground, seen, frame = osim.getGround(), axes_of(osim, joint, axes), frame_on(joint, side)
    found = getattr(joint, f"calcReactionOn{side.title()}ExpressedInGround")(state)
    force, moment = (ground.expressVectorInAnotherFrame(state, found.get(k), seen) for k in (1, 0))
    point = ground.findStationLocationInAnotherFrame(state, frame.getPositionInGround(state), seen)
    return [each.to_numpy() for each in (force, moment, point)]


def frame_on(joint: Any, side: str) -> Any:
    return joint.getChildFrame() if side == "child" else joint.getParentFrame()


def axes_of(osim: Any, joint: Any, axes: str) -> Any:
    return osim.getGround() if axes == "ground" else frame_on(joint, axes).findBaseFrame()
