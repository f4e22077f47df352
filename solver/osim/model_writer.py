"""Write a Model as an OpenSim 4 document, with all digits, so that the reader returns the same model; and its markers.

Tendons are written as rigid, so that OpenSim's tools compute with the muscles that our results are for. What no class
of OpenSim has is refused by name: functions by pieces that are none of its splines, and moving points in offset frames.
A MarkerSet file has body and location of every marker.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from solver.constraint import (
    ConstantDistanceConstraint,
    Constraint,
    CoordinateCoupler,
    CoordinateLock,
    CoordinatePrescription,
    PointConstraint,
    PointOnLineConstraint,
)
from solver.errors import SolverCode
from solver.functions.coordinate_functions import Function
from solver.model import (
    GROUND,
    NO_COORDINATE,
    Array,
    BallMotion,
    Body,
    Coordinate,
    Joint,
    Marker,
    Model,
    Placement,
    ScapulothoracicMotion,
    WrapSurface,
)
from solver.multibody.postures import body_fixed_xyz_angles
from solver.osim.document import DRAWN, Element, read_document
from solver.osim.elements import VERSION, add, add_function, add_offset_frame, add_values, body_path, find_objects
from solver.osim.force_elements import add_force
from solver.osim.muscle_elements import add_muscle

AXES = ("rotation1", "rotation2", "rotation3", "translation1", "translation2", "translation3")


def osim_document(model: Model) -> Xml.Element:
    """The root of the document. Raises ModelError for anything the writer does not support."""
    root = Xml.Element("OpenSimDocument", Version=VERSION)
    written = add(root, "Model", model.name)
    add_values(written, gravity=model.gravity)
    ground = add(written, "Ground", "ground")
    _add_surfaces(ground, model, GROUND)
    for index, body in enumerate(model.bodies[1:], start=1):
        add_body(find_objects(written, "BodySet"), body.name, body.mass, body.mass_center, body.inertia)
        _add_surfaces(find_objects(written, "BodySet")[-1], model, index)
    for joint in model.joints:
        _add_joint(find_objects(written, "JointSet"), model, joint)
    for constraint in model.constraints:
        add_constraint(written, model, constraint)
    for muscle in model.muscles:
        add_muscle(find_objects(written, "ForceSet"), model, muscle)
    for force in (*model.actuators, *model.coordinate_forces, *model.forces):
        add_force(written, model, force)
    for marker in model.markers:
        _add_marker(find_objects(written, "MarkerSet"), model.bodies, marker)
    return root


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


def add_axes(
    joint: Xml.Element,
    axes: Array,
    drivers: Sequence[str],
    functions: Sequence[Function],
    coupled: Collection[str] = (),
) -> None:
    """A CustomJoint's six axes (6, 3), the coordinate that drives each, "" for none, and how far it moves.

    coupled  coordinates that are neither angles nor distances; OpenSim takes one for such by its LinearFunction
    """
    transform = add(joint, "SpatialTransform")
    for name, axis, driver, function in zip(AXES, axes, drivers, functions, strict=True):
        made = add(transform, "TransformAxis", name)
        add_values(made, coordinates=driver, axis=axis)
        holder = made
        if driver in coupled:
            multiplier = add(made, "MultiplierFunction", "function")
            holder = add(multiplier, "function")
            add_values(multiplier, scale=1.0)
        add_function(holder, function, f"{joint.get('name')}.{name}")


def _add_marker(objects: Xml.Element, bodies: Sequence[Body], marker: Marker) -> None:
    made = add(objects, "Marker", marker.name)
    add_values(made, socket_parent_frame=body_path(bodies, marker.body), location=marker.location)
    add_values(made, fixed="true" if marker.is_fixed else "false")


def _add_surfaces(owner: Xml.Element, model: Model, body: int) -> None:
    for surface in model.surfaces:
        if surface.body == body:
            _add_surface(find_objects(owner, "WrapObjectSet"), surface)


def _add_surface(objects: Xml.Element, surface: WrapSurface) -> None:
    made = add(objects, f"Wrap{surface.kind.capitalize()}", surface.name)
    placement = surface.placement
    add_values(made, xyz_body_rotation=body_fixed_xyz_angles(placement.rotation), translation=placement.translation)
    add_values(made, quadrant=surface.quadrant, active=str(surface.is_active).lower())
    if surface.kind == "ellipsoid":
        add_values(made, dimensions=surface.dimensions)
    elif surface.kind == "torus":
        add_values(made, inner_radius=surface.dimensions[0], outer_radius=surface.dimensions[1])
    else:
        add_values(made, radius=surface.dimensions[0])
    if surface.kind == "cylinder":
        add_values(made, length=surface.dimensions[2])


def _add_joint(objects: Xml.Element, model: Model, joint: Joint) -> None:
    motion = joint.motion
    sides = [
        (body_path(model.bodies, joint.parent), joint.frame_in_parent),
        (body_path(model.bodies, joint.child), joint.frame_in_child),
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
        coupled = {coordinate.name for coordinate in coordinates if coordinate.motion == "coupled"}
        add_axes(made, motion.axes, drivers, motion.functions, coupled)


def add_constraint(written: Xml.Element, model: Model, constraint: Constraint) -> None:
    """Add a constraint to the written <Model>, behind its joints."""
    if isinstance(constraint, CoordinateLock):
        _lock(_coordinate(written, model, constraint.coordinate), constraint.value)
    elif isinstance(constraint, CoordinatePrescription):
        coordinate = _coordinate(written, model, constraint.coordinate)
        add_values(coordinate, prescribed="true")
        add_function(coordinate, constraint.function, constraint.name, "prescribed_function")
    else:
        _add_to_set(find_objects(written, "ConstraintSet"), model, constraint)


def _coordinate(written: Xml.Element, model: Model, coordinate: int) -> Xml.Element:
    name = model.coordinate_names[coordinate]
    return next(node for node in written.iter("Coordinate") if node.get("name") == name)


def _lock(coordinate: Xml.Element, value: float) -> None:
    """At the default value."""
    coordinate.remove(coordinate.find("default_value"))  # type: ignore[arg-type]
    add_values(coordinate, default_value=value, locked="true")


def _add_to_set(objects: Xml.Element, model: Model, constraint: Any) -> None:
    if isinstance(constraint, CoordinateCoupler):
        _add_coupler(objects, model, constraint)
        return
    bodies = [body_path(model.bodies, body) for body in (constraint.body_1, constraint.body_2)]
    if isinstance(constraint, PointOnLineConstraint):
        add_values(
            add(objects, "PointOnLineConstraint", constraint.name),
            socket_line_body=bodies[0],
            socket_follower_body=bodies[1],
            point_on_line=constraint.location_1,
            point_on_follower=constraint.location_2,
            line_direction_vec=constraint.direction,
        )
    elif isinstance(constraint, PointConstraint | ConstantDistanceConstraint):
        tag = type(constraint).__name__
        made = add(objects, tag, constraint.name)
        add_values(made, socket_body_1=bodies[0], socket_body_2=bodies[1])
        add_values(made, location_body_1=constraint.location_1, location_body_2=constraint.location_2)
        if isinstance(constraint, ConstantDistanceConstraint):
            add_values(made, constant_distance=constraint.distance)
    else:
        names = [f"{constraint.name}_frame{number}" for number in (1, 2)]
        made = add(objects, "WeldConstraint", constraint.name)
        add_values(made, socket_frame1=names[0], socket_frame2=names[1])
        frames = add(made, "frames")
        add_offset_frame(frames, names[0], bodies[0], Placement(constraint.rotation_1, constraint.location_1))
        add_offset_frame(frames, names[1], bodies[1], Placement(constraint.rotation_2, constraint.location_2))


def _add_coupler(objects: Xml.Element, model: Model, constraint: CoordinateCoupler) -> None:
    """Of several coordinates it is a LinearFunction, with the constants of all terms together."""
    names = [model.coordinate_names[coordinate] for coordinate in constraint.independents]
    made = add(objects, "CoordinateCouplerConstraint", constraint.name)
    holder = add(made, "coupled_coordinates_function")
    if len(names) == 1:
        add_function(holder, constraint.functions[0], constraint.name, "")
    else:
        terms = [function.derivatives(np.zeros(1)) for function in constraint.functions]
        slopes, constant = [slope.item() for _, slope, _ in terms], sum(value.item() for value, _, _ in terms)
        add_values(add(holder, "LinearFunction"), coefficients=[*slopes, constant])
    dependent = model.coordinate_names[constraint.dependent]
    add_values(made, independent_coordinate_names=" ".join(names), dependent_coordinate_name=dependent)


def read_marker_set(path: Path, model: Model) -> tuple[tuple[Marker, ...], tuple[str, ...], tuple[str, ...]]:
    """Markers of a MarkerSet on bodies of the model, the names of those on bodies that it lacks, and what the file has
    and is not used, as Element.unused.

    Files of OpenSim 4 name a frame (socket_parent_frame), those of OpenSim 3 a body. Raises ModelError, with the line,
    for any other file, and for a marker that names no frame.
    """
    root = read_document(path)
    found = root.own("MarkerSet")
    if found is None:
        raise root.refusal("has no MarkerSet; give OpenSim's file of one", SolverCode.WRONG_DOCUMENT)
    read = {one.name: _marker(one, model) for one in found.members("objects") if one.tag == "Marker"}
    unattached = tuple(name for name, marker in read.items() if marker is None)
    unused = tuple(root.unused(DRAWN))
    return tuple(marker for marker in read.values() if marker is not None), unattached, unused


def with_markers(model: Model, markers: Sequence[Marker]) -> Model:
    """The model with these markers added; they replace markers of the same name."""
    names = {marker.name for marker in markers}
    return replace(model, markers=(*(marker for marker in model.markers if marker.name not in names), *markers))


def _marker(element: Element, model: Model) -> Marker | None:
    frame = element.word("socket_parent_frame", "") or element.word("body", "")
    if not frame:
        raise element.refusal(f"names no frame; name a body of {model.name}", SolverCode.UNKNOWN_NAME)
    name = frame.rsplit("/", 1)[-1]
    if name not in {body.name for body in model.bodies}:
        element.sought.update(("location", "fixed"))
        return None
    location = np.asarray(element.numbers("location", 3))
    return Marker(element.name, model.body_index(name), location, element.flag("fixed"))
