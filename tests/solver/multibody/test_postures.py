"""Derivatives against finite differences along a true motion: q moves with the rates that belong to u."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import ScalingCode, SolverCode, describe_codes
from solver.functions.coordinate_functions import polynomial
from solver.model import GROUND, NO_COORDINATE, Array, AxisMotion, Body, Marker, Model, with_point_mass
from solver.motion import decimate, differentiate
from solver.multibody.dynamics import equations_of_motion
from solver.multibody.loads import ExternalForce, LoadWrenches, load_wrenches, on_all_bodies
from solver.multibody.postures import (
    Postures,
    angular_rates_matrix,
    jacobians,
    postures,
    rates_of_coordinates,
    rotate,
    rotation_about,
    rotation_body_fixed_xyz,
    skew_matrix,
    speeds_from_rates,
    wrench_about_origin,
)
from solver.redundancy.motion_solution import solve_motion
from tests.refusals import raises_refusal
from tests.solver.linkage import linkage

MODEL = bundled_model()
MODELS = {"bundled": MODEL, "linkage": linkage()}
RANDOM = np.random.default_rng(11)
STEP = 1e-5


class Motion:
    """A model that moves along a parabola of its coordinates."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.q = model.default_coordinates + 0.3 * RANDOM.normal(size=(6, len(model.coordinates)))
        self.rates, self.acceleration = RANDOM.normal(size=self.q.shape), RANDOM.normal(size=self.q.shape)

    def at(self, time: float) -> Postures:
        q, rates = self.q + time * self.rates + time**2 / 2 * self.acceleration, self.rates + time * self.acceleration
        return postures(self.model, q, speeds_from_rates(self.model, q, rates))


BUNDLED = Motion(MODEL)
Q = BUNDLED.q


@pytest.fixture(scope="module", params=MODELS)
def motion(request: pytest.FixtureRequest) -> Motion:
    return Motion(MODELS[request.param])


def _screws(state: Postures) -> Array:
    origin_at_ground = state.origin_velocity - np.cross(state.angular_velocity, state.origin_in_ground)
    return np.concatenate([state.angular_velocity, origin_at_ground], axis=-1)


def test_velocities_are_the_derivatives_of_poses(motion: Motion) -> None:
    now, before, after = motion.at(0.0), motion.at(-STEP), motion.at(STEP)
    velocity = (after.origin_in_ground - before.origin_in_ground) / (2 * STEP)
    turning = (after.rotation_to_ground - before.rotation_to_ground) / (2 * STEP)
    spin = turning @ np.swapaxes(now.rotation_to_ground, -1, -2)
    assert np.allclose(now.origin_velocity, velocity, atol=1e-8)
    assert np.allclose(skew_matrix(now.angular_velocity), spin, atol=1e-8)


def test_accelerations_are_the_derivatives_of_velocities(motion: Motion) -> None:
    now, before, after = motion.at(0.0), motion.at(-STEP), motion.at(STEP)
    speed_change = (after.speeds - before.speeds) / (2 * STEP)
    expected = (_screws(after) - _screws(before)) / (2 * STEP)
    found = now.bias_acceleration + rotate(jacobians(motion.model, now), speed_change[:, None])
    assert np.allclose(found, expected, atol=1e-7)


def test_jacobians_give_the_velocities_of_all_bodies(motion: Motion) -> None:
    state = motion.at(0.0)
    assert np.allclose(rotate(jacobians(motion.model, state), state.speeds[:, None]), _screws(state), atol=1e-13)


def test_rates_and_speeds_belong_to_each_other(motion: Motion) -> None:
    now, before, after = motion.at(0.0), motion.at(-STEP), motion.at(STEP)
    to_rates, drift = rates_of_coordinates(motion.model, now)
    speed_change = (after.speeds - before.speeds) / (2 * STEP)
    assert np.allclose(rotate(to_rates, now.speeds), motion.rates, atol=1e-12)
    assert np.allclose(rotate(to_rates, speed_change) + drift, motion.acceleration, atol=1e-7)


def test_a_welded_body_stays_where_it_is() -> None:
    still = AxisMotion(np.vstack([np.eye(3)] * 2), np.full(6, NO_COORDINATE), (polynomial([0.0]),) * 6)
    joint = replace(MODEL.joints[0], motion=still)
    welded = replace(MODEL, bodies=MODEL.bodies[:2], coordinates=(), joints=(joint,))
    state = postures(welded, np.zeros((2, 0)), np.zeros((2, 0)))
    rotation = joint.frame_in_parent.rotation @ joint.frame_in_child.rotation.T
    assert np.allclose(state.rotation_to_ground[:, 1], rotation)
    assert not state.angular_velocity.any()


def test_coordinates_of_the_wrong_number_are_refused() -> None:
    with raises_refusal(SolverCode.WRONG_SHAPE, naming="(6, 16)"):
        postures(MODEL, Q[:, :16], Q)


RANDOM_TURNS = np.random.default_rng(5)
ANGLES = RANDOM_TURNS.uniform(-1.4, 1.4, size=(20, 3))


def test_a_rotation_is_that_of_scipy() -> None:
    axis = np.array([0.6, 0.0, -0.8])
    expected = Rotation.from_rotvec(ANGLES[:, :1] * axis).as_matrix()
    assert np.allclose(rotation_about(axis, ANGLES[:, 0]), expected, atol=1e-15)
    assert np.allclose(rotation_body_fixed_xyz(ANGLES), Rotation.from_euler("XYZ", ANGLES).as_matrix(), atol=1e-15)


def test_angular_rates_are_the_derivative_of_the_rotation() -> None:
    rates, step = RANDOM_TURNS.normal(size=ANGLES.shape), 1e-6
    forward, backward = rotation_body_fixed_xyz(ANGLES + step * rates), rotation_body_fixed_xyz(ANGLES - step * rates)
    spin = (forward - backward) / (2 * step) @ np.swapaxes(rotation_body_fixed_xyz(ANGLES), 1, 2)
    assert np.allclose(skew_matrix(rotate(angular_rates_matrix(ANGLES), rates)), spin, atol=1e-9)


def test_a_force_at_a_point_has_its_lever_about_the_origin() -> None:
    wrench = wrench_about_origin(np.array([[0.0, 2.0, 0.0]]), np.array([[3.0, 0.0, 0.0]]))
    assert np.allclose(wrench, [[0.0, 0.0, -6.0, 3.0, 0.0, 0.0]])


# Loads from outside: wrenches by hand, and what they cost the muscles.


HAND, THORAX = MODEL.body_index("hand"), MODEL.body_index("thorax")
TIME = np.linspace(0.0, 1.0, 5)
LOADS_RANDOM = np.random.default_rng(31)
SPARSE = LoadWrenches(
    LOADS_RANDOM.normal(size=(4, 5, 6)), np.array([0, 0, 1, 2, 2]), np.array([1, 3, 0, 3, 2]), loads=3, bodies=4
)


def still(frames: int) -> np.ndarray:
    return np.tile(MODEL.default_coordinates, (frames, 1))


def test_a_load_is_a_wrench_about_the_grounds_origin() -> None:
    state = postures(MODEL, still(2), still(2))
    force, torque, point = (np.tile(row, (2, 1)) for row in ([1.0, 2, 3], [0.1, 0.2, 0.3], [0.4, 0.5, 0.6]))
    (wrench, _) = load_wrenches([ExternalForce("pull", HAND, 0, force, torque, 0, point)], state)
    np.testing.assert_allclose(wrench[HAND, 3:], [1, 2, 3])
    np.testing.assert_allclose(wrench[HAND, :3], np.cross(point[0], force[0]) + torque[0])
    assert not np.delete(wrench, HAND, axis=0).any()


def test_a_weight_hung_on_the_hand_is_as_dear_as_one_that_the_model_carries() -> None:
    # slowly: the weight's inertia, which a force has not, hardly counts
    motion = decimate(differentiate(simulate_arm_raise(MODEL)), 40)
    frames, place = len(motion.time), MODEL.bodies[HAND].mass_center
    pull = np.tile(2.0 * MODEL.gravity, (frames, 1))
    hung = ExternalForce("weight", HAND, 0, pull, 0 * pull, HAND, np.tile(place, (frames, 1)))
    carried = solve_motion(with_point_mass(MODEL, "hand", 2.0, place), motion)
    found, bare = solve_motion(MODEL, motion, loads=[hung]), solve_motion(MODEL, motion)
    assert np.abs(found.activations - carried.activations).mean() < 0.01
    assert carried.effort.sum() > 1.5 * bare.effort.sum()
    assert found.effort.sum() == pytest.approx(carried.effort.sum(), rel=0.1)


def test_a_dense_array_has_each_wrench_in_its_place_and_zeros_elsewhere() -> None:
    dense = SPARSE.dense()
    assert dense.shape == (4, 3, 4, 6)
    for k, (load, body) in enumerate(zip(SPARSE.load, SPARSE.body, strict=True)):
        assert np.array_equal(dense[:, load, body], SPARSE.values[:, k])
    assert np.count_nonzero(dense) == SPARSE.values.size


def test_the_total_is_that_of_the_dense_array() -> None:
    factors = LOADS_RANDOM.normal(size=(4, 3))
    expected = np.einsum("fl,flbi->fbi", factors, SPARSE.dense())
    assert np.allclose(SPARSE.total(factors), expected, rtol=0, atol=1e-14)


def test_a_dense_array_comes_back_as_it_was() -> None:
    dense = LOADS_RANDOM.normal(size=(2, 3, 4, 6))
    assert np.array_equal(on_all_bodies(dense).dense(), dense)


# The model: read-only arrays, names, and the codes of findings.


def test_arrays_cannot_be_written() -> None:
    location = np.zeros(3)
    marker = Marker("here", GROUND, location)
    with pytest.raises(ValueError, match="read-only"):
        marker.location[0] = 1.0
    location[0] = 1.0
    assert marker.location[0] == 0.0


def test_an_unknown_body_and_an_array_of_the_wrong_shape_are_refused() -> None:
    with raises_refusal(SolverCode.UNKNOWN_NAME, naming="foot"):
        MODEL.body_index("foot")
    with raises_refusal(SolverCode.WRONG_SHAPE, naming="Body.inertia"):
        Body("stick", 1.0, np.zeros(3), np.ones(3))


def test_a_point_mass_adds_its_kinetic_energy() -> None:
    location, mass = np.array([0.1, -0.2, 0.05]), 1.3
    loaded, u = with_point_mass(MODEL, "humerus", mass, location), RANDOM.normal(size=Q.shape)
    state, humerus = postures(MODEL, Q, u), MODEL.body_index("humerus")
    lever = state.rotation_to_ground[:, humerus] @ location
    velocity = state.origin_velocity[:, humerus] + np.cross(state.angular_velocity[:, humerus], lever)
    with_it, without = (
        np.einsum("fi,fij,fj->f", u, equations_of_motion(model, state).mass_matrix, u) / 2 for model in (loaded, MODEL)
    )
    assert np.allclose(with_it - without, mass * (velocity**2).sum(axis=1) / 2, rtol=1e-12)


def test_a_code_that_several_findings_have_is_listed_once() -> None:
    found = [
        SimpleNamespace(code=code) for code in (ScalingCode.PATH_JUMP, ScalingCode.PATH_LENGTH, ScalingCode.PATH_JUMP)
    ]
    assert describe_codes(found) == f"; findings: {ScalingCode.PATH_JUMP}, {ScalingCode.PATH_LENGTH}"
    assert describe_codes([]) == ""
