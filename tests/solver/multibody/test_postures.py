"""Derivatives against finite differences along a true motion: q moves with the rates that belong to u."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.model import GROUND, NO_COORDINATE, AxisMotion, Model
from solver.multibody.postures import (
    Postures,
    jacobians,
    points_in_ground,
    postures,
    rates_of_coordinates,
    speeds_from_rates,
)
from solver.multibody.rotations import rotate, skew_matrix
from tests.solver.linkage import linkage
from tests.solver.refusals import raises_refusal

Array = NDArray[np.float64]

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


def test_the_ground_stays() -> None:
    state = BUNDLED.at(0.0)
    assert np.array_equal(state.rotation_to_ground[:, GROUND], np.broadcast_to(np.eye(3), (len(Q), 3, 3)))
    assert not jacobians(MODEL, state)[:, GROUND].any()


def test_a_shoulder_coordinate_moves_the_arm_and_nothing_before_it() -> None:
    elevation = MODEL.coordinate_index("shoulder_elv")
    moved = jacobians(MODEL, BUNDLED.at(0.0))[..., elevation].any(axis=(0, 2))
    assert [body.name for body, does in zip(MODEL.bodies, moved, strict=True) if does] == [
        "humerus",
        "ulna",
        "radius",
        "hand",
    ]


def test_a_welded_body_stays_where_it_is() -> None:
    still = AxisMotion(np.vstack([np.eye(3)] * 2), np.full(6, NO_COORDINATE), (polynomial([0.0]),) * 6)
    joint = replace(MODEL.joints[0], motion=still)
    welded = replace(MODEL, bodies=MODEL.bodies[:2], coordinates=(), joints=(joint,))
    state = postures(welded, np.zeros((2, 0)), np.zeros((2, 0)))
    rotation = joint.frame_in_parent.rotation @ joint.frame_in_child.rotation.T
    assert np.allclose(state.rotation_to_ground[:, 1], rotation)
    assert not state.angular_velocity.any()


def test_the_scapula_keeps_to_its_ellipsoid() -> None:
    joint = MODEL.joint("scapulothoracic")
    state = BUNDLED.at(0.0)
    contact = points_in_ground(state, joint.child, joint.frame_in_child.translation)
    thorax, placement = joint.parent, joint.frame_in_parent
    in_thorax = rotate(
        np.swapaxes(state.rotation_to_ground[:, thorax], 1, 2), contact - state.origin_in_ground[:, thorax]
    )
    in_joint = (in_thorax - placement.translation) @ placement.rotation
    radii = np.array([0.0829975, 0.199991, 0.083001])
    assert np.allclose(((in_joint / radii) ** 2).sum(axis=1), 1.0, atol=1e-12)


def test_coordinates_of_the_wrong_number_are_refused() -> None:
    with raises_refusal(SolverCode.WRONG_SHAPE, naming="(6, 16)"):
        postures(MODEL, Q[:, :16], Q)
