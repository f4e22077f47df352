"""Read an OpenSim model file (.osim); unsupported components are refused by name and line.

Components may also be below <components> of the model, or in its ComponentSet, where OpenSim 4 allows any. Properties
that an object lacks have the values of <defaults>. OpenSim makes each object of a file as a copy of its class's
default, then reads what its element holds. So a property that the element lacks comes from the default, one that it
holds replaces the default's as a whole, and an object within it (the curve of a muscle) is in turn made from its own
class's default, not from the part of its owner's. Defaults are read in the order of the file, so that one counts in
those after it, and the first of a class counts. Only those directly below <Model> do.

Files with a ForceSet, residual and reserve actuators, are added to a model as OpenSim's tools append them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TypeVar

import numpy as np
import scipy

from solver.errors import SolverCode
from solver.model import GROUND, Actuator, Body, CoordinateForce, Marker, Model, ModelError, Muscle, WrapSurface
from solver.multibody.loads import ForceElement
from solver.osim.document import DRAWN, Element, read_document
from solver.osim.earlier_versions import as_version_4, force_set_as_version_4, is_earlier
from solver.osim.force_elements import ACTUATORS, COORDINATE_FORCES, FORCE_ELEMENTS, read_force
from solver.osim.force_parts import ForceContext
from solver.osim.joint_reader import (
    ensure_known_constraint,
    read_constraint,
    read_held_coordinate,
    read_joint,
    read_joint_frames,
)
from solver.osim.muscle_elements import MUSCLES, has_function_path, read_muscle, read_surface
from solver.osim.names import INERT, Names, OffsetFrame

S = TypeVar("S")
T = TypeVar("T")

MOST_NAMED = 20
FORCES = (*MUSCLES, *ACTUATORS, *COORDINATE_FORCES, *FORCE_ELEMENTS)


def read_osim(path: str | Path, *, ignore_forces: bool = False, actuators: Sequence[Path] = ()) -> Model:
    """The model in an .osim file. Raises ModelError, with file and line, for anything the solver does not reproduce.

    ignore_forces leaves out forces and controllers that the solver does not have (Model.left_out names them, and
    Model.lacking the forces). actuators are files with a ForceSet each, whose forces are added to those of the model.
    """
    return read_osim_model(read_document(Path(path)), ignore_forces=ignore_forces, actuators=actuators)


def read_osim_model(
    document: Element, *, ignore_forces: bool = False, actuators: Sequence[Path] = (), needs_paths: bool = True
) -> Model:
    """read_osim for the root element of a document.

    needs_paths, if false, leaves out muscles and actuators whose path the solver cannot follow: they do not act by
    themselves, as in inverse dynamics.
    """
    if document.tag != "OpenSimDocument":
        raise document.refusal("is not an OpenSim document; give an .osim file", SolverCode.WRONG_DOCUMENT)
    model = document.child("Model")
    model = with_defaults(as_version_4(model) if is_earlier(document) else model)
    added = [_force_set_document(read_document(path)) for path in actuators]
    model = with_force_sets(model, [force for document in added for force in _forces(document)])
    model = with_own_names(with_components_in_sets(model), "JointSet")
    ignored = _unsupported_forces(model) if ignore_forces else []
    ignored += [] if ignore_forces or needs_paths else _without_followed_path(model)
    left_out = _switched_off(model) + ignored
    if left_out:
        model = _without(model, left_out)
    names = tuple(map(_named, _inert(model) + left_out))
    lacking = tuple(element.name for element in ignored if not element.tag.endswith("Controller"))
    read = replace(_model(model), left_out=names, lacking=lacking)
    unused = [text for document in added for text in _without(document, left_out).unused(DRAWN)]
    return replace(read, unused=tuple(dict.fromkeys(unused)))


MASSLESS = 2e-14  # kg; OpenSim sets the inertia of such a body to zero


def _model(element: Element) -> Model:
    """Names first, because everything else refers to them. All unsupported parts are refused together."""
    names, body_elements, obstacles = Names(), element.objects("BodySet"), Obstacles(element)
    obstacles.among(_refuse, element.objects("ControllerSet"))
    forces, constraints = element.objects("ForceSet"), element.objects("ConstraintSet")
    obstacles.among(ensure_known_force, forces)
    obstacles.among(ensure_known_constraint, constraints)
    surfaces: list[WrapSurface] = []
    for index, body in enumerate([element.child("Ground"), *body_elements]):
        path = "/ground" if index == GROUND else f"/bodyset/{body.name}"
        names.add_body(path, index)
        names.add_body(f"/{body.name}", index)  # of one that is not in the BodySet
        own = names.frames[path]
        surfaces += obstacles.among(partial(read_surface, own), body.objects("WrapObjectSet"))
        obstacles.among(partial(names.add_component, path), body.members("components"))
    for owner, components in _components(element):
        obstacles.among(partial(names.add_component, owner), components)
    obstacles.ensure_none()
    for frame, wrap_object in names.wrap_objects():
        surfaces += obstacles.among(partial(read_surface, frame), [wrap_object])
    bodies = (Body("ground", 0.0, np.zeros(3), np.zeros((3, 3))), *obstacles.among(_body, body_elements))
    placed = obstacles.among(
        lambda joint: _PlacedJoint(joint, *read_joint_frames(joint, names)), element.objects("JointSet")
    )
    obstacles.ensure_none()
    joints = obstacles.among(
        lambda joint: read_joint(joint.element, joint.parent, joint.child, names), _root_first(element, bodies, placed)
    )
    obstacles.ensure_none()

    context = ForceContext(names, surfaces, element.objects("ContactGeometrySet"))
    read = read_force_set(forces, context, obstacles)
    coordinates = [c for joint in element.objects("JointSet") for c in joint.members("coordinates")]
    locks = obstacles.among(lambda coordinate: read_held_coordinate(coordinate, names), coordinates)
    held = obstacles.among(lambda constraint: read_constraint(constraint, names), constraints)
    of_file = element.objects("MarkerSet")
    attached = [marker for marker in of_file if _is_attached(marker, names)]
    markers = obstacles.among(lambda marker: _marker(marker, names), attached)
    obstacles.ensure_none()
    return Model(
        name=element.name,
        gravity=element.numbers("gravity", 3, f"0 {-scipy.constants.g} 0"),
        bodies=bodies,
        coordinates=tuple(names.coordinates),
        joints=tuple(joints),
        surfaces=tuple(surfaces),
        constraints=(*(lock for lock in locks if lock is not None), *held),
        markers=tuple(markers),
        unattached=tuple(marker.name for marker in of_file if not _is_attached(marker, names)),
        **vars(read),
    )


def _components(model: Element) -> list[tuple[str, list[Element]]]:
    """Frames and points of the model, of its joints, and its markers, with the path of their owner."""
    joints = [(f"/jointset/{joint.name}", joint.members("frames")) for joint in model.objects("JointSet")]
    return [("", model.members("components")), *joints, ("/markerset", model.objects("MarkerSet"))]


def _inert(model: Element) -> list[Element]:
    """Points and sensors among the components of the model and its bodies; OpenSim's tools do not use them either."""
    owners = [model, *(ground for ground in [model.find("Ground")] if ground), *model.objects("BodySet")]
    return [part for owner in owners for part in owner.members("components") if part.tag in INERT]


def _switched_off(model: Element) -> list[Element]:
    """Forces, constraints and controllers that do not act in OpenSim either."""
    switches = {"ForceSet": "appliesForce", "ConstraintSet": "isEnforced", "ControllerSet": "enabled"}
    return [part for tag, switch in switches.items() for part in model.objects(tag) if part.is_off(switch)]


def _unsupported_forces(model: Element) -> list[Element]:
    """Forces that the solver does not have, and all controllers."""
    forces = [force for force in model.objects("ForceSet") if force.tag not in FORCES or has_function_path(force)]
    return [part for part in model.objects("ControllerSet") + forces if not part.is_off("enabled", "appliesForce")]


def _without_followed_path(model: Element) -> list[Element]:
    """Muscles and actuators with a path that is a function of coordinates, and that are not switched off."""
    found = [force for force in model.objects("ForceSet") if force.tag in (*MUSCLES, *ACTUATORS)]
    return [force for force in found if has_function_path(force) and not force.is_off("appliesForce")]


def _named(element: Element) -> str:
    name = f"{element.tag} {element.name}".strip()
    return f"{name} with a FunctionBasedPath" if has_function_path(element) else name


def _without(element: Element, left_out: list[Element]) -> Element:
    """The element without those, wherever they are in it."""
    kept = [child for child in element.children if not any(child is other for other in left_out)]
    return replace(element, children=[_without(child, left_out) for child in kept])


def _is_attached(marker: Element, names: Names) -> bool:
    """False for a marker on a body that the model lacks; a socket that names nothing is refused where it is read."""
    socket = marker.find("socket_parent_frame")
    return socket is None or not socket.text or names.has_frame(socket.text)


def _marker(element: Element, names: Names) -> Marker:
    is_fixed = element.flag("fixed")
    return Marker(element.name, *names.station(element, "socket_parent_frame", "location"), is_fixed)


def _refuse(controller: Element) -> None:
    raise controller.refusal(
        "is not supported by the solver; remove it from the model, or read the model without controllers "
        "(ignore_forces, --ignore-forces)",
        SolverCode.UNSUPPORTED,
    )


@dataclass(frozen=True)
class _PlacedJoint:
    element: Element
    parent: OffsetFrame
    child: OffsetFrame


def _root_first(element: Element, bodies: tuple[Body, ...], joints: list[_PlacedJoint]) -> list[_PlacedJoint]:
    """The joints, each after the one that places its parent. Raises ModelError unless they are a tree on the ground."""
    placed, ordered, left = {GROUND}, list[_PlacedJoint](), list(joints)
    while left:
        joint = next((joint for joint in left if joint.parent.body in placed), left[0])
        if joint.parent.body not in placed or joint.child.body in placed:
            raise joint.element.refusal(
                "closes a loop of joints or is not connected to the ground; break the loop", SolverCode.UNSUPPORTED
            )
        left.remove(joint)
        placed.add(joint.child.body)
        ordered.append(joint)
    for index, body in enumerate(bodies):
        if index not in placed:
            raise element.refusal(f"has no joint for body {body.name}", SolverCode.NO_JOINT)
    return ordered


def _body(element: Element) -> Body:
    xx, yy, zz, xy, xz, yz = element.numbers("inertia", 6, "0 0 0 0 0 0")
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    mass = element.number("mass")
    if mass < 0.0:
        raise element.refusal(f"has a mass of {mass:g} kg, expected none below 0; correct it", SolverCode.NOT_POSITIVE)
    if abs(mass) <= MASSLESS:
        inertia = np.zeros((3, 3))
    return Body(element.name, mass, element.numbers("mass_center", 3, "0 0 0"), inertia)


def with_components_in_sets(model: Element) -> Element:
    """The <Model> with its bodies, joints, forces, … in their sets; frames and points stay among its <components>."""
    loose = [*model.members("components"), *model.objects("ComponentSet")]
    if not loose:
        return model
    added: dict[str, list[Element]] = {}
    for component in loose:
        added.setdefault(_component_set(component), []).append(component)
    kept = [child for child in model.children if child.tag not in ("components", "ComponentSet", *added)]
    sets = [_joined(model, tag, [*model.objects(tag), *found]) for tag, found in added.items()]
    return replace(model, children=[*kept, *sets])


def with_own_names(model: Element, tag: str) -> Element:
    """The <Model> with a number behind every name that an object of the set shares with one before, as in OpenSim."""
    names: set[str] = set()
    objects = []
    for element in model.objects(tag):
        own = next(name for name in _numbered(element.name) if name not in names)
        names.add(own)
        objects.append(element if own == element.name else replace(element, attributes={"name": own}))
    children = [_joined(model, tag, objects) if child.tag == tag else child for child in model.children]
    return replace(model, children=children)


def _numbered(name: str) -> Iterator[str]:
    yield name
    yield from (f"{name}_{number}" for number in count())


def _component_set(component: Element) -> str:
    kinds = {"Body": "BodySet", "Joint": "JointSet", "Constraint": "ConstraintSet", "Controller": "ControllerSet"}
    found = next((tag for kind, tag in kinds.items() if component.tag.endswith(kind)), "components")
    if component.tag.startswith("Contact"):
        found = "ContactGeometrySet"
    return "ForceSet" if component.tag in FORCES or component.tag.endswith("Force") else found


def _joined(model: Element, tag: str, found: list[Element]) -> Element:
    if tag == "components":
        return Element(model.file, model.line, tag, {}, found)
    return Element(model.file, model.line, tag, {}, [Element(model.file, model.line, "objects", {}, found)])


def with_defaults(model: Element) -> Element:
    """The <Model> with the defaults filled into every object, and without <defaults>."""
    defaults: dict[str, Element] = {}
    for element in model.members("defaults"):
        defaults.setdefault(element.tag, _completed(element, defaults))
    if not defaults:
        return model
    children = [_completed(child, defaults) for child in model.children if child.tag != "defaults"]
    return replace(model, children=children)


def _completed(element: Element, defaults: dict[str, Element]) -> Element:
    own = [_completed(child, defaults) for child in element.children]
    default = defaults.get(element.tag)
    if default is not None:
        there = {child.tag for child in own}
        own += [child for child in default.children if child.tag not in there]
    return replace(element, children=own)


class Obstacles:
    """Unsupported parts of one <Model>."""

    def __init__(self, model: Element) -> None:
        self._model = model
        self._found: dict[str, SolverCode] = {}  # by sentence

    def among(self, read: Callable[[S], T], elements: Iterable[S]) -> list[T]:
        """Read the supported elements; keep the reasons for refusing the others."""
        results = []
        for element in elements:
            try:
                results.append(read(element))
            except ModelError as error:
                self._found[str(error)] = error.code
        return results

    def ensure_none(self) -> None:
        """Raises ModelError with every obstacle; its code is that of the first."""
        if not self._found:
            return
        sentences, code = list(self._found), next(iter(self._found.values()))
        if len(sentences) == 1:
            raise ModelError(sentences[0], code)
        more = f"; and {len(sentences) - MOST_NAMED} more" if len(sentences) > MOST_NAMED else ""
        raise ModelError(
            f"{self._model.file.name} cannot be solved for {len(sentences)} reasons: "
            f"{'; '.join(sentences[:MOST_NAMED])}{more}",
            code,
        )


def with_force_sets(model: Element, added: Sequence[Element]) -> Element:
    """The <Model> with these forces behind its own."""
    if not added:
        return model
    own = model.find("ForceSet") or Element(model.file, model.line, "ForceSet", {}, [], [""])
    objects = own.find("objects") or Element(own.file, own.line, "objects", {}, [], [""])
    objects = replace(objects, children=[*objects.children, *added])
    force_set = replace(own, children=[*(part for part in own.children if part.tag != "objects"), objects])
    return replace(model, children=[*(part for part in model.children if part.tag != "ForceSet"), force_set])


def _force_set_document(document: Element) -> Element:
    """An OpenSimDocument with the ForceSet in the layout of OpenSim 4; its defaults are its own. ModelError without it.

    A ForceSet that is the root has no version; OpenSim reads it as an earlier one.
    """
    force_set = document.own("ForceSet")
    if force_set is None:
        sentence = "has no ForceSet; give a file of actuators as OpenSim's tools append it to a model"
        raise document.refusal(sentence, SolverCode.WRONG_DOCUMENT)
    is_root = force_set is document
    read = with_defaults(force_set_as_version_4(force_set) if is_root or is_earlier(document) else force_set)
    others = [] if is_root else [child for child in document.children if child is not force_set]
    return Element(document.file, document.line, "OpenSimDocument", {}, [read, *others])


def _forces(document: Element) -> list[Element]:
    """Objects of the document's ForceSet. ModelError for none."""
    force_set = document.child("ForceSet")
    forces = force_set.members("objects")
    if not forces:
        raise force_set.refusal("has no forces; add actuators, or do not give this file", SolverCode.WRONG_DOCUMENT)
    return forces


@dataclass(frozen=True)
class ForceSet:
    """In the order of the file; a field of Model each."""

    muscles: tuple[Muscle, ...]
    actuators: tuple[Actuator, ...]
    coordinate_forces: tuple[CoordinateForce, ...]
    forces: tuple[ForceElement, ...]


def read_force_set(elements: Sequence[Element], context: ForceContext, obstacles: Obstacles) -> ForceSet:
    """The forces that these elements are. Those that cannot be read become obstacles."""

    def read(tags: Sequence[str], kind: Callable[[Element], list[T]]) -> tuple[T, ...]:
        found = obstacles.among(kind, [element for element in elements if element.tag in tags])
        return tuple(one for several in found for one in several)

    names, surfaces, force = context.names, context.surfaces, partial(read_force, context=context)
    return ForceSet(
        muscles=read(MUSCLES, lambda element: [read_muscle(element, names, surfaces)]),
        actuators=read(ACTUATORS, force),
        coordinate_forces=read(COORDINATE_FORCES, force),
        forces=read(FORCE_ELEMENTS, force),
    )


def ensure_known_force(element: Element) -> None:
    """Raises ModelError for a class of force that the solver does not have."""
    if element.tag not in FORCES:
        raise element.refusal(
            "is a force that the solver does not support; remove it, or read the model without such forces "
            "(ignore_forces, --ignore-forces); docs/osim-files.md lists those that are supported",
            SolverCode.UNSUPPORTED,
        )
