"""Forces that posture and speeds determine: springs, ligaments, contact. Loads of a given motion, not unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from solver.model import ActuatorOnBodies, Model
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


class LoadingActuator(Protocol):
    """An actuator of a model that acts on bodies: what Model.actuators holds besides CoordinateActuator."""

    def full_loads(self, model: Model, state: Postures) -> Loads:
        """The loads in a batch of postures, at a control of 1."""
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


def full_loads(actuators: Sequence[ActuatorOnBodies], model: Model, state: Postures) -> Loads:
    """Loads of each actuator at a control of 1: wrenches (frames, actuators, bodies, 6) and forces (frames, actuators,
    coordinates), as Loads.
    """
    found = [actuator.full_loads(model, state) for actuator in cast("Sequence[LoadingActuator]", actuators)]
    return np.stack([loads[0] for loads in found], axis=1), np.stack([loads[1] for loads in found], axis=1)
