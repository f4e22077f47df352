"""Springs and limits of coordinates in an OpenSim file."""

from __future__ import annotations

import numpy as np

from solver.functions.coordinate import polynomial, scaled, smooth_step, times_linear
from solver.model import CoordinateForce
from solver.osim.document import Element
from solver.osim.frames import Names

COORDINATE_FORCES = ("SpringGeneralizedForce", "CoordinateLimitForce")


def read_coordinate_force(element: Element, names: Names) -> list[CoordinateForce]:
    return _spring(element, names) if element.tag == "SpringGeneralizedForce" else _limits(element, names)


def _spring(element: Element, names: Names) -> list[CoordinateForce]:
    """-stiffness (q - rest) - viscosity u."""
    stiffness, viscosity = element.number("stiffness", "0"), element.number("viscosity", "0")
    force = polynomial([stiffness * element.number("rest_length", "0"), -stiffness])
    coordinate = names.coordinate(element, element.child("coordinate").text)
    return [CoordinateForce(element.name, coordinate, force, polynomial([-viscosity]))]


def _limits(element: Element, names: Names) -> list[CoordinateForce]:
    """Beyond each limit a spring and a damper that come in smoothly over the transition; the file has them in degrees.

    OpenSim takes degrees for coordinates that are angles, and the coordinate itself for all others.
    """
    coordinate = names.coordinate(element, element.child("coordinate").text)
    unit = np.pi / 180 if names.coordinates[coordinate].motion == "rotation" else 1.0
    transition, damping = element.number("transition", "0.1") * unit, element.number("damping", "0.001") / unit
    forces = []
    for side, sense in (("upper", 1.0), ("lower", -1.0)):
        limit, stiffness = element.number(f"{side}_limit", "0") * unit, element.number(f"{side}_stiffness", "1") / unit
        onset = smooth_step(limit, limit + sense * transition, 0.0, 1.0)
        force = times_linear(onset, -stiffness, stiffness * limit)
        forces.append(CoordinateForce(element.name, coordinate, force, scaled(onset, -damping)))
    return forces
