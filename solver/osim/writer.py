"""Write a Model as an OpenSim 4 document, with all digits, so that the reader returns the same model.

Tendons are written as rigid, so that OpenSim's tools compute with the muscles that our results are for. Unsupported
parts are refused by name: muscles other than Millard's, and constraints other than joined points and locks.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.functions.coordinate import Function
from solver.functions.fibre import MillardCurves
from solver.model import (
    GROUND,
    NO_COORDINATE,
    BallMotion,
    Body,
    Constraint,
    Coordinate,
    CoordinateLock,
    Joint,
    Marker,
    Model,
    ModelError,
    Muscle,
    Placement,
    PointConstraint,
    ScapulothoracicMotion,
    WrapSurface,
)
from solver.osim.force_writer import add_force
from solver.osim.function_writer import add_function
from solver.osim.muscles import MILLARD_OPTIONS
from solver.osim.path_writer import add_whole_path
from solver.osim.xml_elements import VERSION, add, add_offset_frame, add_values, angles_of, frame_of, objects_of

Array = NDArray[np.float64]

AXES = ("rotation1", "rotation2", "rotation3", "translation1", "translation2", "translation3")


def osim_document(model: Model) -> Xml.Element:
    """The root of the document. Raises ModelError for anything the writer does not support."""
    root = Xml.Element("OpenSimDocument", Version=VERSION)
    written = add(root, "Model", model.name)
    add_values(written, gravity=model.gravity)
    ground = add(written, "Ground", "ground")
    _add_surfaces(ground, model, GROUND)
    for index, body in enumerate(model.bodies[1:], start=1):
        add_body(objects_of(written, "BodySet"), body.name, body.mass, body.mass_center, body.inertia)
        _add_surfaces(objects_of(written, "BodySet")[-1], model, index)
    for joint in model.joints:
        _add_joint(objects_of(written, "JointSet"), model, joint)
    for constraint in model.constraints:
        if isinstance(constraint, CoordinateLock):
            _lock(written, model.coordinate_names[constraint.coordinate], constraint.value)
            continue
        _add_constraint(objects_of(written, "ConstraintSet"), model, constraint)
    for muscle in model.muscles:
        _add_muscle(objects_of(written, "ForceSet"), model, muscle)
    for force in (*model.actuators, *model.coordinate_forces, *model.forces):
        add_force(written, model, force)
    for marker in model.markers:
        add_marker(objects_of(written, "MarkerSet"), model.bodies, marker)
    return root


def add_marker(objects: Xml.Element, bodies: Sequence[Body], marker: Marker) -> None:
    made = add(objects, "Marker", marker.name)
    add_values(made, socket_parent_frame=frame_of(bodies, marker.body), location=marker.location)
    add_values(made, fixed="true" if marker.is_fixed else "false")


def add_body(objects: Xml.Element, name: str, mass: float, mass_center: Array, inertia: Array) -> None:
    """inertia (3, 3) [kg m²] about the mass centre."""
    made = add(objects, "Body", name)
    six = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    add_values(made, mass=float(mass), mass_center=mass_center, inertia=six)


def add_joint(
    objects: Xml.Element, tag: str, name: str, sides: Sequence[tuple[str, Placement]], coordinates: Iterable[Coordinate]
) -> Xml.Element:
    """A joint between frames of two bodies, parent first, given by the body's path and the placement in it."""
    made = add(objects, tag, name)
    offsets = [f"{name}_{path.rsplit('/', 1)[-1]}" for path, _ in sides]
    add_values(made, socket_parent_frame=offsets[0], socket_child_frame=offsets[1])
    owned = add(made, "coordinates")
    for coordinate in coordinates:
        its = add(owned, "Coordinate", coordinate.name)
        add_values(its, default_value=coordinate.default, range=coordinate.range)
        add_values(its, clamped="true" if coordinate.is_clamped else "false")
    frames = add(made, "frames")
    for offset, (path, placement) in zip(offsets, sides, strict=True):
        add_offset_frame(frames, offset, path, placement)
    return made


def add_axes(joint: Xml.Element, axes: Array, drivers: Sequence[str], functions: Sequence[Function]) -> None:
    """A CustomJoint's six axes (6, 3), the coordinate that drives each, "" for none, and how far it moves."""
    transform = add(joint, "SpatialTransform")
    for name, axis, driver, function in zip(AXES, axes, drivers, functions, strict=True):
        made = add(transform, "TransformAxis", name)
        add_values(made, coordinates=driver, axis=axis)
        add_function(made, function, f"{joint.get('name')}.{name}")


def _add_surfaces(owner: Xml.Element, model: Model, body: int) -> None:
    for surface in model.surfaces:
        if surface.body == body:
            _add_surface(objects_of(owner, "WrapObjectSet"), surface)


def _add_surface(objects: Xml.Element, surface: WrapSurface) -> None:
    made = add(objects, f"Wrap{surface.kind.capitalize()}", surface.name)
    placement = surface.placement
    add_values(made, xyz_body_rotation=angles_of(placement.rotation), translation=placement.translation)
    add_values(made, quadrant=surface.quadrant, active=str(surface.is_active).lower())
    if surface.kind == "ellipsoid":
        add_values(made, dimensions=surface.dimensions)
    else:
        add_values(made, radius=surface.dimensions[0])
    if surface.kind == "cylinder":
        add_values(made, length=surface.dimensions[2])


def _add_joint(objects: Xml.Element, model: Model, joint: Joint) -> None:
    motion = joint.motion
    sides = [
        (frame_of(model.bodies, joint.parent), joint.frame_in_parent),
        (frame_of(model.bodies, joint.child), joint.frame_in_child),
    ]
    coordinates = [model.coordinates[index] for index in motion.coordinates]
    if isinstance(motion, ScapulothoracicMotion):
        made = add_joint(objects, "ScapulothoracicJoint", joint.name, sides, coordinates)
        add_values(
            made,
            thoracic_ellipsoid_radii_x_y_z=motion.radii,
            scapula_winging_axis_origin=motion.winging_origin,
            scapula_winging_axis_direction=motion.winging_direction,
        )
    elif isinstance(motion, BallMotion):
        add_joint(objects, "FreeJoint" if motion.sliding else "BallJoint", joint.name, sides, coordinates)
    elif not coordinates and not any(np.any(f.derivatives(np.zeros(1))[0]) for f in motion.functions):
        add_joint(objects, "WeldJoint", joint.name, sides, coordinates)
    else:
        made = add_joint(objects, "CustomJoint", joint.name, sides, coordinates)
        drivers = ["" if index == NO_COORDINATE else model.coordinates[index].name for index in motion.coordinate]
        add_axes(made, motion.axes, drivers, motion.functions)


def _lock(written: Xml.Element, name: str, value: float) -> None:
    """A lock is a property of its coordinate, at the default value."""
    coordinate = next(node for node in written.iter("Coordinate") if node.get("name") == name)
    coordinate.remove(coordinate.find("default_value"))  # type: ignore[arg-type]
    add_values(coordinate, default_value=value, locked="true")


def _add_constraint(objects: Xml.Element, model: Model, constraint: Constraint) -> None:
    if not isinstance(constraint, PointConstraint):
        raise ModelError(
            f"the writer of .osim supports only point constraints and locks, and {model.name} has {constraint.name}",
            SolverCode.NOT_WRITABLE,
        )
    add_values(
        add(objects, "PointConstraint", constraint.name),
        socket_body_1=frame_of(model.bodies, constraint.body_1),
        socket_body_2=frame_of(model.bodies, constraint.body_2),
        location_body_1=constraint.location_1,
        location_body_2=constraint.location_2,
    )


def _add_muscle(objects: Xml.Element, model: Model, muscle: Muscle) -> None:
    made = add(objects, "Millard2012EquilibriumMuscle", muscle.name)
    add_whole_path(made, model, muscle.path, muscle.name)
    add_values(
        made,
        max_isometric_force=muscle.max_isometric_force,
        optimal_fiber_length=muscle.optimal_fiber_length,
        tendon_slack_length=muscle.tendon_slack_length,
        pennation_angle_at_optimal=muscle.pennation_at_optimal,
        maximum_pennation_angle=muscle.maximum_pennation,
        max_contraction_velocity=muscle.max_contraction_velocity,
        activation_time_constant=muscle.activation_time_constant,
        deactivation_time_constant=muscle.deactivation_time_constant,
        ignore_tendon_compliance="true",
    )
    if not isinstance(muscle.curves, MillardCurves):
        raise ModelError(
            f"the writer of .osim supports only Millard's muscles, and {model.name} has {muscle.name}",
            SolverCode.NOT_WRITABLE,
        )
    for tag, options in MILLARD_OPTIONS.items():
        curve = add(made, tag, f"{muscle.name}_{tag}")
        add_values(curve, **{option: getattr(muscle.curves, field) for option, field in options.items()})
