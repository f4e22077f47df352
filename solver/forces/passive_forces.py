"""Passive forces of a model: contact, and forces on coordinates, at points, along paths and between frames.

Contact of spheres and half-spaces as OpenSim's HuntCrossleyForce (Hunt, Crossley, J. Appl. Mech. 42(2):440-445, 1975):
Hertz's force times 1 + 3/2 c v, friction by Stribeck's curve, with Simbody's rules for two materials. SmoothContact is
OpenSim's SmoothSphereHalfSpaceForce, for optimal control (Serrancolí et al., IEEE Trans. Neural Syst. Rehabil. Eng.
27(8):1591-1602, 2019): tanh in place of the corners, so that a little force acts also without contact.

On a coordinate (OpenSim's SpringGeneralizedForce, CoordinateLimitForce, ExpressionBasedCoordinateForce): a force
(frames,) [N or N m] for values q (frames,) [rad or m] and speeds u (frames,). At points: PointToPointSpring,
ExpressionBasedPointToPointForce, and PrescribedForce if it is constant. Along a path: PathSpring,
ExpressionBasedPathForce, Ligament, Blankevoort1991Ligament.

Between two frames: BushingForce, FunctionBasedBushingForce, ExpressionBasedBushingForce. Their displacement q has the
body-fixed x-y-z angles of frame 2 in frame 1 and the place of its origin there [rad, m]. Force and moment act against
q, by axis; equations of Simbody's Force::LinearBushing. They are singular where the second angle is a right angle.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from solver.checks import freeze_arrays
from solver.functions.coordinate_functions import Expression, Function
from solver.model import Array, Model, Path, Placement
from solver.multibody.loads import Loads, no_loads
from solver.multibody.postures import (
    Postures,
    angular_rates_matrix,
    body_fixed_xyz_angles,
    point_to_ground,
    points_in_ground,
    rotate,
    vector_to_ground,
    velocity_at,
    wrench_about_origin,
)
from solver.muscle import evaluate_paths


@dataclass(frozen=True)
class ContactMaterial:
    """stiffness [N/m²] of the plane strain, dissipation [s/m]; friction: static, dynamic [1], viscous [s/m]."""

    stiffness: float
    dissipation: float
    static_friction: float
    dynamic_friction: float
    viscous_friction: float


@dataclass(frozen=True)
class ContactSurface:
    """A sphere about the origin of its placement in a body, or the half-space x > 0 there (radius None)."""

    body: int
    placement: Placement
    radius: float | None
    material: ContactMaterial


@dataclass(frozen=True)
class HuntCrossleyContact:
    """Contact of every pair of surfaces but two half-spaces; friction is greatest at transition_velocity [m/s]."""

    name: str
    surfaces: tuple[ContactSurface, ...]
    transition_velocity: float

    def loads(self, model: Model, state: Postures) -> Loads:
        wrenches, forces = no_loads(model, state)
        ordered = sorted(self.surfaces, key=lambda surface: surface.radius is not None)  # half-spaces first
        for one, two in combinations(ordered, 2):
            if two.radius is None:
                continue
            touching = _sphere_on_sphere(state, one, two) if one.radius else _sphere_on_plane(state, one, two)
            with np.errstate(invalid="ignore", divide="ignore"):  # in frames without contact
                wrench = self._wrench(state, one, two, touching)
            wrench[~(touching.depth > 0.0)] = 0.0
            wrenches[:, one.body] -= wrench
            wrenches[:, two.body] += wrench
        return wrenches, forces

    def _wrench(self, state: Postures, one: ContactSurface, two: ContactSurface, touching: _Touching) -> Array:
        """(frames, 6) on the second body."""
        first, second = one.material, two.material
        k_1, k_2 = (material.stiffness ** (2 / 3) for material in (first, second))
        share = k_2 / (k_1 + k_2)
        place = touching.middle + ((0.5 - share) * touching.depth)[:, None] * touching.normal
        k, c = k_1 * share, first.dissipation * share + second.dissipation * (1.0 - share)
        hertz = 4 / 3 * k * touching.depth * np.sqrt(touching.radius * k * touching.depth)
        sliding = velocity_at(state, one.body, place) - velocity_at(state, two.body, place)
        approach = (sliding * touching.normal).sum(axis=1)
        pressure = np.maximum(hertz * (1.0 + 1.5 * c * approach), 0.0)
        tangent = sliding - approach[:, None] * touching.normal
        slip = np.linalg.norm(tangent, axis=1)
        static = _joint_friction(first.static_friction, second.static_friction)
        dynamic = _joint_friction(first.dynamic_friction, second.dynamic_friction)
        viscous = _joint_friction(first.viscous_friction, second.viscous_friction)
        coefficient = _stribeck(static, dynamic, slip / self.transition_velocity) + viscous * slip
        friction = pressure * coefficient / np.where(slip > 0.0, slip, 1.0)
        return wrench_about_origin(place, pressure[:, None] * touching.normal + friction[:, None] * tangent)


@dataclass(frozen=True)
class _Touching:
    """Normal (frames, 3) towards the second surface, middle (frames, 3) of the overlap, its depth (frames,) [m], and
    the effective radius of curvature [m]; everything in ground.
    """

    normal: Array
    middle: Array
    depth: Array
    radius: float


def _sphere_on_sphere(state: Postures, one: ContactSurface, two: ContactSurface) -> _Touching:
    r_1, r_2 = float(one.radius or 0.0), float(two.radius or 0.0)
    start, end = _center(state, one), _center(state, two)
    distance = np.linalg.norm(end - start, axis=1)
    normal = (end - start) / np.where(distance > 0.0, distance, np.inf)[:, None]
    depth = r_1 + r_2 - distance
    return _Touching(normal, start + (r_1 - 0.5 * depth)[:, None] * normal, depth, r_1 * r_2 / (r_1 + r_2))


def _sphere_on_plane(state: Postures, plane: ContactSurface, sphere: ContactSurface) -> _Touching:
    normal = -(state.rotation_to_ground[:, plane.body] @ plane.placement.rotation)[:, :, 0]
    center, radius = _center(state, sphere), float(sphere.radius or 0.0)
    above = ((center - _center(state, plane)) * normal).sum(axis=1)
    depth = radius - above
    return _Touching(normal, center - (above + 0.5 * depth)[:, None] * normal, depth, radius)


def _center(state: Postures, surface: ContactSurface) -> Array:
    return points_in_ground(state, surface.body, surface.placement.translation)


def _joint_friction(first: float, second: float) -> float:
    """Harmonic mean of two coefficients."""
    return 2.0 * first * second / (first + second) if first + second else 0.0


@dataclass(frozen=True)
class SmoothContact:
    """Contact of a sphere with center `center` (3,) [m] in its body and the half-space x > 0 of a placement in another.

    material             of both; stiffness is that of the plane strain
    transition_velocity  of sliding [m/s]
    offset               under the square roots [m², m²/s²], OpenSim's constant_contact_force
    hertz_smoothing      [1/m];  speed_smoothing  [s/m]
    """

    name: str
    sphere_body: int
    center: Array
    radius: float
    plane_body: int
    plane: Placement
    material: ContactMaterial
    transition_velocity: float
    offset: float
    hertz_smoothing: float
    speed_smoothing: float

    def loads(self, model: Model, state: Postures) -> Loads:
        into_plane = (state.rotation_to_ground[:, self.plane_body] @ self.plane.rotation)[:, :, 0]
        center = points_in_ground(state, self.sphere_body, self.center)
        on_plane = points_in_ground(state, self.plane_body, self.plane.translation)
        depth = self.radius + ((center - on_plane) * into_plane).sum(axis=1)
        place = center + (self.radius - 0.5 * depth)[:, None] * into_plane
        sliding = velocity_at(state, self.sphere_body, place) - velocity_at(state, self.plane_body, place)
        approach = (sliding * into_plane).sum(axis=1)
        tangent = sliding - approach[:, None] * into_plane
        pressure = self._pressure(depth, approach)
        slip = np.sqrt((tangent**2).sum(axis=1) + self.offset)
        dry = _stribeck(self.material.static_friction, self.material.dynamic_friction, slip / self.transition_velocity)
        friction = pressure * (dry + self.material.viscous_friction * slip) / slip
        wrench = wrench_about_origin(place, pressure[:, None] * into_plane + friction[:, None] * tangent)
        wrenches, forces = no_loads(model, state)
        wrenches[:, self.sphere_body] -= wrench
        wrenches[:, self.plane_body] += wrench
        return wrenches, forces

    def _pressure(self, depth: Array, approach: Array) -> Array:
        k, c = 0.5 * self.material.stiffness ** (2 / 3), self.material.dissipation
        hertz = 4 / 3 * k * np.sqrt(self.radius * k) * (depth**2 + self.offset) ** 0.75
        pressure: Array = hertz * _rise(self.hertz_smoothing * depth) * (1.0 + 1.5 * c * approach)
        if c > 0.0:
            pressure *= _rise(self.speed_smoothing * (approach + 2.0 / (3.0 * c)))
        return pressure


def _stribeck(static: float, dynamic: float, relative: Array) -> Array:
    """Dry friction over the pressure, at a slip over the transition velocity."""
    return np.asarray(np.minimum(relative, 1.0) * (dynamic + 2.0 * (static - dynamic) / (1.0 + relative**2)))


def _rise(x: Array) -> Array:
    """From 0 to 1."""
    return np.asarray(0.5 + 0.5 * np.tanh(x))


@dataclass(frozen=True)
class CoordinateSpring:
    """−stiffness (q − rest_length) − viscosity u."""

    name: str
    coordinate: int
    stiffness: float
    rest_length: float
    viscosity: float

    def at(self, q: Array, u: Array) -> Array:
        return -self.stiffness * (q - self.rest_length) - self.viscosity * u


@dataclass(frozen=True)
class CoordinateLimit:
    """A spring and a damper beyond each limit, which come in over the transition by 10 t³ − 15 t⁴ + 6 t⁵.

    limits [rad or m], stiffnesses [N m/rad or N/m] of the lower and the upper side, damping [N m s/rad or N s/m]
    """

    name: str
    coordinate: int
    limits: tuple[float, float]
    stiffnesses: tuple[float, float]
    damping: float
    transition: float

    def at(self, q: Array, u: Array) -> Array:
        force = np.zeros_like(q)
        for sense, limit, stiffness in zip((-1.0, 1.0), self.limits, self.stiffnesses, strict=True):
            t = np.clip(sense * (q - limit) / self.transition, 0.0, 1.0)
            onset = t**3 * (10.0 + t * (6.0 * t - 15.0))
            force -= onset * (stiffness * (q - limit) + self.damping * u)
        return force


@dataclass(frozen=True)
class CoordinateExpression:
    """A formula in q and qdot, which is the speed u."""

    name: str
    coordinate: int
    expression: Expression

    def at(self, q: Array, u: Array) -> Array:
        return self.expression.at(q, u)


@dataclass(frozen=True, eq=False)
class _BetweenPoints(ABC):
    """A pull of two bodies towards each other, at point_1 (3,) [m] in the first and point_2 in the second."""

    name: str
    body_1: int
    body_2: int
    point_1: Array
    point_2: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, point_1=(3,), point_2=(3,))

    @abstractmethod
    def pull(self, distance: Array, speed: Array) -> Array:
        """(frames,) [N] for a distance (frames,) [m] of the points and its rate (frames,) [m/s]."""

    def loads(self, model: Model, state: Postures) -> Loads:
        """Not finite where the points coincide."""
        place_1 = points_in_ground(state, self.body_1, self.point_1)
        place_2 = points_in_ground(state, self.body_2, self.point_2)
        between = place_2 - place_1
        distance = np.linalg.norm(between, axis=1)
        relative = velocity_at(state, self.body_2, place_2) - velocity_at(state, self.body_1, place_1)
        with np.errstate(invalid="ignore", divide="ignore"):
            direction = between / distance[:, None]
            force = self.pull(distance, (relative * direction).sum(axis=1))[:, None] * direction
        wrenches, forces = no_loads(model, state)
        wrenches[:, self.body_1] += wrench_about_origin(place_1, force)
        wrenches[:, self.body_2] -= wrench_about_origin(place_2, force)
        return wrenches, forces


@dataclass(frozen=True, eq=False)
class PointToPointSpring(_BetweenPoints):
    """stiffness [N/m] times the distance beyond rest_length [m]; it also pushes."""

    stiffness: float
    rest_length: float

    def pull(self, distance: Array, speed: Array) -> Array:  # noqa: ARG002 (of every force between points)
        return self.stiffness * (distance - self.rest_length)


@dataclass(frozen=True, eq=False)
class PointToPointExpression(_BetweenPoints):
    """A formula in the distance d and its rate ddot."""

    expression: Expression

    def pull(self, distance: Array, speed: Array) -> Array:
        return self.expression.at(distance, speed)


@dataclass(frozen=True, eq=False)
class ConstantForce:
    """A constant force (3,) [N] at a point (3,) [m] of a body and a torque (3,) [N m], in its axes or ground's."""

    name: str
    body: int
    point: Array
    force: Array
    torque: Array
    is_point_in_ground: bool
    is_force_in_ground: bool

    def __post_init__(self) -> None:
        freeze_arrays(self, point=(3,), force=(3,), torque=(3,))

    def loads(self, model: Model, state: Postures) -> Loads:
        force, torque = (
            vector_to_ground(state, self.body, vector, is_in_ground=self.is_force_in_ground)
            for vector in (self.force, self.torque)
        )
        place = point_to_ground(state, self.body, self.point, is_in_ground=self.is_point_in_ground)
        wrenches, forces = no_loads(model, state)
        wrenches[:, self.body] += wrench_about_origin(place, force)
        wrenches[:, self.body, :3] += torque
        return wrenches, forces


@dataclass(frozen=True)
class _AlongPath(ABC):
    """Tension [N] of a path, in relation to its resting length [m]."""

    name: str
    path: Path
    resting_length: float

    @abstractmethod
    def tension(self, length: Array, speed: Array) -> Array:
        """(frames,) [N] for a length (frames,) [m] and its rate (frames,) [m/s]."""

    def loads(self, model: Model, state: Postures) -> Loads:
        paths = evaluate_paths(model, state, [self.path])
        tension = self.tension(paths.lengths[:, 0], paths.speeds[:, 0])
        wrench, mobility = paths.wrench_per_tension[:, 0], paths.mobility_per_tension[:, 0]
        return wrench * tension[:, None, None], mobility * tension[:, None]


@dataclass(frozen=True)
class PathSpring(_AlongPath):
    """Tension stiffness · stretch · (1 + dissipation · lengthening speed) beyond the resting length.

    stiffness [N/m], dissipation [s/m]. As in OpenSim, the tension of a stretched path that shortens fast is negative.
    """

    stiffness: float
    dissipation: float

    def tension(self, length: Array, speed: Array) -> Array:
        return self.stiffness * np.maximum(length - self.resting_length, 0.0) * (1.0 + self.dissipation * speed)


@dataclass(frozen=True)
class PathExpression(_AlongPath):
    """A formula in the stretch s [m] and the lengthening speed ldot [m/s].

    is_clamped  whether the stretch of a path below its resting length is zero rather than negative
    """

    expression: Expression
    is_clamped: bool = True

    def tension(self, length: Array, speed: Array) -> Array:
        stretch = length - self.resting_length
        return self.expression.at(np.maximum(stretch, 0.0) if self.is_clamped else stretch, speed)


@dataclass(frozen=True)
class Ligament(_AlongPath):
    """Tension force · curve(length / resting length) beyond the resting length."""

    force: float
    curve: Function

    def tension(self, length: Array, speed: Array) -> Array:  # noqa: ARG002 (of every force along a path)
        tension = self.force * self.curve.derivatives(length / self.resting_length)[0]
        return np.where(length > self.resting_length, tension, 0.0)


DAMPED_FROM = 0.01  # strain at which the damping of a Blankevoort1991Ligament is complete


@dataclass(frozen=True)
class BlankevoortLigament(_AlongPath):
    """Tension over the strain: quadratic up to the transition strain, then linear; damped while it lengthens.

    Blankevoort, Huiskes, J. Biomech. Eng. 113(3):263-269 (1991). The resting length is OpenSim's slack_length.

    stiffness  [N per unit strain];  damping [N s per unit strain]
    """

    stiffness: float
    transition_strain: float
    damping: float

    def tension(self, length: Array, speed: Array) -> Array:
        strain, rate = length / self.resting_length - 1.0, speed / self.resting_length
        toe = np.clip(strain, 0.0, self.transition_strain)
        quadratic = 0.5 * self.stiffness / self.transition_strain * toe**2 if self.transition_strain > 0.0 else 0.0
        linear = self.stiffness * np.maximum(strain - self.transition_strain, 0.0)
        t = np.clip(strain / DAMPED_FROM, 0.0, 1.0)
        damped = self.damping * np.maximum(rate, 0.0) * t**3 * (10.0 + t * (6.0 * t - 15.0))
        return quadratic + linear + damped


@dataclass(frozen=True, eq=False)
class _BetweenFrames(ABC):
    """damping (6,) about the axes [N m s/rad], then along them [N s/m]."""

    name: str
    body_1: int
    body_2: int
    frame_1: Placement
    frame_2: Placement
    damping: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, damping=(6,))

    @abstractmethod
    def elastic_force(self, displacement: Array) -> Array:
        """(frames, 6) moments and forces against a displacement (frames, 6)."""

    def loads(self, model: Model, state: Postures) -> Loads:
        one, two = self.body_1, self.body_2
        to_ground = state.rotation_to_ground[:, one] @ self.frame_1.rotation
        place = points_in_ground(state, two, self.frame_2.translation)
        lever = place - points_in_ground(state, one, self.frame_1.translation)
        to_frame = np.swapaxes(to_ground, 1, 2)
        angles = body_fixed_xyz_angles(to_frame @ state.rotation_to_ground[:, two] @ self.frame_2.rotation)
        turning = state.angular_velocity[:, two] - state.angular_velocity[:, one]
        sliding = velocity_at(state, two, place) - velocity_at(state, one, place)
        displacement = np.concatenate([angles, rotate(to_frame, lever)], axis=1)
        to_rates: Array = np.linalg.inv(angular_rates_matrix(angles))  # type: ignore[assignment]
        rates = np.concatenate([rotate(to_rates @ to_frame, turning), rotate(to_frame, sliding)], axis=1)
        force = -(self.elastic_force(displacement) + self.damping * rates)
        wrench = wrench_about_origin(place, rotate(to_ground, force[:, 3:]))
        wrench[:, :3] += rotate(to_ground @ np.swapaxes(to_rates, 1, 2), force[:, :3])
        wrenches, forces = no_loads(model, state)
        wrenches[:, two] += wrench
        wrenches[:, one] -= wrench
        return wrenches, forces


@dataclass(frozen=True, eq=False)
class Bushing(_BetweenFrames):
    """Linear springs: stiffness (6,) about the axes [N m/rad], then along them [N/m]."""

    stiffness: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        freeze_arrays(self, stiffness=(6,))

    def elastic_force(self, displacement: Array) -> Array:
        return self.stiffness * displacement


@dataclass(frozen=True, eq=False)
class FunctionBushing(_BetweenFrames):
    """Six functions of the displacement about and along their own axes [N m, N]."""

    functions: tuple[Function, ...]

    def elastic_force(self, displacement: Array) -> Array:
        return np.stack([f.derivatives(q)[0] for f, q in zip(self.functions, displacement.T, strict=True)], axis=1)


@dataclass(frozen=True, eq=False)
class ExpressionBushing(_BetweenFrames):
    """Six formulas of the whole displacement [N m, N]."""

    expressions: tuple[Expression, ...]

    def elastic_force(self, displacement: Array) -> Array:
        return np.stack([expression.at(*displacement.T) for expression in self.expressions], axis=1)


DISPLACEMENTS = ("theta_x", "theta_y", "theta_z", "delta_x", "delta_y", "delta_z")  # of an ExpressionBushing
