"""Constraints in an OpenSim document: those of coordinates are properties of these."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
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
from solver.model import Model, Placement
from solver.osim.function_writer import add_function
from solver.osim.xml_elements import add, add_offset_frame, add_values, frame_of, objects_of


def add_constraint(written: Xml.Element, model: Model, constraint: Constraint) -> None:
    """Add a constraint to the written <Model>, behind its joints."""
    if isinstance(constraint, CoordinateLock):
        _lock(_coordinate(written, model, constraint.coordinate), constraint.value)
    elif isinstance(constraint, CoordinatePrescription):
        coordinate = _coordinate(written, model, constraint.coordinate)
        add_values(coordinate, prescribed="true")
        add_function(coordinate, constraint.function, constraint.name, "prescribed_function")
    else:
        _add_to_set(objects_of(written, "ConstraintSet"), model, constraint)


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
    bodies = [frame_of(model.bodies, body) for body in (constraint.body_1, constraint.body_2)]
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
