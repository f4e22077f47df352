"""Rotations and moments, batched: any leading axes, the last one or two are x, y, z. Angles in rad."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """(…, 3, 3) rotation by `angle` (…) about the unit vector `axis` (3,): I + sin θ [a]× + (1 − cos θ) [a]×²."""
    skew = skew_matrix(np.asarray(axis, dtype=float))
    theta = np.asarray(angle, dtype=float)[..., None, None]
    return np.asarray(np.eye(3) + np.sin(theta) * skew + (1.0 - np.cos(theta)) * (skew @ skew))


def rotation_body_fixed_xyz(angles: ArrayLike) -> Array:
    """(…, 3, 3) rotation Rx(a₁) Ry(a₂) Rz(a₃) for `angles` (…, 3)."""
    a = np.asarray(angles, dtype=float)
    x, y, z = np.eye(3)
    return rotation_about(x, a[..., 0]) @ rotation_about(y, a[..., 1]) @ rotation_about(z, a[..., 2])


def body_fixed_xyz_angles(rotation: Array) -> Array:
    """(…, 3) angles a of rotations Rx(a₁) Ry(a₂) Rz(a₃) (…, 3, 3), with a₂ between −π/2 and π/2."""
    second = np.arctan2(rotation[..., 0, 2], np.hypot(rotation[..., 0, 0], rotation[..., 0, 1]))
    first = np.arctan2(-rotation[..., 1, 2], rotation[..., 2, 2])
    third = np.arctan2(-rotation[..., 0, 1], rotation[..., 0, 0])
    return np.stack([first, second, third], axis=-1)


def angular_rates_matrix(angles: ArrayLike) -> Array:
    """(…, 3, 3) matrix E of w = E(a) ȧ: the angular velocity, in the fixed frame, of body-fixed XYZ angles (…, 3)."""
    a = np.asarray(angles, dtype=float)
    s1, c1, s2, c2 = np.sin(a[..., 0]), np.cos(a[..., 0]), np.sin(a[..., 1]), np.cos(a[..., 1])
    rates = np.zeros((*a.shape[:-1], 3, 3))
    rates[..., 0, 0] = 1.0
    rates[..., 1, 1], rates[..., 2, 1] = c1, s1
    rates[..., 0, 2], rates[..., 1, 2], rates[..., 2, 2] = s2, -s1 * c2, c1 * c2
    return rates


def angular_rates_change(angles: ArrayLike, rates: ArrayLike) -> Array:
    """(…, 3, 3) dE/dt of angular_rates_matrix while the angles (…, 3) change at `rates` (…, 3)."""
    a, r = np.asarray(angles, dtype=float), np.asarray(rates, dtype=float)
    s1, c1, s2, c2 = np.sin(a[..., 0]), np.cos(a[..., 0]), np.sin(a[..., 1]), np.cos(a[..., 1])
    r1, r2 = r[..., 0], r[..., 1]
    change = np.zeros((*a.shape[:-1], 3, 3))
    change[..., 1, 1], change[..., 2, 1] = -s1 * r1, c1 * r1
    change[..., 0, 2] = c2 * r2
    change[..., 1, 2], change[..., 2, 2] = s1 * s2 * r2 - c1 * c2 * r1, -s1 * c2 * r1 - c1 * s2 * r2
    return change


def skew_matrix(vector: ArrayLike) -> Array:
    """(…, 3, 3) matrix [v]× with [v]× w = v × w, for `vector` (…, 3)."""
    v = np.asarray(vector, dtype=float)
    skew = np.zeros((*v.shape, 3))
    skew[..., 0, 1], skew[..., 0, 2] = -v[..., 2], v[..., 1]
    skew[..., 1, 0], skew[..., 1, 2] = v[..., 2], -v[..., 0]
    skew[..., 2, 0], skew[..., 2, 1] = -v[..., 1], v[..., 0]
    return skew


def rotate(rotation: Array, vector: Array) -> Array:
    """(…, 3) vectors turned by rotations (…, 3, 3); leading axes broadcast."""
    return np.asarray(np.einsum("...ij,...j->...i", rotation, vector))


def each_frame(matrix: Array, values: Array) -> Array:
    """The product of each frame's matrix (frames, i, j) with its values (scenarios, frames, j)."""
    return (matrix @ values.transpose(1, 2, 0)).transpose(2, 0, 1)


def cross(a: Array, b: Array) -> Array:
    """(…, 3) vector product; leading axes broadcast. NumPy's own takes 20 µs to begin."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def wrench_about_origin(point: Array, force: Array) -> Array:
    """(…, 6) moment about the origin and force, of a force (…, 3) that acts at a point (…, 3)."""
    return np.concatenate([cross(point, force), force], axis=-1)
