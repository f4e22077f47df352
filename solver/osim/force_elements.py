"""Forces and actuators of an OpenSim file; each class is declared once, for the reader and for the writer."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from typing import Any

import numpy as np

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
from solver.functions.coordinate_functions import polynomial, simm_spline
from solver.model import GROUND, Actuator, Array, Coordinate, CoordinateActuator, Model, ModelError, Placement
from solver.multibody.postures import body_fixed_xyz_angles, rotation_body_fixed_xyz
from solver.osim.document import Element
from solver.osim.elements import add, add_function, add_values, body_path, find_objects
from solver.osim.force_parts import (
    BODY,
    COORDINATE,
    FRAMES,
    PATH,
    Fields,
    ForceClass,
    ForceContext,
    ForcePart,
    WrittenForce,
    body_name,
    expression_part,
    flag_part,
    named_body,
    number_part,
    own_path,
    part_by_motion,
    point_part,
    read_expression,
    socket_body,
    two_bodies_part,
    value_part,
)
from solver.osim.names import Names, read_named_function


def read_force(element: Element, context: ForceContext) -> list[Any]:
    """The force or the actuators of an element; one actuator for each control, so six for a BodyActuator."""
    if element.tag == _BODY_ACTUATOR:
        return _body_actuators(element, context)
    return [_BY_TAG[element.tag].read(element, context)]


def add_force(document: Xml.Element, model: Model, force: Any) -> None:
    """Add an actuator or a passive force to a <Model>. Raises ModelError for one of another class."""
    found = next((force_class for force_class in _BY_TAG.values() if isinstance(force, force_class.kind)), None)
    if found is None:
        raise ModelError(
            f"the writer of .osim has no class of force for {force.name} of {model.name}; remove it",
            SolverCode.NOT_WRITABLE,
        )
    found.add(document, model, force)


def _read_strength(element: Element, _: ForceContext) -> Fields:
    least = element.number("min_control", "-inf", may_be_infinite=True)
    greatest = element.number("max_control", "inf", may_be_infinite=True)
    if not least <= greatest:
        raise element.refusal(f"has a min_control of {least:g} above its max_control of {greatest:g}; exchange them")
    force = element.number("optimal_force", "1")
    if not force:
        sentence = "has an <optimal_force> of 0, so that it gives no force; correct it, or remove the actuator"
        raise element.refusal(sentence, SolverCode.NOT_POSITIVE)
    return {"optimal_force": force, "min_control": least, "max_control": greatest}


def _write_strength(written: WrittenForce, force: Any) -> None:
    limits = {tag: getattr(force, tag) for tag in ("min_control", "max_control")}
    written.add_values(
        optimal_force=force.optimal_force, **{tag: one for tag, one in limits.items() if np.isfinite(one)}
    )


_STRENGTH = ForcePart(_read_strength, _write_strength)


def _unit(element: Element, tag: str, default: str) -> Array:
    direction = element.numbers(tag, 3, default)
    length = np.linalg.norm(direction)
    if not length > 0.0:
        raise element.refusal(f"has a <{tag}> without length; give the direction of its load")
    return np.asarray(direction / length)


def _read_torque(element: Element, context: ForceContext) -> Fields:
    """The axis is in the frame bodyA, which may be an offset frame."""
    frame_a, frame_b = (context.names.named_frame(element, tag) for tag in ("bodyA", "bodyB"))
    axis, is_in_ground = _unit(element, "axis", "0 0 1"), element.flag("torque_is_global", "true")
    return {
        "body_a": frame_a.body,
        "body_b": frame_b.body,
        "axis": axis if is_in_ground else frame_a.placement.rotation @ axis,
        "is_axis_in_ground": is_in_ground,
    }


def _write_torque(written: WrittenForce, force: TorqueActuator) -> None:
    body_a, body_b = (body_name(written.model, body) for body in (force.body_a, force.body_b))
    written.add_values(bodyA=body_a, bodyB=body_b, axis=force.axis, torque_is_global=force.is_axis_in_ground)


_ACTUATORS = (
    ForceClass("CoordinateActuator", CoordinateActuator, COORDINATE, _STRENGTH),  # the one of the two that is written
    ForceClass("ActivationCoordinateActuator", CoordinateActuator, COORDINATE, _STRENGTH),
    ForceClass("PathActuator", PathActuator, PATH, _STRENGTH),
    ForceClass(
        "PointActuator",
        PointActuator,
        BODY,
        point_part("point", "point"),
        value_part("direction", lambda element: _unit(element, "direction", "1 0 0")),
        flag_part("point_is_global", "is_point_in_ground"),
        flag_part("force_is_global", "is_direction_in_ground"),
        _STRENGTH,
    ),
    ForceClass("TorqueActuator", TorqueActuator, ForcePart(_read_torque, _write_torque), _STRENGTH),
    ForceClass(
        "PointToPointActuator",
        PointToPointActuator,
        two_bodies_part(("bodyA", "bodyB"), ("body_a", "body_b"), Names.body),
        flag_part("points_are_global", "are_points_in_ground"),
        point_part("pointA", "point_a"),
        point_part("pointB", "point_b"),
        _STRENGTH,
    ),
)


def _body_actuators(element: Element, context: ForceContext) -> list[Actuator]:
    """Moment, then force, along x, y and z. Their names are those of OpenSim's controls."""
    body = context.names.frame(element, "socket_body", own_path(element)).body
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


def _unit_of_limits(coordinate: Coordinate) -> float:
    """OpenSim takes degrees for coordinates that are angles, and the coordinate itself for all others."""
    return np.pi / 180 if coordinate.motion == "rotation" else 1.0


_SIDES = ("lower", "upper")


def _read_limits(element: Element, context: ForceContext) -> Fields:
    coordinate = context.names.coordinate(element, element.child("coordinate").text)
    unit = _unit_of_limits(context.names.coordinates[coordinate])
    return {
        "coordinate": coordinate,
        "limits": tuple(element.number(f"{side}_limit", "0") * unit for side in _SIDES),
        "stiffnesses": tuple(element.number(f"{side}_stiffness", "1") / unit for side in _SIDES),
        "damping": element.number("damping", "0.001") / unit,
        "transition": element.positive("transition", "0.1") * unit,
    }


def _write_limits(written: WrittenForce, force: CoordinateLimit) -> None:
    coordinate = written.model.coordinates[force.coordinate]
    unit = _unit_of_limits(coordinate)
    written.add_values(coordinate=coordinate.name, damping=force.damping * unit, transition=force.transition / unit)
    for side, limit, stiffness in zip(_SIDES, force.limits, force.stiffnesses, strict=True):
        written.add_values(**{f"{side}_limit": limit / unit, f"{side}_stiffness": stiffness * unit})


_COORDINATE_FORCES = (
    ForceClass(
        "SpringGeneralizedForce",
        CoordinateSpring,
        COORDINATE,
        *(number_part(tag, "0") for tag in ("stiffness", "rest_length", "viscosity")),
    ),
    ForceClass("CoordinateLimitForce", CoordinateLimit, ForcePart(_read_limits, _write_limits)),
    ForceClass("ExpressionBasedCoordinateForce", CoordinateExpression, COORDINATE, expression_part("q", "qdot")),
)


_BUSHING_FUNCTIONS = tuple(
    f"{kind}_{axis}_{motion}_{axis}_function" for kind, motion in (("m", "theta"), ("f", "delta")) for axis in "xyz"
)
_BUSHING_EXPRESSIONS = tuple(f"{letter}{axis}_expression" for letter in "MF" for axis in "xyz")


def _read_functions(element: Element, _: ForceContext) -> Fields:
    found = [read_named_function(element, tag) for tag in _BUSHING_FUNCTIONS]
    return {"functions": tuple(polynomial([0.0]) if function is None else function for function in found)}


def _write_functions(written: WrittenForce, force: FunctionBushing) -> None:
    for tag, function in zip(_BUSHING_FUNCTIONS, force.functions, strict=True):
        add_function(add(written.element, tag), function, f"{force.name}.{tag}", "")


def _read_expressions(element: Element, _: ForceContext) -> Fields:
    return {"expressions": tuple(read_expression(element, tag, *DISPLACEMENTS) for tag in _BUSHING_EXPRESSIONS)}


def _write_expressions(written: WrittenForce, force: ExpressionBushing) -> None:
    texts = [expression.text for expression in force.expressions]
    written.add_values(**dict(zip(_BUSHING_EXPRESSIONS, texts, strict=True)))


_LIGAMENT_STRETCH = np.array([-5, 0.998, 0.999, 1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.601, 1.602, 5])
_LIGAMENT_FORCE = np.array([0, 0, 0, 0, 0.035, 0.12, 0.26, 0.55, 1.17, 2, 2, 2, 2])


def _read_curve(element: Element, _: ForceContext) -> Fields:
    curve = read_named_function(element, "force_length_curve")
    return {"curve": curve or simm_spline(_LIGAMENT_STRETCH, _LIGAMENT_FORCE)}


def _write_curve(written: WrittenForce, force: Ligament) -> None:
    add_function(written.element, force.curve, f"{force.name}.force_length_curve", "force_length_curve")


_POINTS = (point_part("point1", "point_1"), point_part("point2", "point_2"))
"""OpenSim takes them in the bodies, also if the frames that are named have an offset from these."""


def _read_constant(element: Element, context: ForceContext) -> Fields:
    frame = context.names.frame(element, "socket_frame", own_path(element))
    inner = frame.placement
    force, point, torque = (_constants(element, f"{kind}Functions") for kind in ("force", "point", "torque"))
    is_point_in_ground = element.flag("pointIsGlobal") and point is not None
    is_force_in_ground = element.flag("forceIsGlobal", "true")
    place = np.zeros(3) if point is None else point
    parts = [np.zeros(3) if part is None else part for part in (force, torque)]
    if not is_force_in_ground:
        parts = [inner.rotation @ part for part in parts]
    return {
        "body": frame.body,
        "point": place if is_point_in_ground else inner.translation + inner.rotation @ place,
        "force": parts[0],
        "torque": parts[1],
        "is_point_in_ground": is_point_in_ground,
        "is_force_in_ground": is_force_in_ground,
    }


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


def _write_constant(written: WrittenForce, force: ConstantForce) -> None:
    written.add_values(
        socket_frame=body_path(written.model.bodies, force.body),
        pointIsGlobal=force.is_point_in_ground,
        forceIsGlobal=force.is_force_in_ground,
    )
    for kind in ("force", "point", "torque"):
        functions = add(add(written.element, "FunctionSet", f"{kind}Functions"), "objects")
        for value in getattr(force, kind):
            add_values(add(functions, "Constant"), value=value)


_GROUPS = "HuntCrossleyForce::ContactParameters"
_FRICTION = ("dissipation", "static_friction", "dynamic_friction", "viscous_friction")


def _read_contacts(element: Element, context: ForceContext) -> Fields:
    surfaces = [
        _read_surface(_geometry(group, name, context), _material(group), context)
        for group in element.objects(f"{_GROUPS}Set")
        for name in group.word("geometry", "").split()
    ]
    return {"surfaces": tuple(surfaces)}


def _write_contacts(written: WrittenForce, force: HuntCrossleyContact) -> None:
    """Each surface becomes a geometry of its own with its material, also if several shared one."""
    groups = add(add(written.element, f"{_GROUPS}Set", "contact_parameters"), "objects")
    for index, surface in enumerate(force.surfaces, start=1):
        name = f"{force.name}_{index}"
        _add_surface(written, surface, name)
        add_values(add(groups, _GROUPS), geometry=name, **vars(surface.material))


def _read_smooth_ends(element: Element, context: ForceContext) -> Fields:
    material = _material(element, "1")
    sphere, plane = (
        _read_surface(_geometry(element, element.child(socket).text, context), material, context)
        for socket in ("socket_sphere", "socket_half_space")
    )
    if sphere.radius is None or plane.radius is not None:
        raise element.refusal("should have a sphere and a half-space for its sockets; correct their names")
    return {
        "sphere_body": sphere.body,
        "center": sphere.placement.translation,
        "radius": sphere.radius,
        "plane_body": plane.body,
        "plane": plane.placement,
    }


def _write_smooth_ends(written: WrittenForce, force: SmoothContact) -> None:
    sphere, plane = f"{force.name}_sphere", f"{force.name}_plane"
    made = add(find_objects(written.document, "ContactGeometrySet"), "ContactSphere", sphere)
    frame = body_path(written.model.bodies, force.sphere_body)
    add_values(made, socket_frame=frame, location=force.center, radius=force.radius)
    _add_surface(written, ContactSurface(force.plane_body, force.plane, None, force.material), plane)
    written.add_values(socket_sphere=f"/contactgeometryset/{sphere}", socket_half_space=f"/contactgeometryset/{plane}")


def _material(element: Element, usual_stiffness: str = "0") -> ContactMaterial:
    stiffness = element.positive("stiffness", usual_stiffness)
    return ContactMaterial(stiffness, *(element.number(name, "0") for name in _FRICTION))


def _geometry(element: Element, name: str, context: ForceContext) -> Element:
    name = name.rsplit("/", 1)[-1]
    found = next((geometry for geometry in context.geometries if geometry.name == name), None)
    if found is None:
        raise element.refusal(f"names an unknown contact geometry {name}", SolverCode.UNKNOWN_NAME)
    if found.tag not in ("ContactSphere", "ContactHalfSpace"):
        raise found.unsupported("contact geometry", "ContactSphere, ContactHalfSpace")
    return found


def _read_surface(geometry: Element, material: ContactMaterial, context: ForceContext) -> ContactSurface:
    frame = context.names.frame(geometry, "socket_frame", f"/contactgeometryset/{geometry.name}")
    outer = frame.placement
    rotation = rotation_body_fixed_xyz(geometry.numbers("orientation", 3, "0 0 0"))
    place = outer.translation + outer.rotation @ geometry.numbers("location", 3, "0 0 0")
    radius = geometry.positive("radius", "0") if geometry.tag == "ContactSphere" else None
    return ContactSurface(frame.body, Placement(outer.rotation @ rotation, place), radius, material)


def _add_surface(written: WrittenForce, surface: ContactSurface, name: str) -> None:
    tag = "ContactHalfSpace" if surface.radius is None else "ContactSphere"
    made = add(find_objects(written.document, "ContactGeometrySet"), tag, name)
    placement = surface.placement
    add_values(made, socket_frame=body_path(written.model.bodies, surface.body), location=placement.translation)
    add_values(made, orientation=body_fixed_xyz_angles(placement.rotation))
    if surface.radius is not None:
        add_values(made, radius=surface.radius)


def _path_of_body(model: Model, body: int) -> str:
    return body_path(model.bodies, body)


_FORCE_ELEMENTS = (
    ForceClass("BushingForce", Bushing, FRAMES, part_by_motion("damping"), part_by_motion("stiffness")),
    ForceClass(
        "FunctionBasedBushingForce",
        FunctionBushing,
        FRAMES,
        part_by_motion("damping"),
        ForcePart(_read_functions, _write_functions),
    ),
    ForceClass(
        "ExpressionBasedBushingForce",
        ExpressionBushing,
        FRAMES,
        part_by_motion("damping"),
        ForcePart(_read_expressions, _write_expressions),
    ),
    ForceClass(
        "PathSpring",
        PathSpring,
        PATH,
        *(number_part(tag, read=Element.not_negative) for tag in ("resting_length", "stiffness", "dissipation")),
    ),
    ForceClass(
        "ExpressionBasedPathForce",
        PathExpression,
        PATH,
        number_part("resting_length", "0", read=Element.not_negative),
        expression_part("s", "ldot"),
        flag_part("clamp_stretch", "is_clamped", "true"),
    ),
    ForceClass(
        "Ligament",
        Ligament,
        PATH,
        number_part("resting_length", read=Element.positive),
        number_part("pcsa_force", "0", "force"),
        ForcePart(_read_curve, _write_curve),
    ),
    ForceClass(
        "Blankevoort1991Ligament",
        BlankevoortLigament,
        PATH,
        number_part("slack_length", "0", "resting_length", Element.positive),
        number_part("linear_stiffness", "1", "stiffness", Element.not_negative),
        number_part("transition_strain", "0.06", read=Element.not_negative),
        number_part("damping_coefficient", "0.003", "damping", Element.not_negative),
    ),
    ForceClass(
        "PointToPointSpring",
        PointToPointSpring,
        two_bodies_part(("socket_body1", "socket_body2"), ("body_1", "body_2"), socket_body, _path_of_body),
        *_POINTS,
        number_part("stiffness", "1"),
        number_part("rest_length", "0"),
    ),
    ForceClass(
        "ExpressionBasedPointToPointForce",
        PointToPointExpression,
        two_bodies_part(("body1", "body2"), ("body_1", "body_2"), named_body),
        *_POINTS,
        expression_part("d", "ddot"),
    ),
    ForceClass("PrescribedForce", ConstantForce, ForcePart(_read_constant, _write_constant)),
    ForceClass(
        "HuntCrossleyForce",
        HuntCrossleyContact,
        ForcePart(_read_contacts, _write_contacts),
        number_part("transition_velocity", "0.01", read=Element.positive),
    ),
    ForceClass(
        "SmoothSphereHalfSpaceForce",
        SmoothContact,
        ForcePart(_read_smooth_ends, _write_smooth_ends),
        number_part("constant_contact_force", "1e-5", "offset", Element.positive),
        number_part("hertz_smoothing", "300"),
        ForcePart(
            lambda element, _: {"material": _material(element, "1")},
            lambda written, force: written.add_values(**vars(force.material)),
        ),
        number_part("transition_velocity", "0.01", read=Element.positive),
        number_part("hunt_crossley_smoothing", "50", "speed_smoothing"),
    ),
)
_BODY_ACTUATOR = "BodyActuator"
ACTUATORS = (*(one.tag for one in _ACTUATORS), _BODY_ACTUATOR)
COORDINATE_FORCES = tuple(one.tag for one in _COORDINATE_FORCES)
FORCE_ELEMENTS = tuple(one.tag for one in _FORCE_ELEMENTS)
_BY_TAG = {one.tag: one for one in (*_ACTUATORS, *_COORDINATE_FORCES, *_FORCE_ELEMENTS)}
