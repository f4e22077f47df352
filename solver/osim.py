"""Reads an OpenSim 4 model file (.osim) into a Model, and refuses by name and line what the solver does not have."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from solver.model import (
    GROUND,
    NO_COORDINATE,
    AxisMotion,
    Body,
    Coordinate,
    CoordinateActuator,
    Joint,
    Marker,
    Model,
    Muscle,
    Path,
    PathPoint,
    PathWrap,
    Placement,
    PointConstraint,
    ScapulothoracicMotion,
    WrapSurface,
)
from solver.osim_document import Element, read_document
from solver.spatial import rotation_body_fixed_xyz

Array = NDArray[np.float64]


def read_osim(path: str | FilePath) -> Model:
    """The model in an OpenSim 4 file. ModelError, naming file and line, for whatever the solver would not reproduce."""
    file = FilePath(path)
    document = read_document(file)
    if document.tag != "OpenSimDocument" or int(document.attributes.get("Version", "0")) < 40000:
        raise document.refusal("is not an OpenSim 4 document; open the model in OpenSim 4 and save it again")
    return _ModelReader(document.child("Model")).model()


_FORCES = ("Millard2012EquilibriumMuscle", "CoordinateActuator")

# The solver has one shape of each curve (muscle.py). It is what OpenSim takes where a file is silent, but for
# minimum_value, which therefore must be written.
_CURVES = {
    "ActiveForceLengthCurve": {
        "min_norm_active_fiber_length": 0.4441,
        "transition_norm_fiber_length": 0.73,
        "max_norm_active_fiber_length": 1.8123,
        "shallow_ascending_slope": 0.8616,
        "minimum_value": 0.0,
    },
    "ForceVelocityCurve": {
        "concentric_slope_at_vmax": 0.0,
        "concentric_slope_near_vmax": 0.25,
        "isometric_slope": 5.0,
        "eccentric_slope_at_vmax": 0.0,
        "eccentric_slope_near_vmax": 0.15,
        "max_eccentric_velocity_force_multiplier": 1.4,
        "concentric_curviness": 0.6,
        "eccentric_curviness": 0.9,
    },
    "FiberForceLengthCurve": {
        "strain_at_zero_force": 0.0,
        "strain_at_one_norm_force": 0.7,
        "stiffness_at_low_force": 0.2,
        "stiffness_at_one_norm_force": 2.0 / 0.7,
        "curviness": 0.75,
    },
}


@dataclass(frozen=True)
class _Frame:
    body: int
    placement: Placement


class _ModelReader:
    """One pass over the <Model>: frames first, because everything else hangs on them."""

    def __init__(self, element: Element) -> None:
        self.element = element
        bodies = element.objects("BodySet")
        self.bodies = (Body("ground", 0.0, np.zeros(3), np.zeros((3, 3))), *map(_body, bodies))
        self.frames: dict[str, _Frame] = {}
        self.surfaces: list[WrapSurface] = []
        self.coordinates: list[Coordinate] = []
        for index, body in enumerate([element.child("Ground"), *bodies]):
            path = "/ground" if index == GROUND else f"/bodyset/{body.name}"
            self.frames[path] = _Frame(index, Placement(np.eye(3), np.zeros(3)))
            self.surfaces += [_surface(index, surface) for surface in body.objects("WrapObjectSet")]
            self.add_offset_frames(body.members("components"), path)

    def model(self) -> Model:
        element = self.element
        foreign = element.objects("ControllerSet") + element.objects("ComponentSet") + element.members("components")
        for member in foreign:
            raise member.refusal("is not something the solver has; remove it from the model")
        joints = tuple(map(self.joint, element.objects("JointSet")))
        self.check_tree(joints)
        forces = element.objects("ForceSet")
        for force in forces:
            if force.tag not in _FORCES:
                raise force.unsupported("force", ", ".join(_FORCES))
            force.require("appliesForce", "true")
        return Model(
            name=element.name,
            gravity=element.numbers("gravity", 3, "0 -9.80665 0"),
            bodies=self.bodies,
            coordinates=tuple(self.coordinates),
            joints=joints,
            surfaces=tuple(self.surfaces),
            muscles=tuple(self.muscle(f) for f in forces if f.tag == "Millard2012EquilibriumMuscle"),
            constraints=tuple(map(self.constraint, element.objects("ConstraintSet"))),
            actuators=tuple(self.actuator(f) for f in forces if f.tag == "CoordinateActuator"),
            markers=tuple(map(self.marker, element.objects("MarkerSet"))),
        )

    def add_offset_frames(self, offsets: list[Element], owner: str) -> None:
        for offset in offsets:
            if offset.tag != "PhysicalOffsetFrame":
                raise offset.unsupported("component", "PhysicalOffsetFrame")
            path = f"{owner}/{offset.name}"
            parent = self.frame(offset, "socket_parent", path)
            rotation = rotation_body_fixed_xyz(offset.numbers("orientation", 3, "0 0 0"))
            translation = offset.numbers("translation", 3, "0 0 0")
            outer = parent.placement
            placement = Placement(outer.rotation @ rotation, outer.translation + outer.rotation @ translation)
            self.frames[path] = _Frame(parent.body, placement)

    def frame(self, element: Element, socket: str, owner: str = "/") -> _Frame:
        """The frame that a socket of the component at the path `owner` names, by an absolute or a relative path."""
        name = element.child(socket).text
        path = posixpath.normpath(posixpath.join(owner, name))
        if path not in self.frames:
            raise element.child(socket).refusal(f"of {element.tag} {element.name} names an unknown frame {name}")
        return self.frames[path]

    def station(self, element: Element, socket: str, location: str) -> tuple[int, Array]:
        """A point fixed in a frame, given in the body that carries the frame."""
        frame = self.frame(element, socket)
        placement = frame.placement
        return frame.body, placement.translation + placement.rotation @ element.numbers(location, 3)

    def coordinate(self, element: Element, name: str) -> int:
        name = posixpath.basename(name)
        for index, coordinate in enumerate(self.coordinates):
            if coordinate.name == name:
                return index
        raise element.refusal(f"names an unknown coordinate {name}")

    def joint(self, element: Element) -> Joint:
        path = f"/jointset/{element.name}"
        self.add_offset_frames(element.members("frames"), path)
        parent = self.frame(element, "socket_parent_frame", path)
        child = self.frame(element, "socket_child_frame", path)
        motion = self.motion(element)
        return Joint(element.name, parent.body, child.body, parent.placement, child.placement, motion)

    def motion(self, element: Element) -> AxisMotion | ScapulothoracicMotion:
        coordinates = element.members("coordinates")
        first = len(self.coordinates)
        if element.tag == "WeldJoint":
            still = np.full(6, NO_COORDINATE)
            return AxisMotion(np.vstack([np.eye(3), np.eye(3)]), still, np.zeros(6), np.zeros(6))
        if element.tag == "CustomJoint":
            axes = element.child("SpatialTransform").children
            translating = {axis.word("coordinates", "") for axis in axes if axis.name.startswith("translation")}
            self.coordinates += [_coordinate(c, translates=c.name in translating) for c in coordinates]
            return self.axis_motion(element, axes)
        if element.tag == "ScapulothoracicJoint":
            self.coordinates += [_coordinate(c, translates=False) for c in coordinates]
            return ScapulothoracicMotion(
                coordinates=(first, first + 1, first + 2, first + 3),
                radii=element.numbers("thoracic_ellipsoid_radii_x_y_z", 3),
                winging_origin=element.numbers("scapula_winging_axis_origin", 2),
                winging_direction=element.number("scapula_winging_axis_direction"),
            )
        raise element.unsupported("joint", "CustomJoint, ScapulothoracicJoint, WeldJoint")

    def axis_motion(self, element: Element, axes: list[Element]) -> AxisMotion:
        expected = [f"{kind}{number}" for kind in ("rotation", "translation") for number in (1, 2, 3)]
        if [axis.name for axis in axes] != expected:
            raise element.refusal(f"has not the six axes {', '.join(expected)} in this order")
        directions = np.array([axis.numbers("axis", 3) for axis in axes])
        names = [axis.word("coordinates", "") for axis in axes]
        lines = [_line(axis) for axis in axes]
        for axis, name, (slope, _) in zip(axes, names, lines, strict=True):
            if slope and not name:
                raise axis.refusal("has a sloping function but no coordinate")
        drivers = [self.coordinate(a, n) if n else NO_COORDINATE for a, n in zip(axes, names, strict=True)]
        driven = [driver for driver in drivers if driver != NO_COORDINATE]
        if len(set(driven)) != len(driven):
            raise element.refusal("drives two axes with one coordinate; the solver gives each axis its own")
        return AxisMotion(
            axes=directions / np.linalg.norm(directions, axis=1, keepdims=True),
            coordinate=np.array(drivers),
            slope=np.array([slope for slope, _ in lines]),
            offset=np.array([offset for _, offset in lines]),
        )

    def check_tree(self, joints: tuple[Joint, ...]) -> None:
        placed = {GROUND}
        for joint, element in zip(joints, self.element.objects("JointSet"), strict=True):
            if joint.parent not in placed or joint.child in placed:
                raise element.refusal(
                    "does not hang a new body on one already placed; the solver reads trees, root first"
                )
            placed.add(joint.child)
        for index, body in enumerate(self.bodies):
            if index not in placed:
                raise self.element.refusal(f"has no joint for body {body.name}")

    def constraint(self, element: Element) -> PointConstraint:
        if element.tag != "PointConstraint":
            raise element.unsupported("constraint", "PointConstraint")
        element.require("isEnforced", "true")
        body_1, location_1 = self.station(element, "socket_body_1", "location_body_1")
        body_2, location_2 = self.station(element, "socket_body_2", "location_body_2")
        return PointConstraint(element.name, body_1, body_2, location_1, location_2)

    def actuator(self, element: Element) -> CoordinateActuator:
        element.require("min_control", "-Inf")
        element.require("max_control", "Inf")
        coordinate = self.coordinate(element, element.child("coordinate").text)
        return CoordinateActuator(element.name, coordinate, element.number("optimal_force", "1"))

    def marker(self, element: Element) -> Marker:
        return Marker(element.name, *self.station(element, "socket_parent_frame", "location"))

    def muscle(self, element: Element) -> Muscle:
        for tag, options in _CURVES.items():
            _check_curve(element.child(tag), options)
        path = element.child("GeometryPath")
        return Muscle(
            name=element.name,
            path=Path(
                points=tuple(map(self.path_point, path.objects("PathPointSet"))),
                wraps=tuple(map(self.path_wrap, path.objects("PathWrapSet"))),
            ),
            max_isometric_force=element.number("max_isometric_force"),
            optimal_fiber_length=element.number("optimal_fiber_length"),
            tendon_slack_length=element.number("tendon_slack_length"),
            pennation_at_optimal=element.number("pennation_angle_at_optimal", "0"),
            max_contraction_velocity=element.number("max_contraction_velocity", "10"),
            activation_time_constant=element.number("activation_time_constant", "0.010"),
            deactivation_time_constant=element.number("deactivation_time_constant", "0.040"),
        )

    def path_point(self, element: Element) -> PathPoint:
        if element.tag == "PathPoint":
            body, location = self.station(element, "socket_parent_frame", "location")
            return PathPoint(body, location, np.zeros(3), NO_COORDINATE, (-np.inf, np.inf))
        if element.tag != "MovingPathPoint":
            raise element.unsupported("path point", "PathPoint, MovingPathPoint")
        frame = self.frame(element, "socket_parent_frame")
        drivers = {element.child(f"socket_{axis}_coordinate").text for axis in "xyz"}
        if len(drivers) != 1:
            raise element.refusal("follows several coordinates; the solver's moving points follow one")
        coordinate = self.coordinate(element, drivers.pop())
        lines = np.array([_line(element.child(f"{axis}_location")) for axis in "xyz"])
        rotation, translation = frame.placement.rotation, frame.placement.translation
        location, slope = translation + rotation @ lines[:, 1], rotation @ lines[:, 0]
        return PathPoint(frame.body, location, slope, coordinate, self.coordinates[coordinate].range)

    def path_wrap(self, element: Element) -> PathWrap:
        name = element.child("wrap_object").text
        names = [surface.name for surface in self.surfaces]
        if name not in names:
            raise element.refusal(f"names an unknown wrap object {name}")
        if not np.all(element.numbers("range", 2, "-1 -1") == -1.0):
            raise element.refusal("wraps only a range of points; the solver wraps whole paths (range -1 -1)")
        method = element.word("method", "hybrid")
        if method not in ("hybrid", "midpoint", "axial"):
            raise element.refusal(f"has the method {method}; the solver has hybrid, midpoint and axial")
        return PathWrap(names.index(name), method)  # type: ignore[arg-type]


def _body(element: Element) -> Body:
    xx, yy, zz, xy, xz, yz = element.numbers("inertia", 6)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Body(element.name, element.number("mass"), element.numbers("mass_center", 3), inertia)


def _coordinate(element: Element, translates: bool) -> Coordinate:
    element.require("locked", "false")
    element.require("prescribed", "false")
    low, high = element.numbers("range", 2)
    default = element.number("default_value", "0")
    return Coordinate(element.name, "translation" if translates else "rotation", default, (float(low), float(high)))


_SIDES = {
    "WrapEllipsoid": ("all",),
    "WrapSphere": ("all",),
    "WrapCylinder": ("all", "+x", "-x", "+y", "-y"),
}


def _surface(body: int, element: Element) -> WrapSurface:
    if element.tag not in _SIDES:
        raise element.unsupported("wrap object", ", ".join(_SIDES))
    element.require("active", "true")
    quadrant = element.word("quadrant", "all")
    if quadrant not in _SIDES[element.tag]:
        raise element.refusal(f"has the quadrant {quadrant}; the solver has {', '.join(_SIDES[element.tag])}")
    rotation = rotation_body_fixed_xyz(element.numbers("xyz_body_rotation", 3))
    placement = Placement(rotation, element.numbers("translation", 3))
    if element.tag == "WrapEllipsoid":
        return WrapSurface(element.name, body, placement, "ellipsoid", element.numbers("dimensions", 3), quadrant)
    radius = element.number("radius")
    if element.tag == "WrapSphere":
        return WrapSurface(element.name, body, placement, "sphere", np.full(3, radius), quadrant)
    dimensions = np.array([radius, radius, element.number("length")])
    return WrapSurface(element.name, body, placement, "cylinder", dimensions, quadrant)


def _line(holder: Element) -> tuple[float, float]:
    """Slope and offset of a function that is a straight line; a spline with two knots is one, also outside them."""
    function, scale = _unscaled(_function(holder))
    slope, offset = 0.0, 0.0
    if function.tag == "Constant":
        offset = function.number("value")
    elif function.tag == "LinearFunction":
        slope, offset = function.numbers("coefficients", 2)
    elif function.tag == "SimmSpline" and len(function.child("x").text.split()) == 2:
        (x0, x1), (y0, y1) = function.numbers("x", 2), function.numbers("y", 2)
        slope = (y1 - y0) / (x1 - x0)
        offset = y0 - slope * x0
    else:
        raise function.unsupported("function", "Constant, LinearFunction, SimmSpline with two knots")
    return float(scale * slope), float(scale * offset)


def _function(holder: Element) -> Element:
    """The function among an element's properties: OpenSim writes properties in lower case, functions in capitals."""
    functions = [child for child in holder.children if child.tag[0].isupper()]
    if len(functions) != 1:
        raise holder.refusal(f"has {len(functions)} functions, expected one")
    return functions[0]


def _unscaled(function: Element) -> tuple[Element, float]:
    scale = 1.0
    while function.tag == "MultiplierFunction":
        scale *= function.number("scale", "1")
        function = _function(function.child("function"))
    return function, scale


def _check_curve(curve: Element, options: dict[str, float]) -> None:
    if "minimum_value" in options:
        curve.child("minimum_value")
    for option in curve.children:
        if option.tag not in options or option.text == "":
            continue
        value, expected = curve.number(option.tag), options[option.tag]
        if abs(value - expected) > 1e-12:
            raise option.refusal(f"of {curve.name} is {value}; the solver's curve has {expected}")
