"""A bushing: springs and dampers between two frames, along and about their axes (OpenSim's BushingForce)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.frozen import freeze_arrays
from solver.model import Model, Placement
from solver.multibody.force_element import Loads, no_loads
from solver.multibody.postures import Postures, velocity_at
from solver.multibody.rotations import angular_rates_matrix, body_fixed_xyz_angles, rotate, wrench_about_origin

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bushing:
    """Force and moment on frame 2 against its displacement q from frame 1: −(k q + c q̇) by axis.

    q are the body-fixed x-y-z angles of frame 2 in frame 1 and the position of its origin there; Simbody's
    Force::LinearBushing. It is singular where the second angle is a right angle.

    stiffness, damping  (6,) about the axes [N m/rad, N m s/rad], then along them [N/m, N s/m]
    """

    name: str
    body_1: int
    body_2: int
    frame_1: Placement
    frame_2: Placement
    stiffness: Array
    damping: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, stiffness=(6,), damping=(6,))

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
        force = -(self.stiffness * displacement + self.damping * rates)
        wrench = wrench_about_origin(place, rotate(to_ground, force[:, 3:]))
        wrench[:, :3] += rotate(to_ground @ np.swapaxes(to_rates, 1, 2), force[:, :3])
        wrenches, forces = no_loads(model, state)
        wrenches[:, two] += wrench
        wrenches[:, one] -= wrench
        return wrenches, forces


def _origin(state: Postures, body: int, frame: Placement) -> Array:
    place: Array = state.origin_in_ground[:, body] + state.rotation_to_ground[:, body] @ frame.translation
    return place
