"""Where the bodies are and how they move: batched postures and Jacobians of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Postures:
    """Poses and velocities of all bodies in a batch of frames; everything in ground, SI; body 0 is the ground itself.

    coordinates         (frames, coordinates) q
    speeds              (frames, coordinates) u, conjugate to q except on the scapula, where u₁…u₃ are the components of
                        an angular velocity in the joint's parent frame
    rotation_to_ground  (frames, bodies, 3, 3) turns body vectors into ground vectors
    origin_in_ground    (frames, bodies, 3) body origins
    angular_velocity    (frames, bodies, 3)
    origin_velocity     (frames, bodies, 3) velocity of the body origins
    """

    coordinates: Array
    speeds: Array
    rotation_to_ground: Array
    origin_in_ground: Array
    angular_velocity: Array
    origin_velocity: Array
