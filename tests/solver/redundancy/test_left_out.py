"""Forces that are left out of a model: what they would do, and what muscles, reserves and constraints have to give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.forces.coordinate_force import CoordinateSpring
from solver.forces.path_force import PathSpring
from solver.inverse_dynamics import inverse_dynamics
from solver.motion import decimate, differentiate
from solver.multibody.dynamics import equations_of_motion
from solver.multibody.external_loads import ExternalForce
from solver.multibody.postures import postures
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.left_out import forces_of, reserve_forces, without_forces
from tests.solver.refusals import raises_refusal

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


def test_reserve_forces_are_by_coordinate() -> None:
    reserves = np.arange(2.0 * len(BARE.actuators)).reshape(2, -1)
    found = reserve_forces(BARE, reserves)
    for index, actuator in enumerate(BARE.actuators):
        np.testing.assert_array_equal(found[:, actuator.coordinate], reserves[:, index])
