"""Forces at points of bodies: OpenSim's PointToPointSpring, ExpressionBasedPointToPointForce, and PrescribedForce if it
is constant.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.frozen import freeze_arrays
from solver.functions.expression import Expression
from solver.model import Model
from solver.multibody.force_element import Loads, no_loads
from solver.multibody.postures import Postures, points_in_ground, velocity_at
from solver.multibody.rotations import wrench_about_origin

Array = NDArray[np.float64]


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
