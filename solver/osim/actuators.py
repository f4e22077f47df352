"""Actuators in an OpenSim file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.forces.actuators import PathActuator, PointActuator, PointToPointActuator, TorqueActuator
from solver.model import GROUND, Actuator, CoordinateActuator, WrapSurface
from solver.osim.document import Element
from solver.osim.frames import Names
from solver.osim.paths import geometry_path, read_path

Array = NDArray[np.float64]


def read_actuators(element: Element, names: Names, surfaces: Sequence[WrapSurface]) -> list[Actuator]:
    """One actuator for each control: six for a BodyActuator."""
    return _READERS[element.tag](element, names, surfaces)


class _Strength(TypedDict):
    name: str
    optimal_force: float
    min_control: float
    max_control: float


def _strength(element: Element) -> _Strength:
    least = element.number("min_control", "-inf", may_be_infinite=True)
    greatest = element.number("max_control", "inf", may_be_infinite=True)
    if not least <= greatest:
        raise element.refusal(f"has a min_control of {least:g} above its max_control of {greatest:g}; exchange them")
    force = element.number("optimal_force", "1")
    if not force:
        sentence = "has an <optimal_force> of 0, so that it gives no force; correct it, or remove the actuator"
        raise element.refusal(sentence, SolverCode.NOT_POSITIVE)
    return _Strength(name=element.name, optimal_force=force, min_control=least, max_control=greatest)


def _on_coordinate(element: Element, names: Names, _: Sequence[WrapSurface]) -> list[Actuator]:
    coordinate = names.coordinate(element, element.child("coordinate").text)
    return [CoordinateActuator(coordinate=coordinate, **_strength(element))]


def _along_path(element: Element, names: Names, surfaces: Sequence[WrapSurface]) -> list[Actuator]:
    return [PathActuator(path=read_path(geometry_path(element), names, surfaces), **_strength(element))]


def _at_point(element: Element, names: Names, _: Sequence[WrapSurface]) -> list[Actuator]:
    return [
        PointActuator(
            body=names.body(element, "body"),
            point=element.numbers("point", 3, "0 0 0"),
            direction=_unit(element, "direction", "1 0 0"),
            is_point_in_ground=element.flag("point_is_global"),
            is_direction_in_ground=element.flag("force_is_global"),
            **_strength(element),
        )
    ]


def _torque(element: Element, names: Names, _: Sequence[WrapSurface]) -> list[Actuator]:
    """The axis is in the frame bodyA, which may be an offset frame."""
    frame_a, frame_b = (names.named_frame(element, tag) for tag in ("bodyA", "bodyB"))
    axis, is_in_ground = _unit(element, "axis", "0 0 1"), element.flag("torque_is_global", "true")
    return [
        TorqueActuator(
            body_a=frame_a.body,
            body_b=frame_b.body,
            axis=axis if is_in_ground else frame_a.placement.rotation @ axis,
            is_axis_in_ground=is_in_ground,
            **_strength(element),
        )
    ]


def _between_points(element: Element, names: Names, _: Sequence[WrapSurface]) -> list[Actuator]:
    body_a, body_b = (names.body(element, tag) for tag in ("bodyA", "bodyB"))
    if body_a == body_b:
        raise element.refusal("acts between two points of the same body, which has no effect; correct bodyA or bodyB")
    return [
        PointToPointActuator(
            body_a=body_a,
            body_b=body_b,
            point_a=element.numbers("pointA", 3, "0 0 0"),
            point_b=element.numbers("pointB", 3, "0 0 0"),
            are_points_in_ground=element.flag("points_are_global"),
            **_strength(element),
        )
    ]


def _on_body(element: Element, names: Names, _: Sequence[WrapSurface]) -> list[Actuator]:
    """Six controls: moment, then force, along x, y and z. Their names are those of OpenSim's controls."""
    body = names.frame(element, "socket_body", f"/forceset/{element.name}").body
    is_in_ground, point = element.flag("spatial_force_is_global", "true"), element.numbers("point", 3, "0 0 0")
    is_point_in_ground = element.flag("point_is_global")
    moments = [
        TorqueActuator(
            name=f"{element.name}_{k}",
            optimal_force=1.0,
            body_a=body,
            body_b=GROUND,
            axis=axis,
            is_axis_in_ground=is_in_ground,
        )
        for k, axis in enumerate(np.eye(3))
    ]
    forces = [
        PointActuator(
            name=f"{element.name}_{3 + k}",
            optimal_force=1.0,
            body=body,
            point=point,
            direction=axis,
            is_point_in_ground=is_point_in_ground,
            is_direction_in_ground=is_in_ground,
        )
        for k, axis in enumerate(np.eye(3))
    ]
    return [*moments, *forces]


def _unit(element: Element, tag: str, default: str) -> Array:
    direction = element.numbers(tag, 3, default)
    length = np.linalg.norm(direction)
    if not length > 0.0:
        raise element.refusal(f"has a <{tag}> without length; give the direction of its load")
    unit: Array = direction / length
    return unit


_READERS: dict[str, Callable[[Element, Names, Sequence[WrapSurface]], list[Actuator]]] = {
    "CoordinateActuator": _on_coordinate,
    "ActivationCoordinateActuator": _on_coordinate,
    "PathActuator": _along_path,
    "PointActuator": _at_point,
    "TorqueActuator": _torque,
    "PointToPointActuator": _between_points,
    "BodyActuator": _on_body,
}
ACTUATORS = tuple(_READERS)
