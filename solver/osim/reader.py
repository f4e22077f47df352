"""Reads an OpenSim 4 model file (.osim) into a Model, and refuses by name and line what the solver does not have."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from solver.model import GROUND, Body, Constraint, Joint, Marker, Model, WrapSurface
from solver.osim.defaults import with_defaults
from solver.osim.document import Element, read_document
from solver.osim.forces import COORDINATE_FORCES, read_coordinate_force
from solver.osim.frames import Names
from solver.osim.joints import read_constraint, read_joint, read_lock
from solver.osim.muscles import read_actuator, read_muscle
from solver.osim.paths import read_surface


def read_osim(path: str | Path) -> Model:
    """The model in an OpenSim 4 file. ModelError, naming file and line, for whatever the solver would not reproduce."""
    return read_osim_model(read_document(Path(path)))


def read_osim_model(document: Element) -> Model:
    """As read_osim, of the root of a document."""
    if document.tag != "OpenSimDocument" or int(document.attributes.get("Version", "0")) < 40000:
        raise document.refusal("is not an OpenSim 4 document; open the model in OpenSim 4 and save it again")
    return _model(with_defaults(document.child("Model")))


_MUSCLES = ("Millard2012EquilibriumMuscle", "Thelen2003Muscle")
_FORCES = (*_MUSCLES, "CoordinateActuator", *COORDINATE_FORCES)


def _model(element: Element) -> Model:
    """Names first, because everything else hangs on them."""
    for member in element.objects("ControllerSet") + element.objects("ComponentSet") + element.members("components"):
        raise member.refusal("is not something the solver has; remove it from the model")
    names, body_elements = Names(), element.objects("BodySet")
    surfaces: list[WrapSurface] = []
    for index, body in enumerate([element.child("Ground"), *body_elements]):
        path = "/ground" if index == GROUND else f"/bodyset/{body.name}"
        names.add_body(path, index)
        surfaces += [read_surface(index, surface) for surface in body.objects("WrapObjectSet")]
        names.add_offset_frames(body.members("components"), path)
    bodies = (Body("ground", 0.0, np.zeros(3), np.zeros((3, 3))), *map(_body, body_elements))
    joints = tuple(read_joint(joint, names) for joint in element.objects("JointSet"))
    _check_tree(element, bodies, joints)
    forces = _forces(element)
    return Model(
        name=element.name,
        gravity=element.numbers("gravity", 3, "0 -9.80665 0"),
        bodies=bodies,
        coordinates=tuple(names.coordinates),
        joints=joints,
        surfaces=tuple(surfaces),
        muscles=tuple(read_muscle(f, names, surfaces) for f in forces if f.tag in _MUSCLES),
        constraints=_constraints(element, names),
        actuators=tuple(read_actuator(f, names) for f in forces if f.tag == "CoordinateActuator"),
        coordinate_forces=tuple(
            one for f in forces if f.tag in COORDINATE_FORCES for one in read_coordinate_force(f, names)
        ),
        markers=tuple(
            Marker(m.name, *names.station(m, "socket_parent_frame", "location")) for m in element.objects("MarkerSet")
        ),
    )


def _forces(element: Element) -> list[Element]:
    forces = element.objects("ForceSet")
    for force in forces:
        if force.tag not in _FORCES:
            raise force.unsupported("force", ", ".join(_FORCES))
        force.require("appliesForce", "true")
    return forces


def _constraints(element: Element, names: Names) -> tuple[Constraint, ...]:
    coordinates = [c for joint in element.objects("JointSet") for c in joint.members("coordinates")]
    locks = [lock for coordinate in coordinates if (lock := read_lock(coordinate, names)) is not None]
    return (*locks, *(read_constraint(constraint, names) for constraint in element.objects("ConstraintSet")))


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
