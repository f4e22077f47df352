"""Where the bodies are and how they move, for a batch of frames.

Velocities of bodies are kept as screws about the ground origin: (w, v) with w the angular velocity and v the velocity
of the body's material point that is just at the ground origin. So one column per coordinate serves every body beyond
its joint, and moments about the ground origin are their power partners. Equations: Featherstone, Rigid Body Dynamics
Algorithms (2008), ch. 2 and 4; the scapulothoracic joint: Seth, Matias, Veloso, Delp, PLoS ONE 11(1):e0141028 (2016).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model import GROUND, NO_COORDINATE, AxisMotion, BallMotion, Joint, Model, ModelError, ScapulothoracicMotion
from solver.spatial import angular_rates_change, angular_rates_matrix, rotate, rotation_about, rotation_body_fixed_xyz

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Postures:
    """Poses and velocities of all bodies in a batch of frames; everything in ground, SI; body 0 is the ground itself.

    coordinates         (frames, coordinates) q
    speeds              (frames, coordinates) u = q̇, except that of the three angles of a scapula, ball or free joint,
                        where u are the components of the angular velocity in the joint's parent frame
    rotation_to_ground  (frames, bodies, 3, 3) turns body vectors into ground vectors
    origin_in_ground    (frames, bodies, 3) body origins
    angular_velocity    (frames, bodies, 3)
    origin_velocity     (frames, bodies, 3) velocity of the body origins
    screws              (frames, coordinates, 6) (w, v) that a unit of each speed gives every body beyond its joint
    bias_acceleration   (frames, bodies, 6) rate of change of each body's screw (w, v) while all u̇ are zero
    """

    coordinates: Array
    speeds: Array
    rotation_to_ground: Array
    origin_in_ground: Array
    angular_velocity: Array
    origin_velocity: Array
    screws: Array
    bias_acceleration: Array


def postures(model: Model, coordinates: Array, speeds: Array) -> Postures:
    """The postures at coordinates q (frames, coordinates) and speeds u (frames, coordinates); nothing is assembled."""
    expected = (len(coordinates), len(model.coordinates))
    if coordinates.shape != expected or speeds.shape != expected:
        raise ModelError(f"expected q and u of shape {expected}, found {coordinates.shape} and {speeds.shape}")
    frames, bodies = len(coordinates), len(model.bodies)
    rotation, origin = np.zeros((frames, bodies, 3, 3)), np.zeros((frames, bodies, 3))
    velocity, bias = np.zeros((frames, bodies, 6)), np.zeros((frames, bodies, 6))
    screws = np.zeros((frames, len(model.coordinates), 6))
    rotation[:, GROUND] = np.eye(3)
    for joint in model.joints:
        parent, child = joint.parent, joint.child
        move = _motion(joint, coordinates, speeds)
        to_ground = rotation[:, parent] @ joint.frame_in_parent.rotation
        base = origin[:, parent] + rotation[:, parent] @ joint.frame_in_parent.translation
        rotation[:, child] = to_ground @ move.rotation @ joint.frame_in_child.rotation.T
        end = base + rotate(to_ground, move.translation)
        origin[:, child] = end - rotation[:, child] @ joint.frame_in_child.translation
        columns = _screw_in_ground(to_ground[:, None], base[:, None], move.columns)
        screws[:, move.coordinates] = columns
        relative = np.einsum("fci,fc->fi", columns, speeds[:, move.coordinates])
        velocity[:, child] = velocity[:, parent] + relative
        own = _screw_in_ground(to_ground, base, move.bias)
        bias[:, child] = bias[:, parent] + own + _screw_cross(velocity[:, parent], relative)
    angular, linear = velocity[..., :3], velocity[..., 3:] + np.cross(velocity[..., :3], origin)
    return Postures(coordinates, speeds, rotation, origin, angular, linear, screws, bias)


def jacobians(model: Model, state: Postures) -> Array:
    """(frames, bodies, 6, coordinates): each body's screw (w, v) about the ground origin per unit of each speed."""
    columns = np.swapaxes(state.screws, 1, 2)
    return columns[:, None] * bodies_moved(model)[None, :, None, :]


def bodies_moved(model: Model) -> NDArray[np.bool_]:
    """(bodies, coordinates): whether a coordinate moves a body, that is, lies between it and the ground."""
    moved = np.zeros((len(model.bodies), len(model.coordinates)), dtype=bool)
    for joint in model.joints:
        moved[joint.child] = moved[joint.parent]
        moved[joint.child, list(joint.motion.coordinates)] = True
    return moved


def points_in_ground(state: Postures, body: int, location: Array) -> Array:
    """(frames, 3) where a point of a body, location (3,) in it, is in ground [m]."""
    return state.origin_in_ground[:, body] + state.rotation_to_ground[:, body] @ location


def point_acceleration(alpha: Array, at_origin: Array, angular: Array, velocity: Array, point: Array) -> Array:
    """Acceleration (…, 3) in ground of a point moving with `velocity`, from its body's angular velocity and the rate of
    change (α, v̇₀) of its body's screw.
    """
    return at_origin + np.cross(alpha, point) + np.cross(angular, velocity)


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
    """Of each joint whose speeds are an angular velocity, its three angles."""
    return [list(j.motion.turning) for j in model.joints if not isinstance(j.motion, AxisMotion)]


@dataclass(frozen=True)
class _Motion:
    """A joint's motion in its parent frame: pose of the child frame, screws about the frame's origin, their bias."""

    coordinates: list[int]
    rotation: Array
    translation: Array
    columns: Array
    bias: Array


def _motion(joint: Joint, q: Array, u: Array) -> _Motion:
    if isinstance(joint.motion, ScapulothoracicMotion):
        return _scapulothoracic(joint.motion, q, u)
    if isinstance(joint.motion, BallMotion):
        return _ball(joint.motion, q, u)
    return _axes(joint.motion, q, u)


def _axes(motion: AxisMotion, q: Array, u: Array) -> _Motion:
    """Body-fixed rotations about a₁, a₂, a₃, then a translation along a₄, a₅, a₆, all axes of the parent frame."""
    frames, drivers, coordinates = len(q), motion.coordinate, list(motion.coordinates)
    is_driven = drivers != NO_COORDINATE
    value, slope, curvature = np.zeros((3, frames, 6))
    for i, function in enumerate(motion.functions):
        at = q[:, drivers[i]] if is_driven[i] else np.zeros(1)
        value[:, i], slope[:, i], curvature[:, i] = function.derivatives(at)
    speed = np.zeros((frames, 6))
    speed[:, is_driven] = u[:, drivers[is_driven]]
    rate, bend = slope * speed, curvature * speed**2
    translation = value[:, 3:] @ motion.axes[3:]
    axes, rotation = _turned_axes(motion, value, is_driven | value.any(axis=0))
    # As Simbody does: for velocities an axis that nothing drives has no angle, even if its constant is one.
    spin_axes, _ = _turned_axes(motion, value, is_driven) if value[:, ~is_driven].any() else (axes, rotation)
    spins, slides = np.zeros((2, frames, len(coordinates), 3))
    for i, driver in enumerate(drivers.tolist()):
        if driver != NO_COORDINATE:
            axis, moves = (spin_axes[:, i], spins) if i < 3 else (motion.axes[i], slides)
            moves[:, coordinates.index(driver)] += axis * slope[:, i, None]
    columns = np.concatenate([spins, slides + np.cross(translation[:, None], spins)], axis=-1)
    spinning = spins * u[:, coordinates, None]
    change = _spin_change(axes, spinning, rate, bend)
    # d/dt of v = p′ − w × p, the velocity of the child's point at the parent frame's origin
    sliding, pushing = rate[:, 3:] @ motion.axes[3:], bend[:, 3:] @ motion.axes[3:]
    linear = pushing - np.cross(change, translation) - np.cross(spinning.sum(axis=1), sliding)
    return _Motion(coordinates, rotation, translation, columns, np.concatenate([change, linear], axis=-1))


def _turned_axes(motion: AxisMotion, angles: Array, is_turned: NDArray[np.bool_]) -> tuple[Array, Array]:
    """(frames, 3, 3) the rotation axes in the parent frame, each turned by the angles before it, and all turns."""
    axes = np.empty((len(angles), 3, 3))
    rotation = np.broadcast_to(np.eye(3), axes.shape)
    for i in range(3):
        axes[:, i] = rotation @ motion.axes[i]
        if is_turned[i]:
            turn = rotation_about(motion.axes[i], angles[:, i])
            rotation = rotation @ turn if is_turned[:i].any() else turn
    return axes, rotation


def _spin_change(axes: Array, spins: Array, rate: Array, bend: Array) -> Array:
    """(frames, 3) angular acceleration at u̇ = 0, as Simbody's function-based mobilizer has it.

    It carries the second axis along with the spin of the first coordinate, the third with that of all but the third.
    That is exact where coordinates drive one rotation each, in order, and what OpenSim computes where they do not.
    """
    others = [k for k in range(spins.shape[1]) if k != 2]
    carried_1, carried_2 = spins[:, :1].sum(axis=1), spins[:, others].sum(axis=1)
    change: Array = np.einsum("fai,fa->fi", axes, bend[:, :3])
    change += np.cross(carried_1, axes[:, 1]) * rate[:, 1, None] + np.cross(carried_2, axes[:, 2]) * rate[:, 2, None]
    return change


def _ball(motion: BallMotion, q: Array, u: Array) -> _Motion:
    """Body-fixed x-y-z angles with the angular velocity for speeds, and a place with its velocity."""
    frames = len(q)
    spin, columns = u[:, list(motion.turning)], np.zeros((frames, len(motion.coordinates), 6))
    place, velocity = np.zeros((frames, 3)), np.zeros((frames, 3))
    if motion.sliding:
        place, velocity = q[:, list(motion.sliding)], u[:, list(motion.sliding)]
        columns[:, 3:, 3:] = np.eye(3)
    columns[:, :3, :3] = np.eye(3)
    columns[:, :3, 3:] = np.cross(place[:, None], np.eye(3))
    bias = np.zeros((frames, 6))
    bias[:, 3:] = -np.cross(spin, velocity)
    rotation = rotation_body_fixed_xyz(q[:, list(motion.turning)])
    return _Motion(list(motion.coordinates), rotation, place, columns, bias)


_QUARTER_TURN = rotation_about((0.0, 0.0, 1.0), np.pi / 2)


def _scapulothoracic(motion: ScapulothoracicMotion, q: Array, u: Array) -> _Motion:
    """A frame that rolls its z axis along the normal n of an ellipsoid, then winging about an axis of its xy plane.

    As OpenSim builds it: both the ellipsoid's frame and the frame that winging turns are a quarter turn about z away
    from the joint's own, and so the first two radii trade places.
    """
    angles, spin = q[:, list(motion.coordinates[:3])], u[:, list(motion.coordinates[:3])]
    winging, winging_rate = q[:, motion.coordinates[3]], u[:, motion.coordinates[3]]
    radii = motion.radii[[1, 0, 2]]
    rolled = rotation_body_fixed_xyz(angles)
    normal = rolled[..., 2]
    contact = radii * normal
    columns = np.zeros((len(q), 4, 6))
    columns[:, :3, :3] = np.eye(3)
    axes = np.eye(3)[None]
    columns[:, :3, 3:] = radii * np.cross(axes, normal[:, None]) + np.cross(contact[:, None], axes)
    bias = np.zeros((len(q), 6))
    gliding = np.cross(spin, normal)
    bias[:, 3:] = radii * np.cross(spin, gliding) - np.cross(spin, radii * gliding)

    plane = rolled @ _QUARTER_TURN.T
    axis_in_plane = np.array([-np.sin(motion.winging_direction), np.cos(motion.winging_direction), 0.0])
    pivot_in_plane = np.array([*motion.winging_origin, 0.0])
    turn = rotation_about(axis_in_plane, winging)
    axis, pivot = plane @ axis_in_plane, contact + plane @ pivot_in_plane
    columns[:, 3, :3], columns[:, 3, 3:] = axis, np.cross(pivot, axis)
    rolling = np.einsum("fci,fc->fi", columns[:, :3], spin)
    bias += _screw_cross(rolling, columns[:, 3] * winging_rate[:, None])

    turned = np.broadcast_to(_QUARTER_TURN, (len(q), 3, 3))
    rotation = turned @ plane @ turn
    translation = (pivot - rotate(plane @ turn, np.broadcast_to(pivot_in_plane, pivot.shape))) @ _QUARTER_TURN.T
    return _Motion(
        list(motion.coordinates),
        rotation,
        translation,
        _screw_in_ground(turned[:, None], np.zeros((len(q), 1, 3)), columns),
        _screw_in_ground(turned, np.zeros((len(q), 3)), bias),
    )


def _screw_in_ground(rotation: Array, origin: Array, screw: Array) -> Array:
    """A screw (…, 6) about the origin of a frame, in it, turned and moved to the ground's axes and origin."""
    w, v = rotate(rotation, screw[..., :3]), rotate(rotation, screw[..., 3:])
    return np.concatenate([w, v + np.cross(origin, w)], axis=-1)


def _screw_cross(a: Array, b: Array) -> Array:
    """Rate of change (…, 6) of a screw b carried along by the screw a."""
    w = np.cross(a[..., :3], b[..., :3])
    return np.concatenate([w, np.cross(a[..., :3], b[..., 3:]) + np.cross(a[..., 3:], b[..., :3])], axis=-1)
