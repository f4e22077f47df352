"""Contact forces and their geometry in an OpenSim document."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Callable
from typing import Any

from solver.forces.contact import ContactMaterial, ContactSurface, HuntCrossleyContact
from solver.forces.smooth_contact import SmoothContact
from solver.model import Model
from solver.osim.xml_elements import add, add_values, angles_of, frame_of, objects_of

_FRICTION = ("dissipation", "static_friction", "dynamic_friction", "viscous_friction")


def _hunt_crossley(written: Xml.Element, model: Model, force: HuntCrossleyContact) -> None:
    """Each surface becomes a geometry of its own with its material, also if several shared one."""
    made = add(objects_of(written, "ForceSet"), "HuntCrossleyForce", force.name)
    groups = add(add(made, "HuntCrossleyForce::ContactParametersSet", "contact_parameters"), "objects")
    for index, surface in enumerate(force.surfaces, start=1):
        name = f"{force.name}_{index}"
        _add_surface(written, model, surface, name)
        group = add(groups, "HuntCrossleyForce::ContactParameters")
        add_values(group, geometry=name, **_material(surface.material))
    add_values(made, transition_velocity=force.transition_velocity)


def _smooth_contact(written: Xml.Element, model: Model, force: SmoothContact) -> None:
    sphere, plane = f"{force.name}_sphere", f"{force.name}_plane"
    shapes = objects_of(written, "ContactGeometrySet")
    made = add(shapes, "ContactSphere", sphere)
    add_values(made, socket_frame=frame_of(model.bodies, force.sphere_body), location=force.center, radius=force.radius)
    _add_surface(written, model, ContactSurface(force.plane_body, force.plane, None, force.material), plane)
    values = {"socket_sphere": f"/contactgeometryset/{sphere}", "socket_half_space": f"/contactgeometryset/{plane}"}
    values |= {"constant_contact_force": force.offset, "hertz_smoothing": force.hertz_smoothing}  # type: ignore[dict-item]
    contact = add(objects_of(written, "ForceSet"), "SmoothSphereHalfSpaceForce", force.name)
    add_values(contact, **values, **_material(force.material), transition_velocity=force.transition_velocity)
    add_values(contact, hunt_crossley_smoothing=force.speed_smoothing)


def _add_surface(written: Xml.Element, model: Model, surface: ContactSurface, name: str) -> None:
    tag = "ContactHalfSpace" if surface.radius is None else "ContactSphere"
    made = add(objects_of(written, "ContactGeometrySet"), tag, name)
    placement = surface.placement
    add_values(made, socket_frame=frame_of(model.bodies, surface.body), location=placement.translation)
    add_values(made, orientation=angles_of(placement.rotation))
    if surface.radius is not None:
        add_values(made, radius=surface.radius)


def _material(material: ContactMaterial) -> dict[str, float]:
    return {tag: getattr(material, tag) for tag in ("stiffness", *_FRICTION)}


CONTACTS: dict[type, Callable[[Xml.Element, Model, Any], None]] = {
    HuntCrossleyContact: _hunt_crossley,
    SmoothContact: _smooth_contact,
}
