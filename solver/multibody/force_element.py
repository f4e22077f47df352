"""Forces that posture and speeds determine: springs, ligaments, contact. Loads of a given motion, not unknowns."""

from __future__ import annotations

from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from solver.model import Model
from solver.multibody.postures import Postures

Array = NDArray[np.float64]

Loads = tuple[Array, Array]
"""Wrenches (frames, bodies, 6), moment about the ground origin [N m] and force [N] on each body, in ground; and forces
(frames, coordinates) [N, N m] that act on coordinates and on no body."""


class ForceElement(Protocol):
    """A force element of a model: what Model.forces holds."""

    @property
    def name(self) -> str: ...

    def loads(self, model: Model, state: Postures) -> Loads:
        """The loads in a batch of postures."""
        ...


def no_loads(model: Model, state: Postures) -> Loads:
    frames = len(state.coordinates)
    return np.zeros((frames, len(model.bodies), 6)), np.zeros((frames, len(model.coordinates)))


def total_loads(model: Model, state: Postures) -> Loads:
    """The loads of all force elements of the model."""
    wrenches, forces = no_loads(model, state)
    for element in cast("tuple[ForceElement, ...]", model.forces):
        on_bodies, on_coordinates = element.loads(model, state)
        wrenches += on_bodies
        forces += on_coordinates
    return wrenches, forces
