"""Forces and actuators in an OpenSim document, with all digits, so that the reader returns the same."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.forces.actuators import PathActuator, PointActuator, PointToPointActuator, TorqueActuator
from solver.forces.bushing import Bushing, ExpressionBushing, FunctionBushing
from solver.forces.coordinate_force import CoordinateExpression, CoordinateLimit, CoordinateSpring
from solver.forces.path_force import BlankevoortLigament, Ligament, PathExpression, PathSpring
from solver.forces.point_force import ConstantForce, PointToPointExpression, PointToPointSpring
from solver.model import GROUND, CoordinateActuator, Model, ModelError, Placement
from solver.osim.contact_writer import CONTACTS
from solver.osim.force_elements import BUSHING_EXPRESSIONS, BUSHING_FUNCTIONS
from solver.osim.forces import unit_of_limits
from solver.osim.function_writer import add_function
from solver.osim.path_writer import add_whole_path
from solver.osim.xml_elements import add, add_offset_frame, add_values, frame_of, objects_of

Array = NDArray[np.float64]


def add_force(written: Xml.Element, model: Model, force: Any) -> None:
    """Add an actuator or a passive force of the model. Raises ModelError for one of another class."""
    adds = next((adds for kind, adds in _WRITERS.items() if isinstance(force, kind)), None)
    if adds is None:
        raise ModelError(
            f"the writer of .osim has no class of force for {force.name} of {model.name}; remove it",
            SolverCode.NOT_WRITABLE,
        )
    adds(written, model, force)


def _force(written: Xml.Element, tag: str, force: Any, **values: Any) -> Xml.Element:
    made = add(objects_of(written, "ForceSet"), tag, force.name)
    add_values(made, **values)
    return made


def _coordinate(model: Model, force: Any) -> str:
    name: str = model.coordinates[force.coordinate].name
    return name


def _body_name(model: Model, body: int) -> str:
    return "ground" if body == GROUND else model.bodies[body].name


def _strength(force: Any) -> dict[str, float]:
    limits = {tag: getattr(force, tag) for tag in ("min_control", "max_control")}
    return {"optimal_force": force.optimal_force} | {tag: one for tag, one in limits.items() if np.isfinite(one)}


def _coordinate_actuator(written: Xml.Element, model: Model, force: CoordinateActuator) -> None:
    _force(written, "CoordinateActuator", force, coordinate=_coordinate(model, force), **_strength(force))


def _path_actuator(written: Xml.Element, model: Model, force: PathActuator) -> None:
    made = add(objects_of(written, "ForceSet"), "PathActuator", force.name)
    add_whole_path(made, model, force.path, force.name)
    add_values(made, **_strength(force))


def _point_actuator(written: Xml.Element, model: Model, force: PointActuator) -> None:
    values = {"body": model.bodies[force.body].name, "point": force.point, "direction": force.direction}
    flags = {"point_is_global": force.is_point_in_ground, "force_is_global": force.is_direction_in_ground}
    _force(written, "PointActuator", force, **values, **flags, **_strength(force))


def _torque_actuator(written: Xml.Element, model: Model, force: TorqueActuator) -> None:
    values = {"bodyA": _body_name(model, force.body_a), "bodyB": _body_name(model, force.body_b)}
    axis = {"axis": force.axis, "torque_is_global": force.is_axis_in_ground}
    _force(written, "TorqueActuator", force, **values, **axis, **_strength(force))


def _point_to_point_actuator(written: Xml.Element, model: Model, force: PointToPointActuator) -> None:
    bodies = {"bodyA": _body_name(model, force.body_a), "bodyB": _body_name(model, force.body_b)}
    points = {"points_are_global": force.are_points_in_ground, "pointA": force.point_a, "pointB": force.point_b}
    _force(written, "PointToPointActuator", force, **bodies, **points, **_strength(force))


def _coordinate_spring(written: Xml.Element, model: Model, force: CoordinateSpring) -> None:
    values = {"stiffness": force.stiffness, "rest_length": force.rest_length, "viscosity": force.viscosity}
    _force(written, "SpringGeneralizedForce", force, coordinate=_coordinate(model, force), **values)


def _coordinate_limit(written: Xml.Element, model: Model, force: CoordinateLimit) -> None:
    unit = unit_of_limits(model.coordinates[force.coordinate])
    values = {"damping": force.damping * unit, "transition": force.transition / unit}
    for side, limit, stiffness in zip(("lower", "upper"), force.limits, force.stiffnesses, strict=True):
        values |= {f"{side}_limit": limit / unit, f"{side}_stiffness": stiffness * unit}
    _force(written, "CoordinateLimitForce", force, coordinate=_coordinate(model, force), **values)


def _coordinate_expression(written: Xml.Element, model: Model, force: CoordinateExpression) -> None:
    values = {"coordinate": _coordinate(model, force), "expression": force.expression.text}
    _force(written, "ExpressionBasedCoordinateForce", force, **values)


def _between_frames(written: Xml.Element, model: Model, force: Any, tag: str) -> Xml.Element:
    names = [f"{force.name}_frame{number}" for number in (1, 2)]
    made = _force(written, tag, force, socket_frame1=names[0], socket_frame2=names[1])
    frames = add(made, "frames")
    ends: list[tuple[int, Placement]] = [(force.body_1, force.frame_1), (force.body_2, force.frame_2)]
    for name, (body, placement) in zip(names, ends, strict=True):
        add_offset_frame(frames, name, frame_of(model.bodies, body), placement)
    add_values(made, rotational_damping=force.damping[:3], translational_damping=force.damping[3:])
    return made


def _bushing(written: Xml.Element, model: Model, force: Bushing) -> None:
    made = _between_frames(written, model, force, "BushingForce")
    add_values(made, rotational_stiffness=force.stiffness[:3], translational_stiffness=force.stiffness[3:])


def _function_bushing(written: Xml.Element, model: Model, force: FunctionBushing) -> None:
    made = _between_frames(written, model, force, "FunctionBasedBushingForce")
    for tag, function in zip(BUSHING_FUNCTIONS, force.functions, strict=True):
        add_function(add(made, tag), function, f"{force.name}.{tag}", "")


def _expression_bushing(written: Xml.Element, model: Model, force: ExpressionBushing) -> None:
    made = _between_frames(written, model, force, "ExpressionBasedBushingForce")
    texts = [expression.text for expression in force.expressions]
    add_values(made, **dict(zip(BUSHING_EXPRESSIONS, texts, strict=True)))


def _along_path(written: Xml.Element, model: Model, force: Any, tag: str, **values: Any) -> Xml.Element:
    made = add(objects_of(written, "ForceSet"), tag, force.name)
    add_whole_path(made, model, force.path, force.name)
    add_values(made, **values)
    return made


def _path_spring(written: Xml.Element, model: Model, force: PathSpring) -> None:
    values = {tag: getattr(force, tag) for tag in ("resting_length", "stiffness", "dissipation")}
    _along_path(written, model, force, "PathSpring", **values)


def _path_expression(written: Xml.Element, model: Model, force: PathExpression) -> None:
    values = {"expression": force.expression.text, "clamp_stretch": force.is_clamped}
    _along_path(written, model, force, "ExpressionBasedPathForce", resting_length=force.resting_length, **values)


def _ligament(written: Xml.Element, model: Model, force: Ligament) -> None:
    values = {"resting_length": force.resting_length, "pcsa_force": force.force}
    made = _along_path(written, model, force, "Ligament", **values)
    add_function(made, force.curve, f"{force.name}.force_length_curve", "force_length_curve")


def _blankevoort_ligament(written: Xml.Element, model: Model, force: BlankevoortLigament) -> None:
    values = {"slack_length": force.resting_length, "linear_stiffness": force.stiffness}
    values |= {"transition_strain": force.transition_strain, "damping_coefficient": force.damping}
    _along_path(written, model, force, "Blankevoort1991Ligament", **values)


def _point_spring(written: Xml.Element, model: Model, force: PointToPointSpring) -> None:
    bodies = [frame_of(model.bodies, body) for body in (force.body_1, force.body_2)]
    values = {"socket_body1": bodies[0], "socket_body2": bodies[1], "point1": force.point_1, "point2": force.point_2}
    spring = {"stiffness": force.stiffness, "rest_length": force.rest_length}
    _force(written, "PointToPointSpring", force, **values, **spring)


def _point_expression(written: Xml.Element, model: Model, force: PointToPointExpression) -> None:
    bodies = [_body_name(model, body) for body in (force.body_1, force.body_2)]
    values = {"body1": bodies[0], "body2": bodies[1], "point1": force.point_1, "point2": force.point_2}
    _force(written, "ExpressionBasedPointToPointForce", force, **values, expression=force.expression.text)


def _constant_force(written: Xml.Element, model: Model, force: ConstantForce) -> None:
    flags = {"pointIsGlobal": force.is_point_in_ground, "forceIsGlobal": force.is_force_in_ground}
    made = _force(written, "PrescribedForce", force, socket_frame=frame_of(model.bodies, force.body), **flags)
    for kind in ("force", "point", "torque"):
        functions = add(add(made, "FunctionSet", f"{kind}Functions"), "objects")
        for value in getattr(force, kind):
            add_values(add(functions, "Constant"), value=value)


_WRITERS: dict[type, Callable[[Xml.Element, Model, Any], None]] = {
    CoordinateActuator: _coordinate_actuator,
    PathActuator: _path_actuator,
    PointActuator: _point_actuator,
    TorqueActuator: _torque_actuator,
    PointToPointActuator: _point_to_point_actuator,
    CoordinateSpring: _coordinate_spring,
    CoordinateLimit: _coordinate_limit,
    CoordinateExpression: _coordinate_expression,
    Bushing: _bushing,
    FunctionBushing: _function_bushing,
    ExpressionBushing: _expression_bushing,
    PathSpring: _path_spring,
    PathExpression: _path_expression,
    Ligament: _ligament,
    BlankevoortLigament: _blankevoort_ligament,
    PointToPointSpring: _point_spring,
    PointToPointExpression: _point_expression,
    ConstantForce: _constant_force,
    **CONTACTS,
}
