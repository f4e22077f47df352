"""Read forces and actuators of an OpenSim file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.forces.actuators import PathActuator, PointActuator, PointToPointActuator, TorqueActuator
from solver.forces.passive_forces import (
    DISPLACEMENTS,
    BlankevoortLigament,
    Bushing,
    ConstantForce,
    ContactMaterial,
    ContactSurface,
    CoordinateExpression,
    CoordinateLimit,
    CoordinateSpring,
    ExpressionBushing,
    FunctionBushing,
    HuntCrossleyContact,
    Ligament,
    PathExpression,
    PathSpring,
    PointToPointExpression,
    PointToPointSpring,
    SmoothContact,
)
from solver.functions.coordinate_functions import Expression, ExpressionError, polynomial, simm_spline
from solver.model import GROUND, Actuator, Coordinate, CoordinateActuator, CoordinateForce, Placement, WrapSurface
from solver.multibody.loads import ForceElement
from solver.multibody.postures import rotation_body_fixed_xyz
from solver.osim.document import Element
from solver.osim.muscle_reader import geometry_path, read_path
from solver.osim.names import Names, read_named_function

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ForceContext:
    """Objects that a force refers to: frames, wrap surfaces, and the elements of the contact geometry."""

    names: Names
    surfaces: Sequence[WrapSurface]
    geometries: Sequence[Element]


def read_force_element(element: Element, context: ForceContext) -> ForceElement:
    return _READERS[element.tag](element, context)


def _bushing(element: Element, context: ForceContext) -> Bushing:
    return Bushing(**_between_frames(element, context), stiffness=_by_motion(element, "stiffness"))


def _function_bushing(element: Element, context: ForceContext) -> FunctionBushing:
    found = [read_named_function(element, tag) for tag in BUSHING_FUNCTIONS]
    functions = tuple(polynomial([0.0]) if function is None else function for function in found)
    return FunctionBushing(**_between_frames(element, context), functions=functions)


def _expression_bushing(element: Element, context: ForceContext) -> ExpressionBushing:
    expressions = tuple(read_expression(element, tag, *DISPLACEMENTS) for tag in BUSHING_EXPRESSIONS)
    return ExpressionBushing(**_between_frames(element, context), expressions=expressions)


class _BetweenFrames(TypedDict):
    name: str
    body_1: int
    body_2: int
    frame_1: Placement
    frame_2: Placement
    damping: Array


def _between_frames(element: Element, context: ForceContext) -> _BetweenFrames:
    path = f"/forceset/{element.name}"
    context.names.add_offset_frames(element.members("frames"), path)
    one = context.names.frame(element, "socket_frame1", path)
    two = context.names.frame(element, "socket_frame2", path)
    return _BetweenFrames(
        name=element.name,
        body_1=one.body,
        body_2=two.body,
        frame_1=one.placement,
        frame_2=two.placement,
        damping=_by_motion(element, "damping"),
    )


def _by_motion(element: Element, kind: str) -> Array:
    """(6,) rotational, then translational."""
    return np.concatenate(
        [element.numbers(f"{motion}_{kind}", 3, "0 0 0") for motion in ("rotational", "translational")]
    )


BUSHING_FUNCTIONS = tuple(
    f"{kind}_{axis}_{motion}_{axis}_function" for kind, motion in (("m", "theta"), ("f", "delta")) for axis in "xyz"
)
BUSHING_EXPRESSIONS = tuple(f"{letter}{axis}_expression" for letter in "MF" for axis in "xyz")


def _path_spring(element: Element, context: ForceContext) -> PathSpring:
    return PathSpring(
        name=element.name,
        path=read_path(geometry_path(element), context.names, context.surfaces),
        resting_length=element.not_negative("resting_length"),
        stiffness=element.not_negative("stiffness"),
        dissipation=element.not_negative("dissipation"),
    )


def _path_expression(element: Element, context: ForceContext) -> PathExpression:
    return PathExpression(
        name=element.name,
        path=read_path(geometry_path(element), context.names, context.surfaces),
        resting_length=element.not_negative("resting_length", "0"),
        expression=read_expression(element, "expression", "s", "ldot"),
        is_clamped=element.flag("clamp_stretch", "true"),
    )


_LIGAMENT_STRETCH = np.array([-5, 0.998, 0.999, 1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.601, 1.602, 5])
_LIGAMENT_FORCE = np.array([0, 0, 0, 0, 0.035, 0.12, 0.26, 0.55, 1.17, 2, 2, 2, 2])


def _ligament(element: Element, context: ForceContext) -> Ligament:
    curve = read_named_function(element, "force_length_curve")
    return Ligament(
        name=element.name,
        path=read_path(geometry_path(element), context.names, context.surfaces),
        resting_length=element.positive("resting_length"),
        force=element.number("pcsa_force", "0"),
        curve=curve or simm_spline(_LIGAMENT_STRETCH, _LIGAMENT_FORCE),
    )


def _blankevoort_ligament(element: Element, context: ForceContext) -> BlankevoortLigament:
    return BlankevoortLigament(
        name=element.name,
        path=read_path(geometry_path(element), context.names, context.surfaces),
        resting_length=element.positive("slack_length", "0"),
        stiffness=element.not_negative("linear_stiffness", "1"),
        transition_strain=element.not_negative("transition_strain", "0.06"),
        damping=element.not_negative("damping_coefficient", "0.003"),
    )


class _BetweenPoints(TypedDict):
    name: str
    body_1: int
    body_2: int
    point_1: Array
    point_2: Array


def _between_points(element: Element, body_1: int, body_2: int) -> _BetweenPoints:
    """OpenSim takes the points in the bodies, also if the frames that are named have an offset from them."""
    if body_1 == body_2:
        raise element.refusal("acts between two points of the same body, which has no effect; correct its bodies")
    points = [element.numbers(tag, 3, "0 0 0") for tag in ("point1", "point2")]
    return _BetweenPoints(name=element.name, body_1=body_1, body_2=body_2, point_1=points[0], point_2=points[1])


def _point_spring(element: Element, context: ForceContext) -> PointToPointSpring:
    path = f"/forceset/{element.name}"
    one, two = (context.names.frame(element, socket, path).body for socket in ("socket_body1", "socket_body2"))
    return PointToPointSpring(
        **_between_points(element, one, two),
        stiffness=element.number("stiffness", "1"),
        rest_length=element.number("rest_length", "0"),
    )


def _point_expression(element: Element, context: ForceContext) -> PointToPointExpression:
    one, two = (context.names.named_frame(element, tag).body for tag in ("body1", "body2"))
    expression = read_expression(element, "expression", "d", "ddot")
    return PointToPointExpression(**_between_points(element, one, two), expression=expression)


def _prescribed(element: Element, context: ForceContext) -> ConstantForce:
    frame = context.names.frame(element, "socket_frame", f"/forceset/{element.name}")
    inner = frame.placement
    force, point, torque = (_constants(element, f"{kind}Functions") for kind in ("force", "point", "torque"))
    is_point_in_ground = element.flag("pointIsGlobal") and point is not None
    is_force_in_ground = element.flag("forceIsGlobal", "true")
    place = np.zeros(3) if point is None else point
    parts = [np.zeros(3) if part is None else part for part in (force, torque)]
    if not is_force_in_ground:
        parts = [inner.rotation @ part for part in parts]
    return ConstantForce(
        name=element.name,
        body=frame.body,
        point=place if is_point_in_ground else inner.translation + inner.rotation @ place,
        force=parts[0],
        torque=parts[1],
        is_point_in_ground=is_point_in_ground,
        is_force_in_ground=is_force_in_ground,
    )


def _constants(element: Element, name: str) -> Array | None:
    """(3,) values of the functions of that name; None without them. OpenSim applies none unless there are three."""
    found = next((child for child in element.children if name in (child.name, child.tag)), None)
    functions = found.members("objects") if found is not None else []
    if len(functions) != 3:
        return None
    for function in functions:
        if function.tag != "Constant":
            raise function.refusal(
                f"makes {element.tag} {element.name} depend on time; the solver reads only constants, so give the "
                "force as an external load (--external-loads)",
                SolverCode.UNSUPPORTED,
            )
    return np.array([function.number("value", "0") for function in functions])


def _hunt_crossley(element: Element, context: ForceContext) -> HuntCrossleyContact:
    groups = element.objects("HuntCrossleyForce::ContactParametersSet")
    surfaces = [
        _surface(_geometry(group, name, context), _material(group), context)
        for group in groups
        for name in group.word("geometry", "").split()
    ]
    return HuntCrossleyContact(element.name, tuple(surfaces), element.positive("transition_velocity", "0.01"))


def _smooth_contact(element: Element, context: ForceContext) -> SmoothContact:
    ends = [
        _surface(_geometry(element, element.child(socket).text, context), _material(element, "1"), context)
        for socket in ("socket_sphere", "socket_half_space")
    ]
    sphere, plane = ends
    if sphere.radius is None or plane.radius is not None:
        raise element.refusal("should have a sphere and a half-space for its sockets; correct their names")
    return SmoothContact(
        name=element.name,
        sphere_body=sphere.body,
        center=sphere.placement.translation,
        radius=sphere.radius,
        plane_body=plane.body,
        plane=plane.placement,
        material=sphere.material,
        transition_velocity=element.positive("transition_velocity", "0.01"),
        offset=element.positive("constant_contact_force", "1e-5"),
        hertz_smoothing=element.number("hertz_smoothing", "300"),
        speed_smoothing=element.number("hunt_crossley_smoothing", "50"),
    )


def _material(group: Element, usual_stiffness: str = "0") -> ContactMaterial:
    names = ("dissipation", "static_friction", "dynamic_friction", "viscous_friction")
    return ContactMaterial(group.positive("stiffness", usual_stiffness), *(group.number(name, "0") for name in names))


def _geometry(group: Element, name: str, context: ForceContext) -> Element:
    name = name.rsplit("/", 1)[-1]
    found = next((geometry for geometry in context.geometries if geometry.name == name), None)
    if found is None:
        raise group.refusal(f"names an unknown contact geometry {name}", SolverCode.UNKNOWN_NAME)
    if found.tag not in ("ContactSphere", "ContactHalfSpace"):
        raise found.unsupported("contact geometry", "ContactSphere, ContactHalfSpace")
    return found


def _surface(geometry: Element, material: ContactMaterial, context: ForceContext) -> ContactSurface:
    frame = context.names.frame(geometry, "socket_frame", f"/contactgeometryset/{geometry.name}")
    outer = frame.placement
    rotation = rotation_body_fixed_xyz(geometry.numbers("orientation", 3, "0 0 0"))
    place = outer.translation + outer.rotation @ geometry.numbers("location", 3, "0 0 0")
    radius = geometry.positive("radius", "0") if geometry.tag == "ContactSphere" else None
    return ContactSurface(frame.body, Placement(outer.rotation @ rotation, place), radius, material)


_READERS: dict[str, Callable[[Element, ForceContext], ForceElement]] = {
    "BushingForce": _bushing,
    "FunctionBasedBushingForce": _function_bushing,
    "ExpressionBasedBushingForce": _expression_bushing,
    "PathSpring": _path_spring,
    "ExpressionBasedPathForce": _path_expression,
    "Ligament": _ligament,
    "Blankevoort1991Ligament": _blankevoort_ligament,
    "PointToPointSpring": _point_spring,
    "ExpressionBasedPointToPointForce": _point_expression,
    "PrescribedForce": _prescribed,
    "HuntCrossleyForce": _hunt_crossley,
    "SmoothSphereHalfSpaceForce": _smooth_contact,
}
FORCE_ELEMENTS = tuple(_READERS)


def read_coordinate_force(element: Element, names: Names) -> CoordinateForce:
    return _COORDINATE_FORCES[element.tag](element, names, names.coordinate(element, element.child("coordinate").text))


def read_expression(element: Element, tag: str, *variables: str) -> Expression:
    """The formula in a property, 0 without it. Raises ModelError for one that is not arithmetic in the variables."""
    try:
        return Expression(element.word(tag, "0.0") or "0.0", variables)
    except ExpressionError as error:
        raise (element.find(tag) or element).refusal(f"of {element.tag} {element.name} {error}") from None


def unit_of_limits(coordinate: Coordinate) -> float:
    """OpenSim takes degrees for coordinates that are angles, and the coordinate itself for all others."""
    return np.pi / 180 if coordinate.motion == "rotation" else 1.0


def _spring(element: Element, _: Names, coordinate: int) -> CoordinateForce:
    stiffness, rest_length, viscosity = (element.number(tag, "0") for tag in ("stiffness", "rest_length", "viscosity"))
    return CoordinateSpring(element.name, coordinate, stiffness, rest_length, viscosity)


def _limits(element: Element, names: Names, coordinate: int) -> CoordinateForce:
    unit = unit_of_limits(names.coordinates[coordinate])
    sides = ("lower", "upper")
    return CoordinateLimit(
        element.name,
        coordinate,
        limits=tuple(element.number(f"{side}_limit", "0") * unit for side in sides),  # type: ignore[arg-type]
        stiffnesses=tuple(element.number(f"{side}_stiffness", "1") / unit for side in sides),  # type: ignore[arg-type]
        damping=element.number("damping", "0.001") / unit,
        transition=element.positive("transition", "0.1") * unit,
    )


def _formula(element: Element, _: Names, coordinate: int) -> CoordinateForce:
    return CoordinateExpression(element.name, coordinate, read_expression(element, "expression", "q", "qdot"))


_COORDINATE_FORCES: dict[str, Callable[[Element, Names, int], CoordinateForce]] = {
    "SpringGeneralizedForce": _spring,
    "CoordinateLimitForce": _limits,
    "ExpressionBasedCoordinateForce": _formula,
}
COORDINATE_FORCES = tuple(_COORDINATE_FORCES)


def read_actuators(element: Element, names: Names, surfaces: Sequence[WrapSurface]) -> list[Actuator]:
    """One actuator for each control: six for a BodyActuator."""
    return _ACTUATORS[element.tag](element, names, surfaces)


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


def _point_to_point(element: Element, names: Names, _: Sequence[WrapSurface]) -> list[Actuator]:
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
    return np.asarray(direction / length)


_ACTUATORS: dict[str, Callable[[Element, Names, Sequence[WrapSurface]], list[Actuator]]] = {
    "CoordinateActuator": _on_coordinate,
    "ActivationCoordinateActuator": _on_coordinate,
    "PathActuator": _along_path,
    "PointActuator": _at_point,
    "TorqueActuator": _torque,
    "PointToPointActuator": _point_to_point,
    "BodyActuator": _on_body,
}
ACTUATORS = tuple(_ACTUATORS)
