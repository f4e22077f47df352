"""External forces on bodies of a model over time, as OpenSim's ExternalForce: of a handle or a rope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.multibody.postures import Postures
from solver.multibody.rotations import rotate, wrench_about_origin

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ExternalForce:
    """External force and torque on a body in every frame.

    body    index of the body it acts on
    axes    index of the body in whose axes force and torque are given
    force   (frames, 3) [N];  torque (frames, 3) [N m]
    origin  index of the body from whose origin, and in whose axes, the point is given
    point   (frames, 3) [m] where the force acts
    """

    name: str
    body: int
    axes: int
    force: Array
    torque: Array
    origin: int
    point: Array

    def points_in_ground(self, state: Postures) -> Array:
        """(frames, 3) [m] where the force acts."""
        return state.origin_in_ground[:, self.origin] + rotate(state.rotation_to_ground[:, self.origin], self.point)

    def decimate(self, every: int) -> ExternalForce:
        """In every N-th frame, the first included."""
        return self.cut(slice(None, None, every))

    def cut(self, frames: slice) -> ExternalForce:
        """In these frames alone."""
        return replace(self, force=self.force[frames], torque=self.torque[frames], point=self.point[frames])


def load_wrenches(loads: Sequence[ExternalForce], state: Postures) -> Array:
    """(frames, bodies, 6) moment about the ground origin [N m] and force [N] on each body, in ground."""
    wrenches = np.zeros((*state.origin_in_ground.shape[:2], 6))
    for load in loads:
        to_ground = state.rotation_to_ground[:, load.axes]
        wrenches[:, load.body] += wrench_about_origin(load.points_in_ground(state), rotate(to_ground, load.force))
        wrenches[:, load.body, :3] += rotate(to_ground, load.torque)
    return wrenches
