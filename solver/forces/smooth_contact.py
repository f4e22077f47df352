"""Smooth contact of a sphere and a half-space, for optimal control: OpenSim's SmoothSphereHalfSpaceForce.

Serrancolí et al., IEEE Trans. Neural Syst. Rehabil. Eng. 27(8):1591-1602 (2019): Hunt and Crossley's force with tanh in
place of its corners, so that a little force acts also without contact. Equations: Simbody's class of this name.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.forces.contact import ContactMaterial
from solver.model import Model, Placement
from solver.multibody.force_element import Loads, no_loads
from solver.multibody.postures import Postures, points_in_ground, velocity_at
from solver.multibody.rotations import wrench_about_origin

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SmoothContact:
    """Contact of a sphere with center `center` (3,) [m] in its body and the half-space x > 0 of a placement in another.

    material             of both; stiffness is that of the plane strain
    transition_velocity  of sliding [m/s]
    offset               under the square roots [m², m²/s²], OpenSim's constant_contact_force
    hertz_smoothing      [1/m];  speed_smoothing  [s/m]
    """

    name: str
    sphere_body: int
    center: Array
    radius: float
    plane_body: int
    plane: Placement
    material: ContactMaterial
    transition_velocity: float
    offset: float
    hertz_smoothing: float
    speed_smoothing: float

    def loads(self, model: Model, state: Postures) -> Loads:
        into_plane = (state.rotation_to_ground[:, self.plane_body] @ self.plane.rotation)[:, :, 0]
        center = points_in_ground(state, self.sphere_body, self.center)
        on_plane = points_in_ground(state, self.plane_body, self.plane.translation)
        depth = self.radius + ((center - on_plane) * into_plane).sum(axis=1)
        place = center + (self.radius - 0.5 * depth)[:, None] * into_plane
        sliding = velocity_at(state, self.sphere_body, place) - velocity_at(state, self.plane_body, place)
        approach = (sliding * into_plane).sum(axis=1)
        tangent = sliding - approach[:, None] * into_plane
        pressure = self._pressure(depth, approach)
        slip = np.sqrt((tangent**2).sum(axis=1) + self.offset)
        friction = pressure * self._friction_coefficient(slip) / slip
        wrench = wrench_about_origin(place, pressure[:, None] * into_plane + friction[:, None] * tangent)
        wrenches, forces = no_loads(model, state)
        wrenches[:, self.sphere_body] -= wrench
        wrenches[:, self.plane_body] += wrench
        return wrenches, forces

    def _pressure(self, depth: Array, approach: Array) -> Array:
        k, c = 0.5 * self.material.stiffness ** (2 / 3), self.material.dissipation
        hertz = 4 / 3 * k * np.sqrt(self.radius * k) * (depth**2 + self.offset) ** 0.75
        pressure: Array = hertz * _rise(self.hertz_smoothing * depth) * (1.0 + 1.5 * c * approach)
        if c > 0.0:
            pressure *= _rise(self.speed_smoothing * (approach + 2.0 / (3.0 * c)))
        return pressure

    def _friction_coefficient(self, slip: Array) -> Array:
        static, dynamic = self.material.static_friction, self.material.dynamic_friction
        relative = slip / self.transition_velocity
        dry: Array = np.minimum(relative, 1.0) * (dynamic + 2.0 * (static - dynamic) / (1.0 + relative**2))
        return dry + self.material.viscous_friction * slip


def _rise(x: Array) -> Array:
    """From 0 to 1."""
    rise: Array = 0.5 + 0.5 * np.tanh(x)
    return rise
