"""Forces that are left out of a model: what they would do, and what muscles, reserves and constraints have to give."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.forces.actuators import PointActuator, TorqueActuator
from solver.forces.passive_forces import CoordinateSpring, PathSpring
from solver.motion import Kinematics, decimate, differentiate
from solver.multibody.dynamics import equations_of_motion, inverse_dynamics
from solver.multibody.loads import ExternalForce
from solver.multibody.postures import points_in_ground, postures
from solver.osim.model_reader import read_osim
from solver.redundancy.mechanics import actuator_forces, forces_of, without_forces
from tests.refusals import raises_refusal
from tests.solver.legs import step_in

BARE = bundled_model()
BAND = PathSpring("band", BARE.muscles[0].path, 0.05, 500.0, 0.1)
STOP = CoordinateSpring("stop", BARE.coordinate_index("shoulder_elv"), 20.0, 0.1, 0.5)
MODEL = replace(BARE, forces=(BAND,), coordinate_forces=(STOP,))
MOTION = decimate(differentiate(simulate_arm_raise(BARE)), 40)


def test_a_force_is_what_it_takes_off_the_bias_force() -> None:
    state = postures(BARE, MOTION.positions, MOTION.speeds)
    bias = equations_of_motion(BARE, state).bias_force
    for name in ("band", "stop"):
        others = [force for force in ("band", "stop") if force != name]
        alone = equations_of_motion(without_forces(MODEL, others), state).bias_force
        found = forces_of(MODEL, MOTION, name)
        np.testing.assert_allclose(found, bias - alone, atol=1e-9)
        assert np.abs(found).max() > 1.0


def test_without_its_forces_the_model_is_the_bare_one_and_names_them() -> None:
    bare = without_forces(MODEL, ["band", "stop", "band"])
    assert (bare.forces, bare.coordinate_forces, bare.left_out) == ((), (), ("band", "stop"))
    with raises_refusal(SolverCode.UNKNOWN_NAME, naming="rope to leave out; it has stop, band"):
        without_forces(MODEL, ["rope"])


def test_the_thorax_s_actuators_give_what_is_needed_to_carry_the_body_and_a_load() -> None:
    """At rest on the ground the vertical force is the weight of all bodies, less a pull upwards."""
    still = replace(MOTION, speeds=0 * MOTION.speeds, accelerations=0 * MOTION.accelerations)
    frames, vertical = len(still.time), BARE.coordinate_index("ground_thorax_ty")
    weight = 9.80665 * sum(body.mass for body in BARE.bodies)
    assert abs(inverse_dynamics(BARE, still)[:, vertical] - weight).max() < 1e-9
    up = np.tile([0.0, 50.0, 0.0], (frames, 1))
    pull = ExternalForce("pull", BARE.body_index("hand"), 0, up, 0 * up, BARE.body_index("hand"), 0 * up)
    assert abs(inverse_dynamics(BARE, still, [pull])[:, vertical] - (weight - 50.0)).max() < 1e-9


def test_forces_of_actuators_are_by_coordinate() -> None:
    reserves = np.arange(float(len(MOTION.time) * len(BARE.actuators))).reshape(len(MOTION.time), -1)
    found = actuator_forces(BARE, MOTION, reserves)
    for index, actuator in enumerate(BARE.actuators):
        np.testing.assert_array_equal(found[:, actuator.coordinate], reserves[:, index])


def test_forces_of_actuators_on_bodies_have_the_power_of_their_loads(tmp_path: Path) -> None:
    """Force by the velocity of its point, from finite differences, and moment by the angular velocity of its body."""
    model, rng = read_osim(step_in(tmp_path).model), np.random.default_rng(5)
    foot, point = model.body_index("foot"), np.array([0.02, -0.05, 0.01])
    force, axis = np.array([0.0, 0.6, 0.8]), np.array([1.0, 0.0, 0.0])
    push = PointActuator(
        name="push", optimal_force=20.0, body=foot, point=point, direction=force, is_direction_in_ground=True
    )
    turn = TorqueActuator(name="turn", optimal_force=5.0, body_a=foot, body_b=model.body_index("thigh"), axis=axis)
    model, values = replace(model, actuators=(push, turn)), np.array([30.0, -4.0])
    q, u = rng.uniform(-0.5, 0.5, (2, 6, len(model.coordinates)))
    kinematics = Kinematics(np.arange(6.0), 1.0, q, u, 0 * u, None)
    forces = actuator_forces(model, kinematics, np.tile(values, (6, 1)))
    ahead, behind = (points_in_ground(postures(model, q + h * u, u), foot, point) for h in (1e-5, -1e-5))
    turning = postures(model, q, u).angular_velocity
    power = 30.0 * (ahead - behind) / 2e-5 @ force - 4.0 * (turning[:, foot] - turning[:, turn.body_b]) @ axis
    assert np.abs(power).max() > 1.0
    np.testing.assert_allclose((forces * u).sum(axis=1), power, atol=1e-6)
