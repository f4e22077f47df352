"""Poses and velocities of the bodies, for a batch of frames; rotations and moments.

Velocities of bodies are kept as screws about the ground origin: (w, v) with w the angular velocity and v the velocity
of the body's material point at the ground origin. So one column per coordinate serves all bodies beyond its joint, and
moments about the ground origin are power-conjugate to them. Equations: Featherstone, Rigid Body Dynamics
Algorithms (2008), ch. 2 and 4; solver/multibody/joints.py has those of the joints, compiled.

Functions of rotations and moments take any leading axes; the last one or two are x, y, z. Angles in rad.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solver.errors import SolverCode
from solver.model import GROUND, Array, AxisMotion, Model, ModelError
from solver.multibody.body_tables import POSE, Records, pack_bodies


@dataclass(frozen=True, eq=False)
class Postures:
    """Poses and velocities of all bodies in a batch of frames; everything in ground, SI; body 0 is the ground itself.

    coordinates  (frames, coordinates) q
    speeds       (frames, coordinates) u = q̇, except that of the three angles of a scapula, ball or free joint, where u
                 are the components of the angular velocity in the joint's parent frame
    poses        (frames, bodies) of tables.POSE, whose columns are the properties below
    screws       (frames, coordinates, 6) (w, v) that a unit of each speed gives every body beyond its joint
    time         (frames,) [s], for the constraints of prescribed coordinates
    """

    coordinates: Array
    speeds: Array
    poses: Records
    screws: Array
    time: Array

    @property
    def rotation_to_ground(self) -> Array:
        """(frames, bodies, 3, 3) turns body vectors into ground vectors."""
        return self._column("rotation")

    @property
    def origin_in_ground(self) -> Array:
        """(frames, bodies, 3) body origins."""
        return self._column("origin")

    @property
    def angular_velocity(self) -> Array:
        """(frames, bodies, 3)."""
        return self._column("angular_velocity")

    @property
    def origin_velocity(self) -> Array:
        """(frames, bodies, 3) velocity of the body origins."""
        return self._column("origin_velocity")

    @property
    def bias_acceleration(self) -> Array:
        """(frames, bodies, 6) rate of change of each body's screw (w, v) while all u̇ are zero."""
        return self._column("bias")

    def _column(self, name: str) -> Array:
        return np.asarray(self.poses[name])


def postures(model: Model, coordinates: Array, speeds: Array, time: Array | None = None) -> Postures:
    """The postures at coordinates q (frames, coordinates) and speeds u (frames, coordinates), not assembled.

    time (frames,) [s] is 0 by default.
    """
    from solver.multibody.joints import move_bodies  # the compiler behind it takes a third of a second to import

    expected = (len(coordinates), len(model.coordinates))
    if coordinates.shape != expected or speeds.shape != expected:
        sentence = f"expected q and u of shape {expected}, found {coordinates.shape} and {speeds.shape}"
        raise ModelError(sentence, SolverCode.WRONG_SHAPE)
    q, u = np.array(coordinates, dtype=float, order="C"), np.array(speeds, dtype=float, order="C")
    tables = pack_bodies(model)
    poses, screws = np.zeros((len(q), len(model.bodies)), POSE), np.zeros((*q.shape, 6))
    poses["rotation"][:, GROUND] = np.eye(3)
    move_bodies(tables.joints, tables.functions, q, u, poses, screws)
    return Postures(q, u, poses, screws, np.zeros(len(q)) if time is None else np.array(time, dtype=float))


def jacobians(model: Model, state: Postures) -> Array:
    """(frames, bodies, 6, coordinates): each body's screw (w, v) about the ground origin per unit of each speed."""
    columns = np.swapaxes(state.screws, 1, 2)
    return columns[:, None] * pack_bodies(model).moves[:, None]


def points_in_ground(state: Postures, body: int, location: Array) -> Array:
    """(frames, 3) place in ground [m] of a point of a body, location (3,) in it."""
    return state.origin_in_ground[:, body] + state.rotation_to_ground[:, body] @ location


def point_to_ground(state: Postures, body: int, point: Array, *, is_in_ground: bool) -> Array:
    """(frames, 3) place of a point (3,) that is given in a body, or in ground already [m]."""
    if is_in_ground:
        return np.broadcast_to(point, (len(state.coordinates), 3))
    return points_in_ground(state, body, point)


def vector_to_ground(state: Postures, body: int, vector: Array, *, is_in_ground: bool) -> Array:
    """(frames, 3) of a vector (3,) that is given in the axes of a body, or of ground already."""
    if is_in_ground:
        return np.broadcast_to(vector, (len(state.coordinates), 3))
    return np.asarray(state.rotation_to_ground[:, body] @ vector)


def velocity_at(state: Postures, body: int, place: Array) -> Array:
    """(frames, 3) velocity of the material point of a body that is at `place` (frames, 3), all in ground."""
    lever = place - state.origin_in_ground[:, body]
    return np.asarray(state.origin_velocity[:, body] + cross(state.angular_velocity[:, body], lever))


def point_acceleration(alpha: Array, at_origin: Array, angular: Array, velocity: Array, point: Array) -> Array:
    """Acceleration (…, 3) in ground of a point moving with `velocity`, from its body's angular velocity and the rate of
    change (α, v̇₀) of its body's screw.
    """
    return at_origin + cross(alpha, point) + cross(angular, velocity)


def speeds_from_rates(model: Model, coordinates: Array, rates: Array) -> Array:
    """u (frames, coordinates) that moves the bodies as q̇ does: u = q̇ or, of the angles of a scapula, ball or free
    joint, u = E(q) q̇.

    The published redundancy problem takes u = q̇ for the scapula instead.
    """
    speeds = rates.copy()
    for turning in _turning(model):
        speeds[:, turning] = rotate(angular_rates_matrix(coordinates[:, turning]), rates[:, turning])
    return speeds


def rates_of_coordinates(model: Model, state: Postures) -> tuple[Array, Array]:
    """N (frames, coordinates, coordinates) and Ṅ u (frames, coordinates) of q̇ = N(q) u, q̈ = N u̇ + Ṅ u."""
    q, u = state.coordinates, state.speeds
    frames, count = q.shape
    matrix, drift = np.broadcast_to(np.eye(count), (frames, count, count)).copy(), np.zeros((frames, count))
    for turning in _turning(model):
        inverse: Array = np.linalg.inv(angular_rates_matrix(q[:, turning]))  # type: ignore[assignment]
        rates = rotate(inverse, u[:, turning])
        change = rotate(angular_rates_change(q[:, turning], rates), rates)
        matrix[np.ix_(range(frames), turning, turning)] = inverse
        drift[:, turning] = -rotate(inverse, change)
    return matrix, drift


def _turning(model: Model) -> list[list[int]]:
    """The three angles of every joint whose speeds are an angular velocity."""
    return [list(j.motion.turning) for j in model.joints if not isinstance(j.motion, AxisMotion)]


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


def read_only(values: Array) -> Array:
    """The values as a contiguous read-only array, as compiled functions take them: other kinds are other types."""
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


def cross(a: Array, b: Array) -> Array:
    """(…, 3) vector product; leading axes broadcast. NumPy's own takes 20 µs to begin."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def wrench_about_origin(point: Array, force: Array) -> Array:
    """(…, 6) moment about the origin and force, of a force (…, 3) that acts at a point (…, 3)."""
    return np.concatenate([cross(point, force), force], axis=-1)
