"""Contact of spheres and half-spaces by Hunt and Crossley, as OpenSim's HuntCrossleyForce.

Hunt, Crossley, J. Appl. Mech. 42(2):440-445 (1975): Hertz's force times 1 + 3/2 c v; friction by Stribeck's curve.
Equations: Simbody's HuntCrossleyForce, with its rules for two materials.

SmoothContact is OpenSim's SmoothSphereHalfSpaceForce, for optimal control. Serrancolí et al., IEEE Trans. Neural Syst.
Rehabil. Eng. 27(8):1591-1602 (2019): Hunt and Crossley's force with tanh in place of its corners, so that a little
force acts also without contact. Equations: Simbody's class of this name.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from solver.model import Model, Placement
from solver.multibody.loads import Loads, no_loads
from solver.multibody.postures import Postures, points_in_ground, velocity_at
from solver.multibody.rotations import wrench_about_origin

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactMaterial:
    """stiffness [N/m²] of the plane strain, dissipation [s/m]; friction: static, dynamic [1], viscous [s/m]."""

    stiffness: float
    dissipation: float
    static_friction: float
    dynamic_friction: float
    viscous_friction: float


@dataclass(frozen=True)
class ContactSurface:
    """A sphere about the origin of its placement in a body, or the half-space x > 0 there (radius None)."""

    body: int
    placement: Placement
    radius: float | None
    material: ContactMaterial


@dataclass(frozen=True)
class HuntCrossleyContact:
    """Contact of every pair of the surfaces, except two half-spaces.

    transition_velocity  of sliding [m/s], at which friction is greatest
    """

    name: str
    surfaces: tuple[ContactSurface, ...]
    transition_velocity: float

    def loads(self, model: Model, state: Postures) -> Loads:
        wrenches, forces = no_loads(model, state)
        for one, two in self._pairs():
            touching = _sphere_on_sphere(state, one, two) if one.radius else _sphere_on_plane(state, one, two)
            with np.errstate(invalid="ignore", divide="ignore"):  # in frames without contact
                wrench = self._wrench(state, one, two, touching)
            wrench[~(touching.depth > 0.0)] = 0.0
            wrenches[:, one.body] -= wrench
            wrenches[:, two.body] += wrench
        return wrenches, forces

    def _pairs(self) -> Iterator[tuple[ContactSurface, ContactSurface]]:
        """A half-space comes before a sphere."""
        ordered = sorted(self.surfaces, key=lambda surface: surface.radius is not None)
        return ((one, two) for one, two in combinations(ordered, 2) if two.radius is not None)

    def _wrench(self, state: Postures, one: ContactSurface, two: ContactSurface, touching: _Touching) -> Array:
        """(frames, 6) on the second body."""
        first, second = one.material, two.material
        k_1, k_2 = (material.stiffness ** (2 / 3) for material in (first, second))
        share = k_2 / (k_1 + k_2)
        place = touching.middle + ((0.5 - share) * touching.depth)[:, None] * touching.normal
        k, c = k_1 * share, first.dissipation * share + second.dissipation * (1.0 - share)
        hertz = 4 / 3 * k * touching.depth * np.sqrt(touching.radius * k * touching.depth)
        sliding = velocity_at(state, one.body, place) - velocity_at(state, two.body, place)
        approach = (sliding * touching.normal).sum(axis=1)
        pressure = np.maximum(hertz * (1.0 + 1.5 * c * approach), 0.0)
        tangent = sliding - approach[:, None] * touching.normal
        slip = np.linalg.norm(tangent, axis=1)
        friction = pressure * self._friction_coefficient(first, second, slip) / np.where(slip > 0.0, slip, 1.0)
        return wrench_about_origin(place, pressure[:, None] * touching.normal + friction[:, None] * tangent)

    def _friction_coefficient(self, first: ContactMaterial, second: ContactMaterial, slip: Array) -> Array:
        static = _joint_friction(first.static_friction, second.static_friction)
        dynamic = _joint_friction(first.dynamic_friction, second.dynamic_friction)
        viscous = _joint_friction(first.viscous_friction, second.viscous_friction)
        relative = slip / self.transition_velocity
        dry = np.minimum(relative, 1.0) * (dynamic + 2.0 * (static - dynamic) / (1.0 + relative**2))
        return dry + viscous * slip


@dataclass(frozen=True)
class _Touching:
    """Normal (frames, 3) towards the second surface, middle (frames, 3) of the overlap, its depth (frames,) [m], and
    the effective radius of curvature [m]; everything in ground.
    """

    normal: Array
    middle: Array
    depth: Array
    radius: float


def _sphere_on_sphere(state: Postures, one: ContactSurface, two: ContactSurface) -> _Touching:
    r_1, r_2 = float(one.radius or 0.0), float(two.radius or 0.0)
    start, end = _center(state, one), _center(state, two)
    distance = np.linalg.norm(end - start, axis=1)
    normal = (end - start) / np.where(distance > 0.0, distance, np.inf)[:, None]
    depth = r_1 + r_2 - distance
    return _Touching(normal, start + (r_1 - 0.5 * depth)[:, None] * normal, depth, r_1 * r_2 / (r_1 + r_2))


def _sphere_on_plane(state: Postures, plane: ContactSurface, sphere: ContactSurface) -> _Touching:
    normal = -(state.rotation_to_ground[:, plane.body] @ plane.placement.rotation)[:, :, 0]
    center, radius = _center(state, sphere), float(sphere.radius or 0.0)
    above = ((center - _center(state, plane)) * normal).sum(axis=1)
    depth = radius - above
    return _Touching(normal, center - (above + 0.5 * depth)[:, None] * normal, depth, radius)


def _center(state: Postures, surface: ContactSurface) -> Array:
    offset = state.rotation_to_ground[:, surface.body] @ surface.placement.translation
    center: Array = state.origin_in_ground[:, surface.body] + offset
    return center


def _joint_friction(first: float, second: float) -> float:
    """Harmonic mean of two coefficients."""
    return 2.0 * first * second / (first + second) if first + second else 0.0


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
