"""Forces, actuators and muscles in an OpenSim document, with all digits, so that the reader returns the same.

Tendons of muscles are rigid (model_writer.py); their curves stay in the file.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.forces.actuators import PathActuator, PointActuator, PointToPointActuator, TorqueActuator
from solver.forces.passive_forces import (
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
from solver.functions.muscle_curves import (
    DeGrooteFreglyCurves,
    DeGrooteFreglyTendon,
    MillardCurves,
    MillardTendon,
    SchutteCurves,
    ThelenCurves,
    ThelenTendon,
)
from solver.model import GROUND, CoordinateActuator, Model, ModelError, Muscle, Placement
from solver.multibody.postures import body_fixed_xyz_angles
from solver.osim.elements import (
    add,
    add_function,
    add_offset_frame,
    add_values,
    add_whole_path,
    body_path,
    find_objects,
)
from solver.osim.force_reader import BUSHING_EXPRESSIONS, BUSHING_FUNCTIONS, unit_of_limits
from solver.osim.muscle_reader import MILLARD_OPTIONS, THELEN_OPTIONS

Array = NDArray[np.float64]
_FRICTION = ("dissipation", "static_friction", "dynamic_friction", "viscous_friction")
_CLASSES = {
    MillardCurves: "Millard2012EquilibriumMuscle",
    ThelenCurves: "Thelen2003Muscle",
    DeGrooteFreglyCurves: "DeGrooteFregly2016Muscle",
    SchutteCurves: "Schutte1993Muscle_Deprecated",
}

_ALWAYS_ELASTIC = (ThelenCurves, SchutteCurves)  # OpenSim has no rigid tendon for their muscles


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
    made = add(find_objects(written, "ForceSet"), tag, force.name)
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
    made = add(find_objects(written, "ForceSet"), "PathActuator", force.name)
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
        add_offset_frame(frames, name, body_path(model.bodies, body), placement)
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
    made = add(find_objects(written, "ForceSet"), tag, force.name)
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
    bodies = [body_path(model.bodies, body) for body in (force.body_1, force.body_2)]
    values = {"socket_body1": bodies[0], "socket_body2": bodies[1], "point1": force.point_1, "point2": force.point_2}
    spring = {"stiffness": force.stiffness, "rest_length": force.rest_length}
    _force(written, "PointToPointSpring", force, **values, **spring)


def _point_expression(written: Xml.Element, model: Model, force: PointToPointExpression) -> None:
    bodies = [_body_name(model, body) for body in (force.body_1, force.body_2)]
    values = {"body1": bodies[0], "body2": bodies[1], "point1": force.point_1, "point2": force.point_2}
    _force(written, "ExpressionBasedPointToPointForce", force, **values, expression=force.expression.text)


def _constant_force(written: Xml.Element, model: Model, force: ConstantForce) -> None:
    flags = {"pointIsGlobal": force.is_point_in_ground, "forceIsGlobal": force.is_force_in_ground}
    made = _force(written, "PrescribedForce", force, socket_frame=body_path(model.bodies, force.body), **flags)
    for kind in ("force", "point", "torque"):
        functions = add(add(made, "FunctionSet", f"{kind}Functions"), "objects")
        for value in getattr(force, kind):
            add_values(add(functions, "Constant"), value=value)


def _hunt_crossley(written: Xml.Element, model: Model, force: HuntCrossleyContact) -> None:
    """Each surface becomes a geometry of its own with its material, also if several shared one."""
    made = add(find_objects(written, "ForceSet"), "HuntCrossleyForce", force.name)
    groups = add(add(made, "HuntCrossleyForce::ContactParametersSet", "contact_parameters"), "objects")
    for index, surface in enumerate(force.surfaces, start=1):
        name = f"{force.name}_{index}"
        _add_surface(written, model, surface, name)
        group = add(groups, "HuntCrossleyForce::ContactParameters")
        add_values(group, geometry=name, **_material(surface.material))
    add_values(made, transition_velocity=force.transition_velocity)


def _smooth_contact(written: Xml.Element, model: Model, force: SmoothContact) -> None:
    sphere, plane = f"{force.name}_sphere", f"{force.name}_plane"
    shapes = find_objects(written, "ContactGeometrySet")
    made = add(shapes, "ContactSphere", sphere)
    add_values(
        made, socket_frame=body_path(model.bodies, force.sphere_body), location=force.center, radius=force.radius
    )
    _add_surface(written, model, ContactSurface(force.plane_body, force.plane, None, force.material), plane)
    values = {"socket_sphere": f"/contactgeometryset/{sphere}", "socket_half_space": f"/contactgeometryset/{plane}"}
    values |= {"constant_contact_force": force.offset, "hertz_smoothing": force.hertz_smoothing}  # type: ignore[dict-item]
    contact = add(find_objects(written, "ForceSet"), "SmoothSphereHalfSpaceForce", force.name)
    add_values(contact, **values, **_material(force.material), transition_velocity=force.transition_velocity)
    add_values(contact, hunt_crossley_smoothing=force.speed_smoothing)


def _add_surface(written: Xml.Element, model: Model, surface: ContactSurface, name: str) -> None:
    tag = "ContactHalfSpace" if surface.radius is None else "ContactSphere"
    made = add(find_objects(written, "ContactGeometrySet"), tag, name)
    placement = surface.placement
    add_values(made, socket_frame=body_path(model.bodies, surface.body), location=placement.translation)
    add_values(made, orientation=body_fixed_xyz_angles(placement.rotation))
    if surface.radius is not None:
        add_values(made, radius=surface.radius)


def _material(material: ContactMaterial) -> dict[str, float]:
    return {tag: getattr(material, tag) for tag in ("stiffness", *_FRICTION)}


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
    HuntCrossleyContact: _hunt_crossley,
    SmoothContact: _smooth_contact,
}


def add_muscle(objects: Xml.Element, model: Model, muscle: Muscle) -> None:
    made = add(objects, _CLASSES[type(muscle.curves)], muscle.name)
    add_whole_path(made, model, muscle.path, muscle.name)
    add_values(
        made,
        max_isometric_force=muscle.max_isometric_force,
        optimal_fiber_length=muscle.optimal_fiber_length,
        tendon_slack_length=muscle.tendon_slack_length,
        pennation_angle_at_optimal=muscle.pennation_at_optimal,
        min_control=muscle.min_control,
        max_control=muscle.max_control,
        ignore_tendon_compliance=not isinstance(muscle.curves, _ALWAYS_ELASTIC),
        ignore_activation_dynamics=not _has_activation_dynamics(muscle),
    )
    if isinstance(muscle.curves, SchutteCurves):
        _add_schutte(made, muscle, muscle.curves)
        return
    add_values(made, max_contraction_velocity=muscle.max_contraction_velocity)
    if _has_activation_dynamics(muscle):
        add_values(
            made,
            activation_time_constant=muscle.activation_time_constant,
            deactivation_time_constant=muscle.deactivation_time_constant,
        )
    if isinstance(muscle.curves, DeGrooteFreglyCurves):
        _add_de_groote_fregly(made, muscle, muscle.curves)
        return
    add_values(made, maximum_pennation_angle=muscle.maximum_pennation)
    if isinstance(muscle.curves, ThelenCurves):
        add_values(made, **{option: getattr(muscle.curves, field) for option, field in THELEN_OPTIONS.items()})
        if isinstance(muscle.tendon, ThelenTendon):
            add_values(made, FmaxTendonStrain=muscle.tendon.strain)
    else:
        _add_millard(made, muscle)


def _has_activation_dynamics(muscle: Muscle) -> bool:
    return muscle.activation_time_constant > 0.0 or muscle.deactivation_time_constant > 0.0


def _add_millard(made: Xml.Element, muscle: Muscle) -> None:
    add_values(made, fiber_damping=muscle.fiber_damping)
    for tag, options in MILLARD_OPTIONS.items():
        curve = add(made, tag, f"{muscle.name}_{tag}")
        add_values(curve, **{option: getattr(muscle.curves, field) for option, field in options.items()})
    if isinstance(muscle.tendon, MillardTendon):
        tendon = muscle.tendon
        add_values(
            add(made, "TendonForceLengthCurve", f"{muscle.name}_TendonForceLengthCurve"),
            strain_at_one_norm_force=tendon.strain,
            stiffness_at_one_norm_force=tendon.stiffness,
            norm_force_at_toe_end=tendon.toe_force,
            curviness=tendon.curviness,
        )


def _add_de_groote_fregly(made: Xml.Element, muscle: Muscle, curves: DeGrooteFreglyCurves) -> None:
    add_values(
        made,
        active_force_width_scale=curves.width,
        passive_fiber_strain_at_one_norm_force=curves.passive_strain,
        ignore_passive_fiber_force=not curves.has_passive_force,
        fiber_damping=muscle.fiber_damping,
    )
    if isinstance(muscle.tendon, DeGrooteFreglyTendon):
        add_values(made, tendon_strain_at_one_norm_force=muscle.tendon.strain)


def _add_schutte(made: Xml.Element, muscle: Muscle, curves: SchutteCurves) -> None:
    """Its file has rates: activation2 at no excitation, and activation1 more at full excitation, over a time scale."""
    scale = 1.0 / muscle.max_contraction_velocity
    add_values(made, time_scale=scale)
    if _has_activation_dynamics(muscle):
        fall = scale / muscle.deactivation_time_constant
        rise = scale / muscle.activation_time_constant - fall
        add_values(made, activation1=rise, activation2=fall)
    add_function(made, curves.active, muscle.name, "active_force_length_curve")
    if curves.passive is not None:
        add_function(made, curves.passive, muscle.name, "passive_force_length_curve")
