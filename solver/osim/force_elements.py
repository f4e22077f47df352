"""Springs, bushings, ligaments and contact in an OpenSim file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from solver.errors import SolverCode
from solver.forces.bushing import Bushing
from solver.forces.contact import ContactMaterial, ContactSurface, HuntCrossleyContact
from solver.forces.path_force import Ligament, PathSpring
from solver.forces.smooth_contact import SmoothContact
from solver.functions.coordinate import simm_spline
from solver.model import Placement, WrapSurface
from solver.multibody.force_element import ForceElement
from solver.multibody.rotations import rotation_body_fixed_xyz
from solver.osim.document import Element
from solver.osim.frames import Names
from solver.osim.functions import read_named_function
from solver.osim.paths import read_path


@dataclass(frozen=True)
class ForceContext:
    """What a force refers to: frames, wrap surfaces, and the elements of the contact geometry."""

    names: Names
    surfaces: Sequence[WrapSurface]
    geometries: Sequence[Element]


def read_force_element(element: Element, context: ForceContext) -> ForceElement:
    return _READERS[element.tag](element, context)


def _bushing(element: Element, context: ForceContext) -> Bushing:
    path = f"/forceset/{element.name}"
    context.names.add_offset_frames(element.members("frames"), path)
    one = context.names.frame(element, "socket_frame1", path)
    two = context.names.frame(element, "socket_frame2", path)
    stiffness, damping = (
        np.concatenate([element.numbers(f"{motion}_{kind}", 3, "0 0 0") for motion in ("rotational", "translational")])
        for kind in ("stiffness", "damping")
    )
    return Bushing(element.name, one.body, two.body, one.placement, two.placement, stiffness, damping)


def _path_spring(element: Element, context: ForceContext) -> PathSpring:
    return PathSpring(
        name=element.name,
        path=read_path(element.child("GeometryPath"), context.names, context.surfaces),
        resting_length=element.number("resting_length"),
        stiffness=element.number("stiffness"),
        dissipation=element.number("dissipation"),
    )


_LIGAMENT_STRETCH = np.array([-5, 0.998, 0.999, 1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.601, 1.602, 5])
_LIGAMENT_FORCE = np.array([0, 0, 0, 0, 0.035, 0.12, 0.26, 0.55, 1.17, 2, 2, 2, 2])


def _ligament(element: Element, context: ForceContext) -> Ligament:
    curve = read_named_function(element, "force_length_curve")
    return Ligament(
        name=element.name,
        path=read_path(element.child("GeometryPath"), context.names, context.surfaces),
        resting_length=element.positive("resting_length"),
        force=element.number("pcsa_force", "0"),
        curve=curve or simm_spline(_LIGAMENT_STRETCH, _LIGAMENT_FORCE),
    )


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
    "PathSpring": _path_spring,
    "Ligament": _ligament,
    "HuntCrossleyForce": _hunt_crossley,
    "SmoothSphereHalfSpaceForce": _smooth_contact,
}
FORCE_ELEMENTS = tuple(_READERS)
