"""Poses and velocities of the bodies, for a batch of frames.

Velocities of bodies are kept as screws about the ground origin: (w, v) with w the angular velocity and v the velocity
of the body's material point at the ground origin. So one column per coordinate serves all bodies beyond its joint, and
moments about the ground origin are power-conjugate to them. Equations: Featherstone, Rigid Body Dynamics
Algorithms (2008), ch. 2 and 4; solver/multibody/joints.py has those of the joints, compiled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import GROUND, AxisMotion, Model, ModelError
from solver.multibody.body_tables import POSE, Records, tables_of
from solver.multibody.rotations import angular_rates_change, angular_rates_matrix, cross, rotate

Array = NDArray[np.float64]


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
    tables = tables_of(model)
    poses, screws = np.zeros((len(q), len(model.bodies)), POSE), np.zeros((*q.shape, 6))
    poses["rotation"][:, GROUND] = np.eye(3)
    move_bodies(tables.joints, tables.functions, q, u, poses, screws)
    return Postures(q, u, poses, screws, np.zeros(len(q)) if time is None else np.array(time, dtype=float))


def jacobians(model: Model, state: Postures) -> Array:
    """(frames, bodies, 6, coordinates): each body's screw (w, v) about the ground origin per unit of each speed."""
    columns = np.swapaxes(state.screws, 1, 2)
    return columns[:, None] * tables_of(model).moves[:, None]


def points_in_ground(state: Postures, body: int, location: Array) -> Array:
    """(frames, 3) place in ground [m] of a point of a body, location (3,) in it."""
    return state.origin_in_ground[:, body] + state.rotation_to_ground[:, body] @ location


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
