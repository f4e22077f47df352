"""Loads from outside: wrenches by hand, and what they cost the muscles."""

from __future__ import annotations

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.model import with_point_mass
from solver.motion import decimate, differentiate
from solver.multibody.loads import ExternalForce, LoadWrenches, load_wrenches, on_all_bodies
from solver.multibody.postures import postures
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.redundancy_options import RedundancyOptions

MODEL = bundled_model()
HAND, THORAX = MODEL.body_index("hand"), MODEL.body_index("thorax")
TIME = np.linspace(0.0, 1.0, 5)
RANDOM = np.random.default_rng(31)
SPARSE = LoadWrenches(
    RANDOM.normal(size=(4, 5, 6)), np.array([0, 0, 1, 2, 2]), np.array([1, 3, 0, 3, 2]), loads=3, bodies=4
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


def test_loads_that_cancel_change_nothing() -> None:
    motion = decimate(differentiate(simulate_arm_raise(MODEL)), 100)
    pull = np.tile([30.0, -20.0, 10.0], (len(motion.time), 1))
    pair = [ExternalForce(name, THORAX, 0, sign * pull, 0 * pull, 0, 0 * pull) for name, sign in (("a", 1), ("b", -1))]
    options = RedundancyOptions()
    loaded, bare = solve_motion(MODEL, motion, options, loads=pair), solve_motion(MODEL, motion, options)
    np.testing.assert_allclose(loaded.activations, bare.activations, atol=1e-9)


def test_a_dense_array_has_each_wrench_in_its_place_and_zeros_elsewhere() -> None:
    dense = SPARSE.dense()
    assert dense.shape == (4, 3, 4, 6)
    for k, (load, body) in enumerate(zip(SPARSE.load, SPARSE.body, strict=True)):
        assert np.array_equal(dense[:, load, body], SPARSE.values[:, k])
    assert np.count_nonzero(dense) == SPARSE.values.size


def test_the_total_is_that_of_the_dense_array() -> None:
    factors = RANDOM.normal(size=(4, 3))
    expected = np.einsum("fl,flbi->fbi", factors, SPARSE.dense())
    assert np.allclose(SPARSE.total(factors), expected, rtol=0, atol=1e-14)


def test_a_dense_array_comes_back_as_it_was() -> None:
    dense = RANDOM.normal(size=(2, 3, 4, 6))
    assert np.array_equal(on_all_bodies(dense).dense(), dense)
