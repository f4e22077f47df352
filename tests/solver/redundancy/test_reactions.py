"""Joint reactions of solved motions, by Newton and Euler, against those of the affine map of the redundancy problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.forces.actuators import PathActuator
from solver.model import GROUND, Path, PathPoint, PointConstraint
from solver.motion import decimate, differentiate
from solver.multibody.joint_reactions import ReactionRequest, is_bypassed
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.redundancy_options import RedundancyOptions, options_for
from tests.refusals import raises_refusal

MODEL = bundled_model()
MOTION = decimate(differentiate(simulate_arm_raise(MODEL)), 100)


@pytest.mark.parametrize("joint", ["GlenoHumeral", "elbow", "radioulnar", "rc"])
def test_the_reaction_on_the_parent_is_that_of_the_affine_map(joint: str) -> None:
    options = RedundancyOptions(has_glenoid_cone=False, joint=joint, reactions=ReactionRequest((joint,), "parent"))
    solution = solve_motion(MODEL, MOTION, options)
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
    solution = solve_motion(pulled, MOTION, options)
    assert np.abs(solution.reserves[:, -1]).max() > 1.0
    np.testing.assert_allclose(solution.joint_reactions.force[:, 0], solution.reaction[:, 3:], atol=1e-8)


@pytest.mark.parametrize("axes", ["ground", "child", "parent"])
def test_both_bodies_of_a_joint_carry_the_same_load(axes: str) -> None:
    requests = [ReactionRequest(("elbow", "GlenoHumeral"), side, axes) for side in ("child", "parent")]
    on_child, on_parent = (
        solve_motion(MODEL, MOTION, RedundancyOptions(reactions=request)).joint_reactions for request in requests
    )
    np.testing.assert_allclose(on_child.force, -on_parent.force, atol=1e-9)
    lever = on_child.point - on_parent.point
    turned = on_parent.moment + np.cross(-lever, on_parent.force)
    np.testing.assert_allclose(on_child.moment, -turned, atol=1e-9)


def test_a_joint_beside_a_point_constraint_carries_the_rest() -> None:
    name = "sternoclavicular"  # the clavicle is held on the scapula, too
    assert is_bypassed(MODEL, MODEL.joint(name)) and not is_bypassed(MODEL, MODEL.joint("GlenoHumeral"))
    options = RedundancyOptions(has_glenoid_cone=False, joint=name, reactions=ReactionRequest((name,), "parent"))
    solution = solve_motion(MODEL, MOTION, options)
    np.testing.assert_allclose(solution.reaction[:, 3:], solution.joint_reactions.force[:, 0], atol=1e-9)
    maps = evaluate_motion(MODEL, MOTION, joint=name).maps
    controls = np.concatenate(
        [solution.activations, solution.reserves / [actuator.optimal_force for actuator in MODEL.actuators]], axis=1
    )
    without = maps.reaction_at_rest + np.einsum("fij,fj->fi", maps.reaction_per_control, controls)
    assert np.abs(without - solution.reaction).max() > 1.0


def test_a_glenoid_that_a_constraint_bypasses_has_no_cone() -> None:
    tether = PointConstraint("tether", GROUND, MODEL.body_index("hand"), np.zeros(3), np.zeros(3))
    tied = replace(MODEL, constraints=(*MODEL.constraints, tether))
    with raises_refusal(SolverCode.WRONG_GLENOID, "GlenoHumeral"):
        solve_motion(tied, MOTION)


def test_a_model_without_a_shoulder_needs_no_cone() -> None:
    renamed = tuple(replace(joint, name=f"{joint.name}_r") for joint in MODEL.joints)
    leg = replace(MODEL, joints=renamed, markers=())
    options = options_for(leg, RedundancyOptions())
    assert (options.has_glenoid_cone, options.joint) == (False, "rc_r")
    assert options_for(MODEL, RedundancyOptions()) == RedundancyOptions()
    kept = options_for(replace(MODEL, joints=renamed), RedundancyOptions())
    assert kept.has_glenoid_cone, "a glenoid without its joint is an error that solving reports"
