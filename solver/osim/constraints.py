"""Constraints in an OpenSim file, and coordinates that are locked or prescribed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from solver.constraint import (
    ConstantDistanceConstraint,
    Constraint,
    CoordinateCoupler,
    CoordinateLock,
    CoordinatePrescription,
    PointConstraint,
    PointOnLineConstraint,
    WeldConstraint,
)
from solver.errors import SolverCode
from solver.functions.coordinate import Function, polynomial, scaled
from solver.osim.document import Element
from solver.osim.frames import Names
from solver.osim.functions import read_function, read_named_function

Array = NDArray[np.float64]


def ensure_known_constraint(element: Element) -> None:
    if element.tag not in _READERS:
        raise element.unsupported("constraint", ", ".join(_READERS))


def read_constraint(element: Element, names: Names) -> Constraint:
    ensure_known_constraint(element)
    return _READERS[element.tag](element, names)


def read_held_coordinate(element: Element, names: Names) -> CoordinateLock | CoordinatePrescription | None:
    """Constraint of a <Coordinate> that is locked or prescribed, else None; without a function it is not prescribed."""
    is_prescribed = element.flag("prescribed")
    function = read_named_function(element, "prescribed_function") if is_prescribed else None
    is_locked = element.flag("locked")
    if is_locked and function is not None:
        raise element.refusal(
            "is both locked and prescribed, and OpenSim 4.6 enforces both; choose one", SolverCode.UNSUPPORTED
        )
    coordinate = names.coordinate(element, element.name)
    if is_locked:
        return CoordinateLock(element.name, coordinate, element.number("default_value", "0"))
    return None if function is None else CoordinatePrescription(element.name, coordinate, function)


def _point(element: Element, names: Names) -> PointConstraint:
    ends = [_in_body(element, names, f"socket_body_{k}", f"location_body_{k}") for k in (1, 2)]
    (body_1, location_1), (body_2, location_2) = ends
    return PointConstraint(element.name, body_1, body_2, location_1, location_2)


def _distance(element: Element, names: Names) -> ConstantDistanceConstraint:
    one = _point(element, names)
    distance = element.positive("constant_distance")
    return ConstantDistanceConstraint(one.name, one.body_1, one.body_2, one.location_1, one.location_2, distance)


def _line(element: Element, names: Names) -> PointOnLineConstraint:
    line, on_line = _in_body(element, names, "socket_line_body", "point_on_line")
    follower, held = _in_body(element, names, "socket_follower_body", "point_on_follower")
    direction = element.numbers("line_direction_vec", 3, "0 0 0")
    if not direction.any():
        raise element.refusal("has a line_direction_vec 0 0 0; give the direction", SolverCode.NOT_POSITIVE)
    return PointOnLineConstraint(element.name, line, follower, on_line, held, direction / np.linalg.norm(direction))


def _weld(element: Element, names: Names) -> WeldConstraint:
    path = f"/constraintset/{element.name or element.tag}"
    names.add_offset_frames(element.members("frames"), path)
    one, two = (names.frame(element, f"socket_frame{k}", path) for k in (1, 2))
    return WeldConstraint(
        name=element.name,
        body_1=one.body,
        body_2=two.body,
        location_1=one.placement.translation,
        location_2=two.placement.translation,
        rotation_1=one.placement.rotation,
        rotation_2=two.placement.rotation,
    )


def _coupler(element: Element, names: Names) -> CoordinateCoupler:
    independents = element.child("independent_coordinate_names").text.split()
    holder = element.child("coupled_coordinates_function")
    if holder.find("Constant") is not None:
        raise holder.refusal(f"of {element.name} is a constant; lock the coordinate instead", SolverCode.UNSUPPORTED)
    functions = [read_function(holder)] if len(independents) == 1 else _lines(element, holder, len(independents))
    factor = element.number("scale_factor", "1")
    return CoordinateCoupler(
        name=element.name,
        dependent=names.coordinate(element, element.child("dependent_coordinate_name").text),
        independents=tuple(names.coordinate(element, name) for name in independents),
        functions=tuple(scaled(function, factor) for function in functions),
    )


_READERS: dict[str, Callable[[Element, Names], Constraint]] = {
    "PointConstraint": _point,
    "ConstantDistanceConstraint": _distance,
    "PointOnLineConstraint": _line,
    "WeldConstraint": _weld,
    "CoordinateCouplerConstraint": _coupler,
}


def _in_body(element: Element, names: Names, socket: str, location: str) -> tuple[int, Array]:
    """A point in the body that carries a frame. OpenSim 4.6 takes a location in a frame as one in its body."""
    frame = names.frame(element, socket)
    if frame.placement.translation.any() or not np.array_equal(frame.placement.rotation, np.eye(3)):
        raise element.refusal(
            f"has an offset frame for its {socket}, whose offset OpenSim 4.6 ignores; name the body, and give the "
            "location in it",
            SolverCode.UNSUPPORTED,
        )
    return names.station(element, socket, location)


def _lines(element: Element, holder: Element, count: int) -> list[Function]:
    """The terms of a LinearFunction of several coordinates, with its constant in the first.

    OpenSim's other functions of several have no second derivatives; those of one would couple the first two.
    """
    line = holder.find("LinearFunction")
    if line is None or not count:
        read_function(holder)  # refuses a function that OpenSim differentiates wrongly by its own name
        raise holder.refusal(
            f"of {element.name} should be a LinearFunction, because it depends on {count} coordinates",
            SolverCode.UNSUPPORTED,
        )
    *slopes, constant = line.numbers("coefficients", count + 1)
    return [polynomial([0.0 if k else constant, slope]) for k, slope in enumerate(slopes)]
