from dataclasses import replace
from typing import Any

import numpy as np

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.model import Array, Model
from solver.multibody.constraints import constraint_rows
from solver.multibody.dynamics import equations_of_motion, multipliers, response_to_loads
from solver.multibody.mass_matrix import fill_responses
from solver.multibody.postures import (
    Postures,
    jacobians,
    points_in_ground,
    postures,
    rotate,
    speeds_from_rates,
    wrench_about_origin,
)
from solver.muscle import evaluate_paths, muscle_forces
from solver.redundancy.mechanics import response_maps
from tests.refusals import raises_refusal

MODEL = bundled_model()
RANDOM = np.random.default_rng(17)
Q = MODEL.default_coordinates + 0.2 * RANDOM.normal(size=(4, len(MODEL.coordinates)))
RATES = RANDOM.normal(size=Q.shape)
FRAMES, BODIES = len(Q), len(MODEL.bodies)
STATE = postures(MODEL, Q, RATES)
EQUATIONS = equations_of_motion(MODEL, STATE)
LOADS = RANDOM.normal(size=(FRAMES, 3, BODIES, 6))
FORCES = RANDOM.normal(size=(FRAMES, 3, len(MODEL.coordinates)))


def test_accelerations_and_multipliers_solve_the_equations_of_motion_under_each_of_several_loads() -> None:
    response, (jacobian, bias) = response_to_loads(EQUATIONS, LOADS, FORCES), constraint_rows(MODEL, STATE)
    for k in range(LOADS.shape[1]):
        acceleration = EQUATIONS.acceleration_unloaded + response.acceleration[:, k]
        force = np.einsum("fbij,fbi->fj", jacobians(MODEL, STATE), LOADS[:, k]) + FORCES[:, k]
        held = rotate(np.swapaxes(jacobian, 1, 2), multipliers(EQUATIONS, force))
        inertial = rotate(EQUATIONS.mass_matrix, acceleration) + EQUATIONS.bias_force
        assert np.allclose(inertial + held, force, atol=1e-10), k
        assert np.allclose(rotate(jacobian, acceleration), -bias, atol=1e-10), k
    together = response_to_loads(EQUATIONS, LOADS.sum(axis=1, keepdims=True), FORCES.sum(axis=1, keepdims=True))
    assert np.allclose(response.reaction.sum(axis=1), together.reaction[:, 0], atol=1e-10)


def test_the_work_of_the_forces_becomes_kinetic_and_potential_energy() -> None:
    step, second = 1e-5, RANDOM.normal(size=Q.shape)
    before, now, after = (_moving(time, second) for time in (-step, 0.0, step))
    acceleration = (after.speeds - before.speeds) / (2 * step)
    equations = equations_of_motion(MODEL, now)
    force = rotate(equations.mass_matrix, acceleration) + equations.bias_force
    power = (_energy(after) - _energy(before)) / (2 * step)
    assert np.allclose((now.speeds * force).sum(axis=1), power, rtol=1e-7, atol=1e-6)


def test_a_lift_at_every_mass_centre_is_the_same_as_no_gravity() -> None:
    lifted = response_to_loads(EQUATIONS, _lift(MODEL, STATE)[:, None])
    weightless = equations_of_motion(replace(MODEL, gravity=np.zeros(3)), STATE)
    acceleration = EQUATIONS.acceleration_unloaded + lifted.acceleration[:, 0]
    assert np.allclose(acceleration, weightless.acceleration_unloaded, atol=1e-9)
    assert np.allclose(EQUATIONS.reaction_unloaded + lifted.reaction[:, 0], weightless.reaction_unloaded, atol=1e-9)


def test_the_reaction_carries_the_momentum_of_the_arm() -> None:
    step, second = 1e-5, RANDOM.normal(size=Q.shape)
    before, now, after = (_moving(time, second) for time in (-step, 0.0, step))
    equations = equations_of_motion(replace(MODEL, gravity=np.zeros(3)), now)
    acceleration = (after.speeds - before.speeds) / (2 * step)
    # R = R_b - R_a u̇, and R_b is what is left of the reaction without loads once its own u̇ is taken out
    own = rotate(equations.reaction_per_acceleration, equations.acceleration_unloaded - acceleration)
    reaction = equations.reaction_unloaded + own
    change = (_arm_momentum(after) - _arm_momentum(before)) / (2 * step)
    change[:, :3] -= np.cross(equations.reaction_point, change[:, 3:])
    assert np.allclose(reaction, -change, atol=1e-6)


def test_loads_of_any_layout_meet_the_same_machine_code() -> None:
    expected = response_to_loads(EQUATIONS, LOADS)
    kernel: Any = fill_responses
    known = len(kernel.signatures)
    layouts = {
        "column by column": np.asfortranarray(LOADS),
        "with steps": LOADS.repeat(2, axis=0)[::2],
        "read-only": np.broadcast_to(LOADS, LOADS.shape),
    }
    for case, loads in layouts.items():
        assert np.array_equal(response_to_loads(EQUATIONS, loads).acceleration, expected.acceleration), case
    assert len(kernel.signatures) == known


def test_loads_of_a_suit_change_accelerations_and_reaction_at_rest_and_nothing_else() -> None:
    paths = evaluate_paths(MODEL, STATE)
    forces = muscle_forces(MODEL, paths.lengths, paths.speeds)
    bare = response_maps(MODEL, STATE, EQUATIONS, paths, forces)
    worn = response_maps(MODEL, STATE, EQUATIONS, paths, forces, wrenches=LOADS[:, 0])
    response = response_to_loads(EQUATIONS, LOADS[:, :1])
    assert np.allclose(worn.acceleration_at_rest - bare.acceleration_at_rest, response.acceleration[:, 0], atol=1e-9)
    assert np.allclose(worn.reaction_at_rest - bare.reaction_at_rest, response.reaction[:, 0], atol=1e-9)
    assert np.array_equal(worn.acceleration_per_control, bare.acceleration_per_control)
    assert np.array_equal(worn.reaction_per_control, bare.reaction_per_control)


def test_without_constraints_the_mass_matrix_alone_resists() -> None:
    free = equations_of_motion(replace(MODEL, constraints=()), STATE)
    assert free.multiplier_per_force.shape == (FRAMES, 0, len(MODEL.coordinates))
    assert np.allclose(rotate(free.mass_matrix, free.acceleration_unloaded), -free.bias_force, atol=1e-10)


def test_a_doubled_constraint_changes_no_acceleration_and_halves_its_multipliers() -> None:
    doubled = equations_of_motion(replace(MODEL, constraints=MODEL.constraints * 2), STATE)
    single = equations_of_motion(MODEL, STATE)
    np.testing.assert_allclose(doubled.acceleration_unloaded, single.acceleration_unloaded, rtol=1e-8, atol=1e-8)
    halves = np.tile(single.multipliers_unloaded / 2, 2)
    np.testing.assert_allclose(doubled.multipliers_unloaded, halves, rtol=1e-8, atol=1e-8)


def test_a_moving_body_without_mass_is_named() -> None:
    hand, radius = MODEL.body_index("hand"), MODEL.body_index("radius")
    light = [
        replace(b, mass=0.0, inertia=np.zeros((3, 3))) if i in (hand, radius) else b for i, b in enumerate(MODEL.bodies)
    ]
    with raises_refusal(SolverCode.SINGULAR, naming="radius"):
        equations_of_motion(replace(MODEL, bodies=tuple(light)), STATE)


def _moving(time: float, second: Array) -> Postures:
    q, rates = Q + time * RATES + time**2 / 2 * second, RATES + time * second
    return postures(MODEL, q, speeds_from_rates(MODEL, q, rates))


def _mass_centers(state: Postures) -> Array:
    return np.stack([points_in_ground(state, i, body.mass_center) for i, body in enumerate(MODEL.bodies)], axis=1)


def _energy(state: Postures) -> Array:
    mass = np.array([body.mass for body in MODEL.bodies])
    matrix = equations_of_motion(MODEL, state).mass_matrix
    kinetic = np.einsum("fi,fij,fj->f", state.speeds, matrix, state.speeds) / 2
    potential: Array = kinetic - np.einsum("b,fbi,i->f", mass, _mass_centers(state), MODEL.gravity)
    return potential


def _lift(model: Model, state: Postures) -> Array:
    weight = np.array([body.mass for body in model.bodies])[:, None] * model.gravity
    return wrench_about_origin(_mass_centers(state), np.broadcast_to(-weight, (FRAMES, BODIES, 3)))


def _arm_momentum(state: Postures) -> Array:
    """Angular momentum about the ground origin and momentum of what hangs on the shoulder (frames, 6)."""
    total = np.zeros((FRAMES, 6))
    for name in ("humerus", "ulna", "radius", "hand"):
        index = MODEL.body_index(name)
        body, rotation = MODEL.bodies[index], state.rotation_to_ground[:, index]
        center, spin = points_in_ground(state, index, body.mass_center), state.angular_velocity[:, index]
        lever = center - state.origin_in_ground[:, index]
        momentum = body.mass * (state.origin_velocity[:, index] + np.cross(spin, lever))
        own = rotate(rotation @ body.inertia @ np.swapaxes(rotation, 1, 2), spin)
        total += np.concatenate([own + np.cross(center, momentum), momentum], axis=1)
    return total
