"""Bushings between two frames: OpenSim's BushingForce, FunctionBasedBushingForce and ExpressionBasedBushingForce.

The displacement of frame 2 from frame 1 is q: the body-fixed x-y-z angles of frame 2 in frame 1 and the position of its
origin there [rad, m]. Force and moment act against q, by axis; equations of Simbody's Force::LinearBushing. They are
singular where the second angle is a right angle.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.frozen import freeze_arrays
from solver.functions.coordinate import Function
from solver.functions.expression import Expression
from solver.model import Model, Placement
from solver.multibody.force_element import Loads, no_loads
from solver.multibody.postures import Postures, velocity_at
from solver.multibody.rotations import angular_rates_matrix, body_fixed_xyz_angles, rotate, wrench_about_origin

Array = NDArray[np.float64]


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
