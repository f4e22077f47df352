"""Names in an OpenSim file to which other elements refer, bodies, frames and points in them, coordinates, and functions
of these.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from solver.errors import SolverCode
from solver.functions.coordinate_functions import (
    Function,
    Sine,
    natural_spline,
    piecewise_constant,
    piecewise_linear,
    polynomial,
    scaled,
    simm_spline,
    smooth_step,
)
from solver.model import Array, Coordinate, Placement
from solver.multibody.postures import rotation_body_fixed_xyz
from solver.osim.document import Element


@dataclass(frozen=True)
class OffsetFrame:
    body: int
    placement: Placement


_FRAMES, _POINTS = ("PhysicalOffsetFrame", "StationDefinedFrame"), ("Station", "Marker")
SHAPES = ("FrameGeometry", "Mesh", "Brick", "Sphere", "Cylinder", "Ellipsoid", "Cone", "Arrow")
INERT = (*_POINTS, "PathPoint", "IMU", "Bhargava2004SmoothedMuscleMetabolics")  # what OpenSim's tools do not use


class Names:
    """Filled while a file is read: frames by their path in the model, coordinates in the model's order.

    Components may refer to others that the file lists later. So they are added first, and placed when they are needed.
    """

    def __init__(self) -> None:
        self.frames: dict[str, OffsetFrame] = {}
        self.coordinates: list[Coordinate] = []
        self._components: dict[str, Element] = {}
        self._being_placed: list[str] = []

    def add_body(self, path: str, body: int) -> None:
        self.frames[path] = OffsetFrame(body, Placement(np.eye(3), np.zeros(3)))

    def add_component(self, owner: str, component: Element) -> None:
        """A frame or point that the component at the path `owner` holds, with those that it holds in turn.

        Raises ModelError for a component that is neither and that acts on the model.
        """
        if component.tag not in (*_FRAMES, *INERT, *SHAPES):
            raise component.unsupported("component", ", ".join(_FRAMES))
        path = posixpath.normpath(f"{owner}/{component.name}")
        self._components[path] = component
        for held in component.members("components"):
            self.add_component(path, held)

    def add_offset_frames(self, offsets: list[Element], owner: str) -> None:
        for offset in offsets:
            self.add_component(owner, offset)

    def wrap_objects(self) -> list[tuple[OffsetFrame, Element]]:
        """Wrap objects that frames hold, with the frame of each."""
        holders = [(path, held) for path, held in self._components.items() if held.objects("WrapObjectSet")]
        return [(self._placed(path), one) for path, held in holders for one in held.objects("WrapObjectSet")]

    def has_frame(self, path: str) -> bool:
        """Whether there is a frame of this path, absolute or from the root."""
        return self._is_frame(posixpath.normpath(posixpath.join("/", path)))

    def frame(self, element: Element, socket: str, owner: str = "/") -> OffsetFrame:
        """The frame named by a socket of the component at the path `owner`, by an absolute or relative path."""
        name = element.child(socket).text
        path = posixpath.normpath(posixpath.join(owner, name))
        if not self._is_frame(path):
            raise element.child(socket).refusal(
                f"of {element.tag} {element.name} names an unknown frame {name}", SolverCode.UNKNOWN_NAME
            )
        return self._placed(path)

    def named_frame(self, element: Element, tag: str) -> OffsetFrame:
        """The frame in a property that is a name or path rather than a socket: a body's name, or a frame's path."""
        name = element.child(tag).text
        for path in (posixpath.normpath(posixpath.join("/", name)), f"/bodyset/{name}"):
            if self._is_frame(path):
                return self._placed(path)
        raise element.refusal(f"names an unknown body {name}", SolverCode.UNKNOWN_NAME)

    def body(self, element: Element, tag: str) -> int:
        """The moving body that a property names."""
        name = element.child(tag).text
        if f"/bodyset/{name}" not in self.frames:
            raise element.refusal(f"names an unknown body {name}", SolverCode.UNKNOWN_NAME)
        return self.frames[f"/bodyset/{name}"].body

    def station(self, element: Element, socket: str, location: str, owner: str = "/") -> tuple[int, Array]:
        """A point fixed in a frame, given in the body that carries the frame."""
        frame = self.frame(element, socket, owner)
        placement = frame.placement
        return frame.body, placement.translation + placement.rotation @ element.numbers(location, 3, "0 0 0")

    def coordinate(self, element: Element, name: str) -> int:
        name = posixpath.basename(name)
        for index, coordinate in enumerate(self.coordinates):
            if coordinate.name == name:
                return index
        raise element.refusal(f"names an unknown coordinate {name}", SolverCode.UNKNOWN_NAME)

    def _is_frame(self, path: str) -> bool:
        """Whether there is a frame of that path whose place does not depend on itself."""
        component = self._components.get(path)
        is_frame = component is not None and component.tag in _FRAMES and path not in self._being_placed
        return path in self.frames or is_frame

    def _placed(self, path: str) -> OffsetFrame:
        if path not in self.frames:
            component = self._components[path]
            self._being_placed.append(path)
            place = self._offset if component.tag == "PhysicalOffsetFrame" else self._frame_of_points
            self.frames[path] = place(component, path)
            self._being_placed.remove(path)
        return self.frames[path]

    def _offset(self, offset: Element, path: str) -> OffsetFrame:
        parent = self.frame(offset, "socket_parent", path)
        rotation = rotation_body_fixed_xyz(offset.numbers("orientation", 3, "0 0 0"))
        translation = offset.numbers("translation", 3, "0 0 0")
        outer = parent.placement
        placement = Placement(outer.rotation @ rotation, outer.translation + outer.rotation @ translation)
        return OffsetFrame(parent.body, placement)

    def _frame_of_points(self, element: Element, path: str) -> OffsetFrame:
        """Axes along a → b, along the normal of the triangle a, b, c, and perpendicular to both; OpenSim 4.5."""
        sockets = ("point_a", "point_b", "point_c", "origin_point")
        bodies, (a, b, c, origin) = zip(
            *(self._point(element, f"socket_{name}", path) for name in sockets), strict=True
        )
        normal = np.cross(b - a, c - a)
        if len(set(bodies)) > 1 or not normal.any():
            raise element.refusal("should be defined by a triangle of points in one body; correct its points")
        first, along = _direction(element, "ab_axis", "+x")
        second, upright = _direction(element, "ab_x_ac_axis", "+y")
        if first == second:
            raise element.refusal("has the same axis for ab_axis and ab_x_ac_axis; choose two")
        rotation = np.zeros((3, 3))
        rotation[:, first] = along * (b - a) / np.linalg.norm(b - a)
        rotation[:, second] = upright * normal / np.linalg.norm(normal)
        third = 3 - first - second
        rotation[:, third] = np.cross(rotation[:, (third + 1) % 3], rotation[:, (third + 2) % 3])
        return OffsetFrame(bodies[0], Placement(rotation, origin))

    def _point(self, element: Element, socket: str, owner: str) -> tuple[int, Array]:
        """The point that a socket names, in its body."""
        name = element.child(socket).text
        path = posixpath.normpath(posixpath.join(owner, name))
        point = self._components.get(path)
        if point is None or point.tag not in _POINTS:
            raise element.child(socket).refusal(
                f"of {element.tag} {element.name} names an unknown point {name}", SolverCode.UNKNOWN_NAME
            )
        return self.station(point, "socket_parent_frame", "location", path)


def _direction(element: Element, tag: str, default: str) -> tuple[int, int]:
    """Axis and sign of a text such as +x or -y."""
    text = element.word(tag, default).lower()
    if text.lstrip("+-") not in ("x", "y", "z") or len(text) > 2:
        raise element.refusal(f"should have an axis such as +x or -y for its {tag}, not '{text}'")
    return "xyz".index(text[-1]), -1 if text[0] == "-" else 1


def read_function(holder: Element) -> Function:
    """The function among an element's properties: OpenSim writes properties in lower case, functions in capitals."""
    functions = [child for child in holder.children if child.tag[0].isupper()]
    if len(functions) != 1:
        raise holder.refusal(f"has {len(functions)} functions, expected one")
    return read_function_element(functions[0])


def read_named_function(holder: Element, name: str) -> Function | None:
    """The function that is the element's property of that name, if it has one.

    Its tag is the class and its name that of the property, or, in earlier files, it is within a tag of that name.
    """
    element = next((child for child in holder.children if child.name == name and child.tag[0].isupper()), None)
    if element is not None:
        return read_function_element(element)
    wrapped = holder.find(name)
    return read_function(wrapped) if wrapped is not None and wrapped.children else None


def read_function_element(element: Element) -> Function:
    if element.tag in _WITHOUT_CURVATURE:
        raise element.refusal(
            "has its slope for its curvature in OpenSim 4.6, so that accelerations are wrong there; write it as a "
            "PolynomialFunction or a SimmSpline",
            SolverCode.UNSUPPORTED,
        )
    if element.tag not in _READERS:
        raise element.unsupported("function", ", ".join(_READERS))
    return _READERS[element.tag](element)


def _sine(element: Element) -> Function:
    defaults = {"amplitude": "1", "omega": "1", "phase": "0", "offset": "0"}
    return Sine(*(element.number(tag, default) for tag, default in defaults.items()))


def _step(element: Element) -> Function:
    start, end = element.number("transition_start_time", "0.99"), element.number("transition_end_time", "1.01")
    if start == end:
        raise element.refusal(f"starts and ends its transition at {start}; the solver needs room between them")
    return smooth_step(start, end, element.number("start_value", "0"), element.number("end_value", "1"))


def _natural_spline(element: Element) -> Function:
    if element.number("error_variance", "0") != 0.0:
        raise element.refusal(
            "smooths its points; the solver supports only splines through them (error_variance 0)",
            SolverCode.UNSUPPORTED,
        )
    half_order = int(element.number("half_order"))
    return natural_spline(*_points(element, fewest=2 * half_order), half_order)


def _simm_spline(element: Element) -> Function:
    """SIMM's splines may repeat an x between their ends."""
    x, y = _points(element, may_repeat=True)
    return _shared_simm_spline(tuple(x), tuple(y))


@lru_cache(maxsize=256)
def _shared_simm_spline(x: tuple[float, ...], y: tuple[float, ...]) -> Function:
    """One function for the same points: muscles with the same curves are evaluated together."""
    return simm_spline(np.array(x), np.array(y))


def _points(element: Element, fewest: int = 2, *, may_repeat: bool = False) -> tuple[Array, Array]:
    x, y = element.series("x"), element.series("y")
    steps = np.diff(x)
    is_rising = bool(np.all(steps >= 0.0) and x[0] < x[-1]) if may_repeat and len(x) > 2 else np.all(steps > 0.0)
    if len(x) != len(y) or len(x) < fewest or not is_rising:
        raise element.refusal(f"has {len(x)} x and {len(y)} y; the solver needs {fewest} or more of both, x increasing")
    return x, y


_WITHOUT_CURVATURE = ("ExpressionBasedFunction", "MultivariatePolynomialFunction")
_READERS: dict[str, Callable[[Element], Function]] = {
    "Constant": lambda element: polynomial([element.number("value", "0")]),
    "LinearFunction": lambda element: polynomial(element.numbers("coefficients", 2, "1 0")[::-1]),
    "PolynomialFunction": lambda element: polynomial(element.series("coefficients")[::-1]),
    "SimmSpline": _simm_spline,
    "PiecewiseLinearFunction": lambda element: piecewise_linear(*_points(element)),
    "PiecewiseConstantFunction": lambda element: piecewise_constant(*_points(element)),
    "GCVSpline": _natural_spline,
    "StepFunction": _step,
    "Sine": _sine,
    "MultiplierFunction": lambda element: scaled(
        read_function(element.child("function")), element.number("scale", "1")
    ),
}
