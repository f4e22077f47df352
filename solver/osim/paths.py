"""Paths and the surfaces they wrap over, in an OpenSim file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import (
    AnyPathPoint,
    ConditionalPathPoint,
    MovingPathPoint,
    Path,
    PathPoint,
    PathWrap,
    Placement,
    SurfaceKind,
    WrapSurface,
)
from solver.multibody.rotations import rotation_body_fixed_xyz
from solver.osim.document import Element
from solver.osim.frames import Names, OffsetFrame
from solver.osim.functions import read_function

Array = NDArray[np.float64]


def geometry_path(element: Element) -> Element:
    """The GeometryPath of a force. ModelError for a path whose length is a function of coordinates."""
    if has_function_path(element):
        raise element.refusal(
            "has a FunctionBasedPath, whose length is a function of coordinates and which the solver does not support; "
            "replace it by a GeometryPath, or read the model without such forces (ignore_forces, --ignore-forces)",
            SolverCode.UNSUPPORTED,
        )
    return element.child("GeometryPath")


def has_function_path(element: Element) -> bool:
    return element.find("FunctionBasedPath") is not None


def read_path(element: Element, names: Names, surfaces: Sequence[WrapSurface]) -> Path:
    points = element.objects("PathPointSet")
    if len(points) < 2:
        raise element.refusal(f"has {len(points)} points, expected at least 2: its ends", SolverCode.WRONG_PATH)
    return Path(
        points=tuple(_point(point, names) for point in points),
        wraps=tuple(_wrap(wrap, surfaces) for wrap in element.objects("PathWrapSet")),
    )


_SURFACES = ("WrapEllipsoid", "WrapSphere", "WrapCylinder", "WrapTorus")
_SIDES = ("all", "x", "+x", "-x", "y", "+y", "-y", "z", "+z", "-z")


def read_surface(frame: OffsetFrame, element: Element) -> WrapSurface:
    """The wrap object that a body or a frame in it holds."""
    if element.tag not in _SURFACES:
        raise element.unsupported("wrap object", ", ".join(_SURFACES))
    quadrant = element.word("quadrant", "all").lower().replace("unassigned", "all")
    if quadrant not in _SIDES:
        raise element.refusal(f"has the quadrant {quadrant}; the solver supports {', '.join(_SIDES)}")
    outer = frame.placement
    rotation = rotation_body_fixed_xyz(element.numbers("xyz_body_rotation", 3, "0 0 0"))
    center = outer.translation + outer.rotation @ element.numbers("translation", 3, "0 0 0")
    placement = Placement(outer.rotation @ rotation, center)
    kind, dimensions = _shape(element)
    is_active = element.flag("active", "true")
    return WrapSurface(element.name, frame.body, placement, kind, dimensions, quadrant, is_active)


def _shape(element: Element) -> tuple[SurfaceKind, Array]:
    if element.tag == "WrapEllipsoid":
        return "ellipsoid", element.numbers("dimensions", 3, "0.05 0.05 0.05")
    if element.tag == "WrapSphere":
        return "sphere", np.full(3, element.positive("radius", "0.05"))
    if element.tag == "WrapTorus":
        return "torus", np.array(
            [element.positive("inner_radius", "0.01"), element.positive("outer_radius", "0.05"), 0.0]
        )
    radius = element.positive("radius", "1")
    return "cylinder", np.array([radius, radius, element.number("length", "1")])


def _point(element: Element, names: Names) -> AnyPathPoint:
    if element.tag == "PathPoint":
        return PathPoint(*names.station(element, "socket_parent_frame", "location"))
    if element.tag == "ConditionalPathPoint":
        body, location = names.station(element, "socket_parent_frame", "location")
        coordinate = names.coordinate(element, element.child("socket_coordinate").text)
        lowest, highest = element.numbers("range", 2, "0 0", may_be_infinite=True)
        return ConditionalPathPoint(body, location, coordinate, (float(lowest), float(highest)))
    if element.tag != "MovingPathPoint":
        raise element.unsupported("path point", "PathPoint, MovingPathPoint, ConditionalPathPoint")
    frame = names.frame(element, "socket_parent_frame")
    drivers = {element.child(f"socket_{axis}_coordinate").text for axis in "xyz"}
    if len(drivers) != 1:
        raise element.refusal(
            "depends on several coordinates, with which OpenSim 4.6 does not open the model; use one",
            SolverCode.UNSUPPORTED,
        )
    coordinate = names.coordinate(element, drivers.pop())
    x, y, z = (read_function(element.child(f"{axis}_location")) for axis in "xyz")
    return MovingPathPoint(frame.body, frame.placement, coordinate, (x, y, z), names.coordinates[coordinate].range)


def _wrap(element: Element, surfaces: Sequence[WrapSurface]) -> PathWrap:
    name = element.child("wrap_object").text
    names = [surface.name for surface in surfaces]
    if name not in names:
        raise element.refusal(f"names an unknown wrap object {name}", SolverCode.UNKNOWN_NAME)
    first, last = (int(number) for number in element.numbers("range", 2, "-1 -1"))
    method = element.word("method", "hybrid")
    if method not in ("hybrid", "midpoint", "axial"):
        raise element.refusal(
            f"has the method {method}; the solver supports hybrid, midpoint and axial", SolverCode.UNSUPPORTED
        )
    # The file counts points from 1; a smaller number means the end of the path.
    return PathWrap(names.index(name), method, max(first, 1) - 1, last - 1 if last > 0 else None)  # type: ignore[arg-type]
