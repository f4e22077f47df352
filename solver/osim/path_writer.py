"""Paths in an OpenSim document."""

from __future__ import annotations

import xml.etree.ElementTree as Xml

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import AnyPathPoint, ConditionalPathPoint, Model, ModelError, Path, PathPoint
from solver.osim.function_writer import add_function
from solver.osim.xml_elements import add, add_values, frame_of, objects_of

Array = NDArray[np.float64]


def add_path(force: Xml.Element) -> Xml.Element:
    """Add a path without points; returns the element that holds its points."""
    return add(add(add(force, "GeometryPath", "path"), "PathPointSet"), "objects")


def add_path_point(points: Xml.Element, name: str, frame: str, location: Array) -> None:
    add_values(add(points, "PathPoint", name), socket_parent_frame=frame, location=location)


def add_whole_path(force: Xml.Element, model: Model, path: Path, name: str) -> None:
    """Add a path with its points and surfaces; name is that of the muscle or force."""
    points = add_path(force)
    for index, point in enumerate(path.points, start=1):
        _add_point(points, model, point, f"{name}-P{index}")
    wraps = objects_of(force[0], "PathWrapSet")
    for index, wrap in enumerate(path.wraps, start=1):
        its = add(wraps, "PathWrap", f"{name}-wrap{index}")
        surface, span = model.surfaces[wrap.surface].name, (wrap.first + 1, -1 if wrap.last is None else wrap.last + 1)
        add_values(its, wrap_object=surface, method=wrap.method, range=span)


def _add_point(points: Xml.Element, model: Model, point: AnyPathPoint, name: str) -> None:
    frame = frame_of(model.bodies, point.body)
    if isinstance(point, PathPoint):
        add_path_point(points, name, frame, point.location)
        return
    coordinate = _coordinate_path(model, point.coordinate)
    if isinstance(point, ConditionalPathPoint):
        made = add(points, "ConditionalPathPoint", name)
        add_values(made, socket_parent_frame=frame, location=point.location)
        add_values(made, socket_coordinate=coordinate, range=point.range)
        return
    placement = point.placement
    if not (np.array_equal(placement.rotation, np.eye(3)) and not placement.translation.any()):
        raise ModelError(
            f"the writer of .osim supports fixed points and ones that move in a body's frame, and {name} is neither",
            SolverCode.NOT_WRITABLE,
        )
    made = add(points, "MovingPathPoint", name)
    add_values(made, socket_parent_frame=frame)
    for axis, function in zip("xyz", point.functions, strict=True):
        add_values(made, **{f"socket_{axis}_coordinate": coordinate})
        add_function(add(made, f"{axis}_location"), function, name)


def _coordinate_path(model: Model, coordinate: int) -> str:
    (joint,) = [joint.name for joint in model.joints if coordinate in joint.motion.coordinates]
    return f"/jointset/{joint}/{model.coordinates[coordinate].name}"
