"""Actuators on bodies in the muscle-redundancy problem, beside actuators of coordinates that do the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.forces.actuators import PathActuator, TorqueActuator
from solver.model import AxisMotion, Model
from solver.motion import decimate, differentiate
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.redundancy_options import RedundancyOptions, Reserve, with_reserves
from tests.refusals import raises_refusal

MODEL = bundled_model()
ELBOW = MODEL.coordinate_index("elbow_flexion")
MOTION = decimate(differentiate(simulate_arm_raise(MODEL)), 60)


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
