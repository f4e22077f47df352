"""Actuators on bodies beside those of coordinates, and joint reactions of solved motions."""

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.forces.actuators import PathActuator, TorqueActuator
from solver.model import GROUND, AxisMotion, Model, Path, PathPoint, PointConstraint
from solver.motion import decimate, differentiate
from solver.multibody.dynamics import ReactionRequest, is_bypassed
from solver.redundancy.effort import RedundancyOptions, Reserve, options_for, with_reserves
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from tests.refusals import raises_refusal

MODEL = bundled_model()
ELBOW = MODEL.coordinate_index("elbow_flexion")
MOTION = decimate(differentiate(simulate_arm_raise(MODEL)), 60)
COARSE = decimate(differentiate(simulate_arm_raise(MODEL)), 100)


def with_elbow_torque() -> Model:
    """The actuator of the elbow as a torque between humerus and ulna about the joint's axis."""
    joint = next(joint for joint in MODEL.joints if ELBOW in joint.motion.coordinates)
    assert isinstance(joint.motion, AxisMotion)
    axis = joint.frame_in_child.rotation @ joint.motion.axes[joint.motion.coordinate.tolist().index(ELBOW)]
    strength = MODEL.actuators[6].optimal_force
    torque = TorqueActuator(
        name="elbow_torque",
        optimal_force=strength,
        body_a=joint.child,
        body_b=joint.parent,
        axis=axis,
        is_axis_in_ground=False,
    )
    return replace(MODEL, actuators=(*MODEL.actuators[:6], torque, *MODEL.actuators[7:]))


def test_a_torque_about_the_elbow_s_axis_is_the_actuator_of_the_elbow() -> None:
    model = with_elbow_torque()
    assert model.actuated_names[6] == "elbow_torque"
    free = RedundancyOptions(unweighted_coordinates=(*RedundancyOptions().unweighted_coordinates, "elbow_torque"))
    found, expected = solve_motion(model, MOTION, free), solve_motion(MODEL, MOTION)
    np.testing.assert_allclose(found.activations, expected.activations, atol=1e-7)
    np.testing.assert_allclose(found.reserves, expected.reserves, atol=1e-5)
    np.testing.assert_allclose(found.reaction, expected.reaction, atol=1e-4)


def test_a_path_actuator_beside_a_muscle_takes_over_its_work() -> None:
    muscle = MODEL.muscles[MODEL.muscle_names.index("DeltoideusScapula_M")]
    cable = PathActuator(name="cable", optimal_force=1000.0, path=muscle.path, min_control=0.0)
    model = replace(MODEL, actuators=(*MODEL.actuators, cable))
    weighted = RedundancyOptions(weights={"cable": 0.1})
    found, expected = solve_motion(model, MOTION, weighted), solve_motion(MODEL, MOTION)
    place = MODEL.muscle_names.index("DeltoideusScapula_M")
    assert (found.reserves[:, -1] > -1e-6).all()
    assert found.reserves[:, -1].max() > 100.0
    assert found.activations[:, place].max() < 0.5 * expected.activations[:, place].max()
    assert found.effort.sum() < 0.97 * expected.effort.sum()


def test_a_reserve_replaces_the_actuator_of_its_coordinate_only() -> None:
    model = with_reserves(with_elbow_torque(), {"elbow_flexion": Reserve(5.0), "pro_sup": Reserve(3.0)})
    assert len(model.actuators) == len(MODEL.actuators) + 1
    assert model.actuators[6].name == "elbow_torque"
    assert [one.name for one in model.actuators[-2:]] == ["elbow_flexion_reserve", "pro_sup_reserve"]


def test_a_weight_is_by_the_actuator_s_own_name() -> None:
    with raises_refusal(SolverCode.UNKNOWN_NAME, naming="elbow_flexion"):
        solve_motion(with_elbow_torque(), MOTION, RedundancyOptions(weights={"elbow_flexion": 1.0}))


@pytest.mark.parametrize("joint", ["GlenoHumeral", "elbow", "radioulnar", "rc"])
def test_the_reaction_on_the_parent_is_that_of_the_affine_map(joint: str) -> None:
    options = RedundancyOptions(has_glenoid_cone=False, joint=joint, reactions=ReactionRequest((joint,), "parent"))
    solution = solve_motion(MODEL, COARSE, options)
    found = solution.joint_reactions
    np.testing.assert_allclose(found.moment[:, 0], solution.reaction[:, :3], atol=1e-8)
    np.testing.assert_allclose(found.force[:, 0], solution.reaction[:, 3:], atol=1e-8)
    assert np.abs(solution.reaction[:, 3:]).max() > 1.0


def test_an_actuator_between_bodies_loads_the_joints_that_it_crosses() -> None:
    hand, thorax = MODEL.body_index("hand"), MODEL.body_index("thorax")
    points = (PathPoint(thorax, np.array([0.1, 0.2, 0.1])), PathPoint(hand, np.array([0.0, -0.05, 0.0])))
    pulled = replace(
        MODEL, actuators=(*MODEL.actuators, PathActuator(name="cable", optimal_force=500.0, path=Path(points, ())))
    )
    request = ReactionRequest(("elbow",), "parent")
    options = RedundancyOptions(has_glenoid_cone=False, joint="elbow", reactions=request, weights={"cable": 0.01})
    solution = solve_motion(pulled, COARSE, options)
    assert np.abs(solution.reserves[:, -1]).max() > 1.0
    np.testing.assert_allclose(solution.joint_reactions.force[:, 0], solution.reaction[:, 3:], atol=1e-8)


@pytest.mark.parametrize("axes", ["ground", "child", "parent"])
def test_both_bodies_of_a_joint_carry_the_same_load(axes: str) -> None:
    requests = [ReactionRequest(("elbow", "GlenoHumeral"), side, axes) for side in ("child", "parent")]
    on_child, on_parent = (
        solve_motion(MODEL, COARSE, RedundancyOptions(reactions=request)).joint_reactions for request in requests
    )
    np.testing.assert_allclose(on_child.force, -on_parent.force, atol=1e-9)
    lever = on_child.point - on_parent.point
    turned = on_parent.moment + np.cross(-lever, on_parent.force)
    np.testing.assert_allclose(on_child.moment, -turned, atol=1e-9)


def test_a_joint_beside_a_point_constraint_carries_the_rest() -> None:
    name = "sternoclavicular"  # the clavicle is held on the scapula, too
    assert is_bypassed(MODEL, MODEL.joint(name)) and not is_bypassed(MODEL, MODEL.joint("GlenoHumeral"))
    options = RedundancyOptions(has_glenoid_cone=False, joint=name, reactions=ReactionRequest((name,), "parent"))
    solution = solve_motion(MODEL, COARSE, options)
    np.testing.assert_allclose(solution.reaction[:, 3:], solution.joint_reactions.force[:, 0], atol=1e-9)
    maps = evaluate_motion(MODEL, COARSE, joint=name).maps(MODEL)
    controls = np.concatenate(
        [solution.activations, solution.reserves / [actuator.optimal_force for actuator in MODEL.actuators]], axis=1
    )
    without = maps.reaction_at_rest + np.einsum("fij,fj->fi", maps.reaction_per_control, controls)
    assert np.abs(without - solution.reaction).max() > 1.0


def test_a_glenoid_that_a_constraint_bypasses_has_no_cone() -> None:
    tether = PointConstraint("tether", GROUND, MODEL.body_index("hand"), np.zeros(3), np.zeros(3))
    tied = replace(MODEL, constraints=(*MODEL.constraints, tether))
    with raises_refusal(SolverCode.WRONG_GLENOID, "GlenoHumeral"):
        solve_motion(tied, COARSE)


def test_a_model_without_a_shoulder_needs_no_cone() -> None:
    renamed = tuple(replace(joint, name=f"{joint.name}_r") for joint in MODEL.joints)
    leg = replace(MODEL, joints=renamed, markers=())
    options = options_for(leg, RedundancyOptions())
    assert (options.has_glenoid_cone, options.joint) == (False, "rc_r")
    assert options_for(MODEL, RedundancyOptions()) == RedundancyOptions()
    kept = options_for(replace(MODEL, joints=renamed), RedundancyOptions())
    assert kept.has_glenoid_cone, "a glenoid without its joint is an error that solving reports"
