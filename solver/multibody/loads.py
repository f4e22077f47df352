"""Loads of a given motion on the bodies of a model.

ExternalLoad is a force over time, as OpenSim's ExternalForce: of a handle or a rope. ForceElement is a force that
posture and speeds determine: a spring, a ligament, contact. LoadWrenches keep the wrenches of many loads that each act
on few bodies, as muscles do: only those that are not zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from solver.model import ActuatorOnBodies, Array, Model
from solver.multibody.postures import Postures, rotate, wrench_about_origin

Loads = tuple[Array, Array]
"""Wrenches (frames, bodies, 6), moment about the ground origin [N m] and force [N] on each body, in ground; and forces
(frames, coordinates) [N, N m] that act on coordinates and on no body."""
Indices = NDArray[np.int64]


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


class ForceElement(Protocol):
    """A force element of a model, as in Model.forces."""

    @property
    def name(self) -> str: ...

    def loads(self, model: Model, state: Postures) -> Loads:
        """The loads in a batch of postures."""
        ...


class LoadingActuator(Protocol):
    """An actuator of a model that acts on bodies, in Model.actuators beside CoordinateActuator."""

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


@dataclass(frozen=True, eq=False)
class LoadWrenches:
    """A sparse array (frames, loads, bodies, 6) in coordinate format.

    values  (frames, wrenches, 6) moment about the ground's origin [N m] and force [N], in ground
    load    (wrenches,) the load that each of them belongs to;  body (wrenches,) the body that it acts on
    loads, bodies  how many there are
    """

    values: Array
    load: Indices
    body: Indices
    loads: int
    bodies: int

    def dense(self) -> Array:
        """(frames, loads, bodies, 6)."""
        wrenches = np.zeros((len(self.values), self.loads, self.bodies, 6))
        wrenches[:, self.load, self.body] = self.values
        return wrenches

    def total(self, factors: Array) -> Array:
        """(frames, bodies, 6) sum of the loads times their factors (frames, loads)."""
        values = self.values * factors[:, self.load, None]
        wrenches = [values[:, self.body == body].sum(axis=1) for body in range(self.bodies)]
        return np.stack(wrenches, axis=1)


def on_all_bodies(wrenches: Array) -> LoadWrenches:
    """Of a dense array (frames, loads, bodies, 6)."""
    frames, loads, bodies, _ = wrenches.shape
    load, body = np.divmod(np.arange(loads * bodies), bodies)
    return LoadWrenches(wrenches.reshape(frames, loads * bodies, 6), load, body, loads, bodies)
