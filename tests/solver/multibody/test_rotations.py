from __future__ import annotations

import numpy as np

from solver.multibody.rotations import (
    angular_rates_matrix,
    rotate,
    rotation_about,
    rotation_body_fixed_xyz,
    skew_matrix,
    wrench_about_origin,
)

RANDOM = np.random.default_rng(5)
ANGLES = RANDOM.uniform(-1.4, 1.4, size=(20, 3))


def test_a_rotation_keeps_lengths_and_its_axis() -> None:
    axis = np.array([0.6, 0.0, -0.8])
    turned = rotation_about(axis, ANGLES[:, 0])
    assert np.allclose(turned @ np.swapaxes(turned, 1, 2), np.eye(3), atol=1e-15)
    assert np.allclose(turned @ axis, axis, atol=1e-15)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    assert np.allclose(rotation_about((0.0, 0.0, 1.0), np.pi / 2) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


def test_body_fixed_angles_turn_about_the_axes_already_turned() -> None:
    angles = (0.3, -0.7, 1.1)
    first = rotation_about((1.0, 0.0, 0.0), angles[0])
    second = rotation_about(first @ [0.0, 1.0, 0.0], angles[1])
    third = rotation_about(second @ first @ [0.0, 0.0, 1.0], angles[2])
    assert np.allclose(rotation_body_fixed_xyz(angles), third @ second @ first, atol=1e-15)


def test_angular_rates_are_the_derivative_of_the_rotation() -> None:
    rates, step = RANDOM.normal(size=ANGLES.shape), 1e-6
    forward, backward = rotation_body_fixed_xyz(ANGLES + step * rates), rotation_body_fixed_xyz(ANGLES - step * rates)
    spin = (forward - backward) / (2 * step) @ np.swapaxes(rotation_body_fixed_xyz(ANGLES), 1, 2)
    assert np.allclose(skew_matrix(rotate(angular_rates_matrix(ANGLES), rates)), spin, atol=1e-9)


def test_a_force_at_a_point_has_its_lever_about_the_origin() -> None:
    wrench = wrench_about_origin(np.array([[0.0, 2.0, 0.0]]), np.array([[3.0, 0.0, 0.0]]))
    assert np.allclose(wrench, [[0.0, 0.0, -6.0, 3.0, 0.0, 0.0]])
