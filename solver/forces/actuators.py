"""Actuators between bodies: OpenSim's PathActuator, PointActuator, TorqueActuator and PointToPointActuator.

Each is an unknown of the redundancy problem, like a CoordinateActuator: its control times its load at a control of 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from solver.checks import freeze_arrays
from solver.model import Array, Model, Path
from solver.multibody.loads import Loads, no_loads
from solver.multibody.postures import Postures, point_to_ground, vector_to_ground, wrench_about_origin
from solver.muscle import evaluate_paths


@dataclass(frozen=True, kw_only=True)
class _Actuator:
    """optimal_force is the size of the load [unit] at a control of 1."""

    name: str
    optimal_force: float
    min_control: float = -np.inf
    max_control: float = np.inf
    unit: ClassVar[Literal["N", "N m"]] = "N"


@dataclass(frozen=True, kw_only=True)
class PathActuator(_Actuator):
    """Tension along a path. As in OpenSim, a negative control pushes."""

    path: Path

    def full_loads(self, model: Model, state: Postures) -> Loads:
        paths = evaluate_paths(model, state, [self.path])
        force = self.optimal_force
        return force * paths.wrench_per_tension[:, 0], force * paths.mobility_per_tension[:, 0]


@dataclass(frozen=True, kw_only=True, eq=False)
class PointActuator(_Actuator):
    """Force on a body at a point (3,) [m], along a unit direction (3,), each in the body or in ground."""

    body: int
    point: Array
    direction: Array
    is_point_in_ground: bool = False
    is_direction_in_ground: bool = False

    def __post_init__(self) -> None:
        freeze_arrays(self, point=(3,), direction=(3,))

    def full_loads(self, model: Model, state: Postures) -> Loads:
        place = point_to_ground(state, self.body, self.point, is_in_ground=self.is_point_in_ground)
        direction = vector_to_ground(state, self.body, self.direction, is_in_ground=self.is_direction_in_ground)
        wrenches, forces = no_loads(model, state)
        wrenches[:, self.body] = wrench_about_origin(place, self.optimal_force * direction)
        return wrenches, forces


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueActuator(_Actuator):
    """Moment on body_a about a unit axis (3,), in body_a or in ground, and the opposite one on body_b."""

    body_a: int
    body_b: int
    axis: Array
    is_axis_in_ground: bool = True
    unit: ClassVar[Literal["N", "N m"]] = "N m"

    def __post_init__(self) -> None:
        freeze_arrays(self, axis=(3,))

    def full_loads(self, model: Model, state: Postures) -> Loads:
        moment = self.optimal_force * vector_to_ground(
            state, self.body_a, self.axis, is_in_ground=self.is_axis_in_ground
        )
        wrenches, forces = no_loads(model, state)
        wrenches[:, self.body_a, :3] += moment
        wrenches[:, self.body_b, :3] -= moment
        return wrenches, forces


@dataclass(frozen=True, kw_only=True, eq=False)
class PointToPointActuator(_Actuator):
    """Force on body_a at point_a (3,) [m], away from point_b, and the opposite one on body_b there.

    are_points_in_ground  whether the points are places in ground; otherwise each is in its body
    """

    body_a: int
    body_b: int
    point_a: Array
    point_b: Array
    are_points_in_ground: bool = False

    def __post_init__(self) -> None:
        freeze_arrays(self, point_a=(3,), point_b=(3,))

    def full_loads(self, model: Model, state: Postures) -> Loads:
        """Not finite where the points coincide."""
        place_a = point_to_ground(state, self.body_a, self.point_a, is_in_ground=self.are_points_in_ground)
        place_b = point_to_ground(state, self.body_b, self.point_b, is_in_ground=self.are_points_in_ground)
        between = place_a - place_b
        with np.errstate(invalid="ignore", divide="ignore"):
            force = self.optimal_force * between / np.linalg.norm(between, axis=1, keepdims=True)
        wrenches, forces = no_loads(model, state)
        wrenches[:, self.body_a] += wrench_about_origin(place_a, force)
        wrenches[:, self.body_b] -= wrench_about_origin(place_b, force)
        return wrenches, forces
