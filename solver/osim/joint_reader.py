"""Read joints, their coordinates and constraints of an OpenSim file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from documents.interval import counted
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
from solver.functions.coordinate_functions import Function, polynomial, scaled
from solver.model import NO_COORDINATE, Array, AxisMotion, BallMotion, Coordinate, Joint, Motion, ScapulothoracicMotion
from solver.osim.document import Element
from solver.osim.names import Names, OffsetFrame, read_function, read_named_function

Kind = Literal["rotation", "translation", "coupled"]

# Axes of OpenSim's elementary joints in the order of their coordinates: 0 to 2 are successive rotations about x, y, z,
# 3 to 5 translations along them.
_PLAIN = {
    "WeldJoint": (),
    "PinJoint": (2,),
    "SliderJoint": (3,),
    "UniversalJoint": (0, 1),
    "PlanarJoint": (2, 3, 4),
    "GimbalJoint": (0, 1, 2),
}
_BALLS = {"BallJoint": 3, "FreeJoint": 6}
_JOINTS = ", ".join(["CustomJoint", "ScapulothoracicJoint", *_PLAIN, *_BALLS])
_SIX_KINDS: list[Kind] = ["rotation", "rotation", "rotation", "translation", "translation", "translation"]
_STILL, _DRIVEN = polynomial([0.0]), polynomial([0.0, 1.0])


def read_joint_frames(element: Element, names: Names) -> tuple[OffsetFrame, OffsetFrame]:
    """Frames of a joint in its parent and in its child."""
    path = f"/jointset/{element.name}"
    return names.frame(element, "socket_parent_frame", path), names.frame(element, "socket_child_frame", path)


def read_joint(element: Element, parent: OffsetFrame, child: OffsetFrame, names: Names) -> Joint:
    """The joint. Adds its coordinates to the names."""
    first = len(names.coordinates)
    motion = _motion(element, names.coordinates)
    known = [coordinate.name for coordinate in names.coordinates]
    twice = sorted({name for name in known[first:] if known.count(name) > 1})
    if twice:
        sentence = f"has a coordinate of a name that the model already has: {', '.join(twice)}; rename one"
        raise element.refusal(sentence, SolverCode.UNSUPPORTED)
    return Joint(element.name, parent.body, child.body, parent.placement, child.placement, motion)


def _motion(element: Element, coordinates: list[Coordinate]) -> Motion:
    if element.tag == "CustomJoint":
        return _custom(element, coordinates)
    first = len(coordinates)
    if element.tag in _PLAIN:
        axes = _PLAIN[element.tag]
        _add_coordinates(element, coordinates, [_SIX_KINDS[axis] for axis in axes])
        drivers = np.full(6, NO_COORDINATE)
        drivers[list(axes)] = first + np.arange(len(axes))
        functions = tuple(_DRIVEN if axis in axes else _STILL for axis in range(6))
        return AxisMotion(np.vstack([np.eye(3), np.eye(3)]), drivers, functions)
    if element.tag in _BALLS:
        _add_coordinates(element, coordinates, _SIX_KINDS[: _BALLS[element.tag]])
        place = () if element.tag == "BallJoint" else (first + 3, first + 4, first + 5)
        return BallMotion((first, first + 1, first + 2), place)
    if element.tag == "ScapulothoracicJoint":
        _add_coordinates(element, coordinates, ["rotation"] * 4)
        return ScapulothoracicMotion(
            coordinates=(first, first + 1, first + 2, first + 3),
            radii=element.numbers("thoracic_ellipsoid_radii_x_y_z", 3),
            winging_origin=element.numbers("scapula_winging_axis_origin", 2, "0 0"),
            winging_direction=element.number("scapula_winging_axis_direction", "0"),
        )
    raise element.unsupported("joint", _JOINTS)


def _add_coordinates(element: Element, coordinates: list[Coordinate], kinds: list[Kind]) -> None:
    found = element.members("coordinates")
    if len(found) != len(kinds):
        raise element.refusal(f"has {counted(len(found), 'coordinate')}, expected {len(kinds)}")
    coordinates += [_coordinate(element, kind) for element, kind in zip(found, kinds, strict=True)]


def _custom(element: Element, coordinates: list[Coordinate]) -> AxisMotion:
    axes = _six_axes(element.child("SpatialTransform"))
    directions = np.array([axis.numbers("axis", 3, "1 0 0") for axis in axes])
    drivers = [axis.word("coordinates", "") for axis in axes]
    functions = tuple(_axis_function(axis, driver) for axis, driver in zip(axes, drivers, strict=True))
    # OpenSim puts a joint's coordinates into the order in which its axes use them.
    order = list(dict.fromkeys(driver for driver in drivers if driver))
    own = {coordinate.name: coordinate for coordinate in element.members("coordinates")}
    idle = [name for name in own if name not in order]
    if idle:
        raise element.refusal(
            f"has the coordinate {', '.join(idle)}, which moves no axis, so that OpenSim 4.6 finds no accelerations; "
            "remove it",
            SolverCode.UNSUPPORTED,
        )
    if len(order) > len(own):
        raise element.refusal(f"has the coordinates {', '.join(own)}, but its axes use {', '.join(order)}")
    first = len(coordinates)
    coordinates += [_coordinate(own[name], _kind(name, axes)) for name in order]
    sizes = np.linalg.norm(directions, axis=1, keepdims=True)
    if not sizes.all():
        raise element.refusal("has an axis 0 0 0; give its direction", SolverCode.NOT_POSITIVE)
    return AxisMotion(
        axes=directions / sizes,
        coordinate=np.array([first + order.index(name) if name else NO_COORDINATE for name in drivers]),
        functions=functions,
    )


def _six_axes(transform: Element) -> list[Element]:
    """The axes in OpenSim's order. One that the file does not list is x, y or z, and nothing moves along it."""
    names = [f"{kind}{number}" for kind in ("rotation", "translation") for number in (1, 2, 3)]
    listed = {axis.name: axis for axis in transform.children}
    if not set(names).issuperset(listed) or len(listed) < len(transform.children):
        raise transform.refusal(f"should list its axes {', '.join(names)} at most once, and no others")

    directions = (
        replace(transform, tag="axis", children=[], pieces=[axis]) for axis in 2 * ("1 0 0", "0 1 0", "0 0 1")
    )
    return [
        listed.get(name) or replace(transform, tag="TransformAxis", attributes={"name": name}, children=[direction])
        for name, direction in zip(names, directions, strict=True)
    ]


def _axis_function(axis: Element, driver: str) -> Function:
    if len(driver.split()) > 1:
        raise axis.refusal(
            f"is driven by {driver}; the solver supports one coordinate for an axis", SolverCode.UNSUPPORTED
        )
    if not any(child.tag[0].isupper() for child in axis.children):
        return _DRIVEN if driver else _STILL
    function = read_function(axis)
    if not driver and np.any(function.derivatives(np.array([-1.0, 0.0, 1.0]))[1]):
        raise axis.refusal("has a sloping function but no coordinate")
    return function


def _kind(name: str, axes: list[Element]) -> Kind:
    """Kind of a coordinate; as in OpenSim, the last axis that moves by plus or minus the coordinate decides."""
    kind: Kind = "coupled"
    for index, axis in enumerate(axes):
        line = axis.find("LinearFunction") if axis.word("coordinates", "") == name else None
        if line is not None and abs(line.numbers("coefficients", 2, "1 0")[0]) == 1.0:
            kind = "rotation" if index < 3 else "translation"
    return kind


def _coordinate(element: Element, kind: Kind) -> Coordinate:
    low, high = element.numbers("range", 2, "-10 10", may_be_infinite=True)
    is_clamped = element.flag("clamped")
    return Coordinate(element.name, kind, element.number("default_value", "0"), (float(low), float(high)), is_clamped)


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
    points = vars(_point(element, names))
    return ConstantDistanceConstraint(**points, distance=element.positive("constant_distance"))


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
