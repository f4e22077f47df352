"""Passive forces on coordinates, between points, along paths and between frames.

On a coordinate: springs, limits and formulas (OpenSim's SpringGeneralizedForce,
CoordinateLimitForce, ExpressionBasedCoordinateForce).

Each gives a force (frames,) [N or N m] for values q (frames,) [rad or m] and speeds u (frames,) of its coordinate.

Forces at points of bodies: OpenSim's PointToPointSpring, ExpressionBasedPointToPointForce, and PrescribedForce if it
is constant.

Springs and ligaments along a path: OpenSim's PathSpring, ExpressionBasedPathForce, Ligament and
Blankevoort1991Ligament.

Bushings between two frames: OpenSim's BushingForce, FunctionBasedBushingForce and ExpressionBasedBushingForce.

The displacement of frame 2 from frame 1 is q: the body-fixed x-y-z angles of frame 2 in frame 1 and the position of its
origin there [rad, m]. Force and moment act against q, by axis; equations of Simbody's Force::LinearBushing. They are
singular where the second angle is a right angle.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.checks import freeze_arrays
from solver.functions.coordinate_functions import Expression, Function
from solver.model import Model, Path, Placement
from solver.multibody.loads import Loads, no_loads
from solver.multibody.postures import Postures, points_in_ground, velocity_at
from solver.multibody.rotations import angular_rates_matrix, body_fixed_xyz_angles, rotate, wrench_about_origin
from solver.paths import evaluate_paths

Array = NDArray[np.float64]


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
    """stiffness [N/m] times what the distance is beyond rest_length [m]; it also pushes."""

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
        frames = (len(state.coordinates), 3)
        turned = state.rotation_to_ground[:, self.body]
        force, torque = (
            np.broadcast_to(part, frames) if self.is_force_in_ground else turned @ part
            for part in (self.force, self.torque)
        )
        place = points_in_ground(state, self.body, self.point)
        wrenches, forces = no_loads(model, state)
        wrench = wrench_about_origin(np.broadcast_to(self.point, frames) if self.is_point_in_ground else place, force)
        wrench[:, :3] += torque
        wrenches[:, self.body] += wrench
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
        return (
            paths.wrench_per_tension[:, 0] * tension[:, None, None],
            paths.mobility_per_tension[:, 0] * tension[:, None],
        )


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


DAMPED_FROM = 0.01
"""Strain at which the damping of a Blankevoort1991Ligament is complete."""


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
        place = _origin(state, two, self.frame_2)
        lever = place - _origin(state, one, self.frame_1)
        to_frame = np.swapaxes(to_ground, 1, 2)
        angles = body_fixed_xyz_angles(to_frame @ state.rotation_to_ground[:, two] @ self.frame_2.rotation)
        rates_matrix = angular_rates_matrix(angles)
        turning = state.angular_velocity[:, two] - state.angular_velocity[:, one]
        sliding = velocity_at(state, two, place) - velocity_at(state, one, place)
        displacement = np.concatenate([angles, rotate(to_frame, lever)], axis=1)
        to_rates: Array = np.linalg.inv(rates_matrix)  # type: ignore[assignment]
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
        columns = [function.derivatives(q)[0] for function, q in zip(self.functions, displacement.T, strict=True)]
        return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class ExpressionBushing(_BetweenFrames):
    """Six formulas of the whole displacement [N m, N]."""

    expressions: tuple[Expression, ...]

    def elastic_force(self, displacement: Array) -> Array:
        return np.stack([expression.at(*displacement.T) for expression in self.expressions], axis=1)


DISPLACEMENTS = ("theta_x", "theta_y", "theta_z", "delta_x", "delta_y", "delta_z")
"""Variables of an ExpressionBushing, in the order of the displacement."""


def _origin(state: Postures, body: int, frame: Placement) -> Array:
    place: Array = state.origin_in_ground[:, body] + state.rotation_to_ground[:, body] @ frame.translation
    return place
