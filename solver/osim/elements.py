"""Elements of an OpenSim document that is written: names, values with all digits, sets, frames, functions,
paths.

The solver keeps polynomials by pieces; their class is found again.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from solver.errors import SolverCode
from solver.functions.coordinate_functions import (
    Function,
    PiecewisePolynomial,
    Sine,
    natural_spline,
    piecewise_constant,
    piecewise_linear,
    polynomial,
    simm_spline,
    smooth_step,
)
from solver.model import (
    GROUND,
    AnyPathPoint,
    Array,
    Body,
    ConditionalPathPoint,
    Model,
    ModelError,
    Path,
    PathPoint,
    Placement,
)
from solver.multibody.postures import body_fixed_xyz_angles

VERSION = "40500"


def add(parent: Xml.Element, tag: str, name: str = "") -> Xml.Element:
    return Xml.SubElement(parent, tag, {"name": name} if name else {})


def add_values(parent: Xml.Element, **values: Any) -> None:
    """Add one element for every property: text as it is, booleans as words, numbers with all digits."""
    for tag, value in values.items():
        add(parent, tag).text = _text(value)


def find_objects(model: Xml.Element, tag: str) -> Xml.Element:
    """The <objects> of one of the model's sets; created if missing."""
    found = model.find(tag)
    found = add(model, tag, tag.lower()) if found is None else found
    objects = found.find("objects")
    return add(found, "objects") if objects is None else objects


def body_path(bodies: Sequence[Body], body: int) -> str:
    return "/ground" if body == GROUND else f"/bodyset/{bodies[body].name}"


def add_offset_frame(frames: Xml.Element, name: str, path: str, placement: Placement) -> None:
    """A frame of the body at that path."""
    frame = add(frames, "PhysicalOffsetFrame", name)
    angles = body_fixed_xyz_angles(placement.rotation)
    add_values(frame, socket_parent=path, translation=placement.translation, orientation=angles)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) else " ".join(map(repr, np.ravel(value).tolist()))


def add_function(holder: Xml.Element, function: Function, where: str, name: str = "function") -> None:
    """Add the function to an element. Raises ModelError, naming `where`, for one that no class of OpenSim has."""
    if isinstance(function, Sine):
        tag, values = "Sine", dict(vars(function))
    else:
        found = next((one for one in _candidates(function) if _is_same(one.function, function)), None)
        if found is None:
            raise ModelError(
                f"the writer of .osim has no class of function for that of {where}; replace it by a spline",
                SolverCode.NOT_WRITABLE,
            )
        tag, values = found.tag, found.values
    add_values(add(holder, tag, name), **values)


@dataclass(frozen=True)
class _Candidate:
    tag: str
    values: dict[str, Any]
    function: Function


def _candidates(function: PiecewisePolynomial) -> Iterator[_Candidate]:
    """Functions of OpenSim's classes that agree with this one in number of pieces, breaks and some values."""
    breaks, degree = function.breaks, function.coefficients.shape[1] - 1
    if not len(breaks):
        yield _one_polynomial(function)
        return
    starts = function.derivatives(breaks)[0]
    if degree == 0:
        x, y = function.origins, function.coefficients[:, 0]
        yield _Candidate("PiecewiseConstantFunction", {"x": x, "y": y}, piecewise_constant(x, y))
    if degree == 1:
        x = np.array([breaks[0] - 1.0, *breaks, breaks[-1] + 1.0])
        y = function.derivatives(x)[0]
        yield _Candidate("PiecewiseLinearFunction", {"x": x, "y": y}, piecewise_linear(x, y))
    if len(breaks) == 2 and degree == 5:
        yield _step(function)
    splines: list[tuple[str, dict[str, Any], Callable[[Array, Array], Function]]] = []
    if degree == 3 and len(breaks) > 2:
        splines.append(("SimmSpline", {}, simm_spline))
    half_order = (degree + 1) // 2
    if degree > 1 and degree % 2 and len(breaks) >= 2 * half_order and (np.diff(breaks) > 0.0).all():
        options = {"half_order": str(half_order), "error_variance": 0.0}
        splines.append(("GCVSpline", options, lambda x, y: natural_spline(x, y, half_order)))
    for tag, options, make in splines:
        yield _Candidate(tag, {"x": breaks, "y": starts, **options}, make(breaks, starts))


def _one_polynomial(function: PiecewisePolynomial) -> _Candidate:
    row, origin = function.coefficients[0], function.origins[0]
    if origin:
        about_zero = Polynomial(row)(Polynomial([-origin, 1.0])).coef
        row = np.pad(about_zero, (0, len(row) - len(about_zero)))
    if len(row) == 1:
        return _Candidate("Constant", {"value": row}, polynomial(row))
    tag = "LinearFunction" if len(row) == 2 else "PolynomialFunction"
    return _Candidate(tag, {"coefficients": row[::-1]}, polynomial(row))


def _step(function: PiecewisePolynomial) -> _Candidate:
    """The transition starts at the origin of its pieces, which may be the greater of the breaks."""
    start = float(function.origins[1])
    end = float(function.breaks[1] if start == function.breaks[0] else function.breaks[0])
    low, high = (float(function.derivatives(np.array([x]))[0][0]) for x in (start, end))
    values = {"transition_start_time": start, "transition_end_time": end, "start_value": low, "end_value": high}
    return _Candidate("StepFunction", values, smooth_step(start, end, low, high))


def _is_same(one: Function, other: PiecewisePolynomial) -> bool:
    """Values and slopes agree to rounding at more points of each piece than its degree."""
    breaks = other.breaks if len(other.breaks) else np.zeros(1)
    edges = np.array([breaks[0] - 1.0, *breaks, breaks[-1] + 1.0])
    inside = (np.arange(other.coefficients.shape[1] + 1) + 0.5) / (other.coefficients.shape[1] + 1)
    x = (edges[:-1, None] + np.diff(edges)[:, None] * inside).ravel()
    pairs = list(zip(one.derivatives(x)[:2], other.derivatives(x)[:2], strict=True))
    return all(np.allclose(a, b, rtol=1e-12, atol=1e-12 * max(1e-3, np.abs(b).max(initial=0.0))) for a, b in pairs)


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
    wraps = find_objects(force[0], "PathWrapSet")
    for index, wrap in enumerate(path.wraps, start=1):
        its = add(wraps, "PathWrap", f"{name}-wrap{index}")
        surface, span = model.surfaces[wrap.surface].name, (wrap.first + 1, -1 if wrap.last is None else wrap.last + 1)
        add_values(its, wrap_object=surface, method=wrap.method, range=span)


def _add_point(points: Xml.Element, model: Model, point: AnyPathPoint, name: str) -> None:
    frame = body_path(model.bodies, point.body)
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
