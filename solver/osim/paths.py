"""Paths and the surfaces they wrap over, in an OpenSim file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.functions import PiecewisePolynomial
from solver.model import NO_COORDINATE, Path, PathPoint, PathWrap, Placement, WrapSurface
from solver.osim.document import Element
from solver.osim.frames import Names
from solver.osim.functions import read_function
from solver.spatial import rotation_body_fixed_xyz

Array = NDArray[np.float64]


def read_path(element: Element, names: Names, surfaces: list[WrapSurface]) -> Path:
    return Path(
        points=tuple(_point(point, names) for point in element.objects("PathPointSet")),
        wraps=tuple(_wrap(wrap, surfaces) for wrap in element.objects("PathWrapSet")),
    )


_SIDES = {
    "WrapEllipsoid": ("all",),
    "WrapSphere": ("all",),
    "WrapCylinder": ("all", "+x", "-x", "+y", "-y"),
}


def read_surface(body: int, element: Element) -> WrapSurface:
    if element.tag not in _SIDES:
        raise element.unsupported("wrap object", ", ".join(_SIDES))
    element.require("active", "true")
    quadrant = element.word("quadrant", "all")
    if quadrant not in _SIDES[element.tag]:
        raise element.refusal(f"has the quadrant {quadrant}; the solver has {', '.join(_SIDES[element.tag])}")
    rotation = rotation_body_fixed_xyz(element.numbers("xyz_body_rotation", 3, "0 0 0"))
    placement = Placement(rotation, element.numbers("translation", 3, "0 0 0"))
    if element.tag == "WrapEllipsoid":
        return WrapSurface(element.name, body, placement, "ellipsoid", element.numbers("dimensions", 3), quadrant)
    radius = element.number("radius")
    if element.tag == "WrapSphere":
        return WrapSurface(element.name, body, placement, "sphere", np.full(3, radius), quadrant)
    dimensions = np.array([radius, radius, element.number("length")])
    return WrapSurface(element.name, body, placement, "cylinder", dimensions, quadrant)


def _point(element: Element, names: Names) -> PathPoint:
    if element.tag == "PathPoint":
        body, location = names.station(element, "socket_parent_frame", "location")
        return PathPoint(body, location, np.zeros(3), NO_COORDINATE, (-np.inf, np.inf))
    if element.tag != "MovingPathPoint":
        raise element.unsupported("path point", "PathPoint, MovingPathPoint")
    frame = names.frame(element, "socket_parent_frame")
    drivers = {element.child(f"socket_{axis}_coordinate").text for axis in "xyz"}
    if len(drivers) != 1:
        raise element.refusal("follows several coordinates; the solver's moving points follow one")
    coordinate = names.coordinate(element, drivers.pop())
    lines = np.array([_line(element.child(f"{axis}_location")) for axis in "xyz"])
    rotation, translation = frame.placement.rotation, frame.placement.translation
    location, slope = translation + rotation @ lines[:, 1], rotation @ lines[:, 0]
    return PathPoint(frame.body, location, slope, coordinate, names.coordinates[coordinate].range)


def _line(holder: Element) -> tuple[float, float]:
    """Slope and offset of a function that is a straight line."""
    function = read_function(holder)
    if not isinstance(function, PiecewisePolynomial) or not (function.coefficients.shape <= (1, 2)):
        raise holder.refusal("is not a straight line; the solver's moving points move along lines")
    offset, slope, _ = (values[0] for values in function.derivatives(np.array([0.0])))
    return float(slope), float(offset)


def _wrap(element: Element, surfaces: list[WrapSurface]) -> PathWrap:
    name = element.child("wrap_object").text
    names = [surface.name for surface in surfaces]
    if name not in names:
        raise element.refusal(f"names an unknown wrap object {name}")
    if not np.all(element.numbers("range", 2, "-1 -1") == -1.0):
        raise element.refusal("wraps only a range of points; the solver wraps whole paths (range -1 -1)")
    method = element.word("method", "hybrid")
    if method not in ("hybrid", "midpoint", "axial"):
        raise element.refusal(f"has the method {method}; the solver has hybrid, midpoint and axial")
    return PathWrap(names.index(name), method)  # type: ignore[arg-type]
