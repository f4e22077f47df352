"""Reads an OpenSim 4 model file (.osim) into a Model, and refuses by name and line what the solver does not have."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from solver.model import GROUND, Body, Joint, Marker, Model, WrapSurface
from solver.osim.defaults import with_defaults
from solver.osim.document import Element, read_document
from solver.osim.forces import COORDINATE_FORCES, read_coordinate_force
from solver.osim.frames import Names
from solver.osim.joints import ensure_known_constraint, read_constraint, read_joint, read_lock
from solver.osim.muscles import read_actuator, read_muscle
from solver.osim.obstacles import Obstacles
from solver.osim.paths import read_surface

T = TypeVar("T")


def read_osim(path: str | Path) -> Model:
    """The model in an OpenSim 4 file. ModelError, naming file and line, for whatever the solver would not reproduce."""
    return read_osim_model(read_document(Path(path)))


def read_osim_model(document: Element) -> Model:
    """As read_osim, of the root of a document."""
    if document.tag != "OpenSimDocument":
        raise document.refusal("is not an OpenSim document; give an .osim file")
    version = document.attributes.get("Version", "")
    if not version.isdecimal() or len(version) > LONGEST_VERSION or int(version) < OPENSIM_4:
        raise document.refusal(
            f"has the version {version[:LONGEST_VERSION] or 'none'}, expected {OPENSIM_4} (OpenSim 4) or later; "
            'open the model in OpenSim 4 and save it, or in Python: opensim.Model("old.osim").printToXML("new.osim")'
        )
    return _model(with_defaults(document.child("Model")))


OPENSIM_4, LONGEST_VERSION = 40000, 9
_MUSCLES = ("Millard2012EquilibriumMuscle", "Thelen2003Muscle")
_FORCES = (*_MUSCLES, "CoordinateActuator", *COORDINATE_FORCES)


def _model(element: Element) -> Model:
    """Names first, because everything else refers to them. All unsupported parts are refused together."""
    names, body_elements, obstacles = Names(), element.objects("BodySet"), Obstacles(element)
    obstacles.among(_refuse, element.objects("ControllerSet") + element.objects("ComponentSet"))
    obstacles.among(_refuse, element.members("components"))
    forces, constraints = element.objects("ForceSet"), element.objects("ConstraintSet")
    obstacles.among(_ensure_known_force, forces)
    obstacles.among(ensure_known_constraint, constraints)
    surfaces: list[WrapSurface] = []
    for index, body in enumerate([element.child("Ground"), *body_elements]):
        path = "/ground" if index == GROUND else f"/bodyset/{body.name}"
        names.add_body(path, index)
        surfaces += obstacles.among(partial(read_surface, index), body.objects("WrapObjectSet"))
        names.add_offset_frames(body.members("components"), path)
    bodies = (Body("ground", 0.0, np.zeros(3), np.zeros((3, 3))), *obstacles.among(_body, body_elements))
    joints = obstacles.among(lambda joint: read_joint(joint, names), element.objects("JointSet"))
    obstacles.ensure_none()
    _check_tree(element, bodies, tuple(joints))

    def read(kind: Callable[[Element, Names], T], tags: Sequence[str]) -> list[T]:
        return obstacles.among(lambda force: kind(force, names), [force for force in forces if force.tag in tags])

    muscles = read(lambda force, names: read_muscle(force, names, surfaces), _MUSCLES)
    actuators = read(read_actuator, ("CoordinateActuator",))
    coordinate_forces = read(read_coordinate_force, COORDINATE_FORCES)
    coordinates = [c for joint in element.objects("JointSet") for c in joint.members("coordinates")]
    locks = obstacles.among(lambda coordinate: read_lock(coordinate, names), coordinates)
    held = obstacles.among(lambda constraint: read_constraint(constraint, names), constraints)
    markers = obstacles.among(lambda marker: _marker(marker, names), element.objects("MarkerSet"))
    obstacles.ensure_none()
    return Model(
        name=element.name,
        gravity=element.numbers("gravity", 3, "0 -9.80665 0"),
        bodies=bodies,
        coordinates=tuple(names.coordinates),
        joints=tuple(joints),
        surfaces=tuple(surfaces),
        muscles=tuple(muscles),
        constraints=(*(lock for lock in locks if lock is not None), *held),
        actuators=tuple(actuators),
        coordinate_forces=tuple(one for pair in coordinate_forces for one in pair),
        markers=tuple(markers),
    )


def _marker(element: Element, names: Names) -> Marker:
    is_fixed = element.word("fixed", "false") == "true"
    return Marker(element.name, *names.station(element, "socket_parent_frame", "location"), is_fixed)


def _refuse(element: Element) -> None:
    raise element.refusal("is not something the solver has; remove it from the model")


def _ensure_known_force(element: Element) -> None:
    if element.tag not in _FORCES:
        raise element.unsupported("force", ", ".join(_FORCES))
    element.require("appliesForce", "true")


def _check_tree(element: Element, bodies: tuple[Body, ...], joints: tuple[Joint, ...]) -> None:
    placed = {GROUND}
    for joint, its in zip(joints, element.objects("JointSet"), strict=True):
        if joint.parent not in placed or joint.child in placed:
            raise its.refusal("does not hang a new body on one already placed; the solver reads trees, root first")
        placed.add(joint.child)
    for index, body in enumerate(bodies):
        if index not in placed:
            raise element.refusal(f"has no joint for body {body.name}")


def _body(element: Element) -> Body:
    xx, yy, zz, xy, xz, yz = element.numbers("inertia", 6, "0 0 0 0 0 0")
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Body(element.name, element.number("mass"), element.numbers("mass_center", 3, "0 0 0"), inertia)
