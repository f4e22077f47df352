"""The suit in an OpenSim document: cuffs as bodies, the cord as a PathSpring, compliance as BushingForce.

It is read again as the suit, and the model without it, at one rest length. A compliant cuff is a body on a bushing,
with three coordinates that a motion from markers does not have. Therefore it is not solved as a body: its quasi-static
equilibrium gives its force, as in an assessment.
"""

from __future__ import annotations

import posixpath
import re
import xml.etree.ElementTree as Xml
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.model import GROUND, Coordinate, Model, Placement
from solver.motion import Kinematics
from solver.multibody.loads import ExternalForce
from solver.multibody.postures import postures
from solver.osim.document import Element
from solver.osim.earlier_versions import PRESENT_LAYOUT
from solver.osim.elements import add, add_path, add_path_point, add_values, find_objects
from solver.osim.model_reader import read_osim_model
from solver.osim.model_writer import add_axes, add_body, add_joint
from solver.suit.cord import SuitScenario, cord_line, direction_to_joint, ensure_possible, suit_forces
from solver.suit.suit import PARTS, Suit, SuitError, SuitMass, SuitPoint, ensure_fits, with_suit_masses

NO_NAME = r"[\s/\\*+]"  # characters that the name of a component of OpenSim cannot have
REACH = 0.2  # m, either way: the range of a cuff's coordinates; they are not clamped to it
SETS = ("BodySet", "JointSet", "ForceSet")


def add_suit(root: Xml.Element, model: Model, suit: Suit, scenario: SuitScenario) -> None:
    """Add the suit, at its last rest length, to the document of `model`; existing elements do not change.

    A cuff is a body with its mass, the cord's end its origin: welded where it is rigid, else free to shift along its
    holder's x, y, z (coordinates waist_cuff_x, …, zero at rest, held by the bushing). Where cuffs slip along the cord,
    their migration lengthens the PathSpring, which leaves the cord's line and its tension; along the bone it moves
    their rest. The cord's points carry the names of the suit's parts. Raises SuitError for a law that OpenSim's forces
    do not have, or for names in use.
    """
    _ensure_can_be_written(root, model, suit, scenario)
    osim = root.find("Model")
    assert osim is not None  # noqa: S101  (the document of a model)
    slips_along_cord = suit.migration_direction == "cord"
    cuffs = dict(zip(("waist", "arm"), scenario.cuffs, strict=True))
    masses = dict(zip(PARTS, suit.masses, strict=True))
    for part in suit.parts:
        point, cuff = getattr(suit, part), cuffs.get(part)
        slipped = cuff.migration if cuff and scenario.is_shifted and not slips_along_cord else 0.0
        rest = point.location + slipped * direction_to_joint(point)
        _add_cuff(osim, part, SuitPoint(point.body, rest), masses[part], cuff if scenario.yields else None)
    spring = add(find_objects(osim, "ForceSet"), "PathSpring", CORD)
    points = add_path(spring)
    for part in suit.parts:
        name = re.sub(NO_NAME, "_", suit.names[part])
        add_path_point(points, f"{CORD}_{name}", f"/bodyset/{part}_cuff", np.zeros(3))
    slack = scenario.migration if slips_along_cord else 0.0
    length = float(scenario.rest_lengths[-1]) + slack
    add_values(spring, resting_length=length, stiffness=suit.stiffness, dissipation=0.0)


def _ensure_can_be_written(root: Xml.Element, model: Model, suit: Suit, scenario: SuitScenario) -> None:
    ensure_fits(suit, model)
    if int(root.get("Version", "0")) < PRESENT_LAYOUT:
        raise SuitError(
            f"the model has the layout of OpenSim {root.get('Version', '0')[:1]}, and the suit is added in that of "
            "OpenSim 4; open the model in OpenSim 4 and save it",
            SolverCode.SUIT_NOT_WRITABLE,
        )
    if root.find(".//*[@file]") is not None:
        raise SuitError(
            "the model takes parts from other files, which the suit cannot be added to; open the model in OpenSim and "
            "save it as one file",
            SolverCode.SUIT_NOT_WRITABLE,
        )
    if suit.damping:
        raise SuitError(
            f"the suit's cord should have no damping to become a PathSpring, whose dissipation grows with the stretch, "
            f"and has {suit.damping:g} N s/m; set exotendon.damping_n_s_per_m to 0 for the export",
            SolverCode.SUIT_NOT_WRITABLE,
        )
    _ensure_masses_of_cuffs(suit, scenario)
    taken = {element.get("name") for element in root.iter()} & {CORD, *CUFF_NAMES}
    if taken:
        raise SuitError(
            f"the model {model.name} should not wear a suit yet and has {', '.join(sorted(map(str, taken)))}; take the "
            "bare model",
            SolverCode.SUIT_NOT_WRITABLE,
        )


def _ensure_masses_of_cuffs(suit: Suit, scenario: SuitScenario) -> None:
    """Raise SuitError unless each mass can be that of a cuff; OpenSim cannot move a cuff without mass on a bushing."""
    yielding = {part for part, cuff in zip(("waist", "arm"), scenario.cuffs, strict=True) if cuff and scenario.yields}
    for part, mass in zip(PARTS, suit.masses, strict=True):
        problem = ""
        if part not in suit.parts:
            problem = f"0 kg beside a straight cord and is {mass.mass:g} kg; move it to a cuff" if mass.mass else ""
        elif mass.body != getattr(suit, part).body:
            body = getattr(suit, part).body
            problem = f"on the body of exotendon.{part}, {body}, to become one cuff and is on {mass.body}; move it"
        elif part in yielding and not mass.mass:
            problem = "above 0 kg, because OpenSim cannot move a yielding cuff without mass; add it, or export it rigid"
        if problem:
            raise SuitError(f"the suit's masses.{part} should be {problem}", SolverCode.SUIT_NOT_WRITABLE)


def _add_cuff(osim: Xml.Element, part: str, rest: SuitPoint, mass: SuitMass, yields: CuffParameters | None) -> None:
    name, holder = f"{part}_cuff", f"/bodyset/{rest.body}"
    center = mass.center - rest.location
    add_body(find_objects(osim, "BodySet"), name, mass.mass, center, np.diag(mass.inertia))
    sides = [(holder, Placement(np.eye(3), rest.location)), (f"/bodyset/{name}", Placement(np.eye(3), np.zeros(3)))]
    joints = find_objects(osim, "JointSet")
    if yields is None:
        add_joint(joints, "WeldJoint", f"{name}_joint", sides, [])
        return
    shifts = [f"{name}_{axis}" for axis in "xyz"]
    coordinates = [Coordinate(shift, "translation", 0.0, (-REACH, REACH)) for shift in shifts]
    joint = add_joint(joints, "CustomJoint", f"{name}_joint", sides, coordinates)
    functions = [polynomial([0.0])] * 3 + [polynomial([0.0, 1.0])] * 3
    add_axes(joint, np.vstack([np.eye(3), np.eye(3)]), ["", "", "", *shifts], functions)
    stiffness, damping = yields.law.bushing()
    add_values(
        add(find_objects(osim, "ForceSet"), "BushingForce", f"{name}_bushing"),
        socket_frame1=f"/jointset/{name}_joint/{name}_joint_{rest.body}",
        socket_frame2=f"/bodyset/{name}",
        rotational_stiffness=np.zeros(3),
        translational_stiffness=np.full(3, stiffness),
        rotational_damping=np.zeros(3),
        translational_damping=np.full(3, damping),
    )


def read_suited(
    document: Element, *, ignore_forces: bool = False, actuators: Sequence[Path] = (), needs_paths: bool = True
) -> SuitedModel | None:
    """The model and its suit in a document, None where it has no suit. ModelError, with the line, where the suit was
    changed beyond the structure that `station export --osim` writes, or the bare model cannot be read. The options are
    those of read_osim_model.
    """
    element = document.find("Model")
    cord = None if element is None else _named(element, "ForceSet", CORD)
    if element is None or cord is None or any(_named(element, "BodySet", name) is None for name in CUFFS_AT_ENDS):
        return None
    is_straight = _named(element, "BodySet", CUFF_NAMES[1]) is None
    worn = CUFFS_AT_ENDS if is_straight else CUFF_NAMES
    cuffs = {name: _cuff(element, name) for name in worn}
    points, masses = zip(*(cuffs.get(name, _unused(cuffs)) for name in CUFF_NAMES), strict=True)
    _require_no_bend(cord, worn)
    if cord.number("dissipation", "0"):
        raise cord.refusal("has a dissipation, which increases with the stretch; set it to 0")
    rest_length = cord.number("resting_length")
    suit = Suit(
        waist=points[0],
        shoulder=points[1],
        arm=points[2],
        stiffness=cord.number("stiffness"),
        damping=0.0,
        masses=masses,
        rest_lengths=np.array([rest_length]),
        reference_rest_length=rest_length,
        is_straight=is_straight,
        names={part: part for part in PARTS} | _names_of_parts(cord, worn),
    )
    return SuitedModel(
        bare=read_osim_model(
            replace(document, children=[_bare(element)]),
            ignore_forces=ignore_forces,
            actuators=actuators,
            needs_paths=needs_paths,
        ),
        suit=suit,
        waist=_spring(element, "waist"),
        arm=_spring(element, "arm"),
    )


def _named(element: Element, holder: str, name: str) -> Element | None:
    return next((member for member in element.objects(holder) if member.name == name), None)


def _cuff(element: Element, name: str) -> tuple[SuitPoint, SuitMass]:
    """Attachment of the cord to the body, and the mass there."""
    body, joint = _named(element, "BodySet", name), _named(element, "JointSet", f"{name}_joint")
    if body is None or joint is None:
        raise element.refusal(f"wears a {name} without its joint {name}_joint; export the suited model again")
    frames = {posixpath.basename(frame.child("socket_parent").text): frame for frame in joint.members("frames")}
    own = frames.pop(name, None)
    if own is None or len(frames) != 1 or any(frame.series("orientation").any() for frame in (own, *frames.values())):
        raise joint.refusal("does not hold the cuff on one body in that body's axes; export the suited model again")
    (holder, frame), shift = *frames.items(), own.numbers("translation", 3, "0 0 0")
    location = frame.numbers("translation", 3, "0 0 0") - shift
    inertia = body.numbers("inertia", 6, "0 0 0 0 0 0")[:3]
    center = location + body.numbers("mass_center", 3, "0 0 0")
    return SuitPoint(holder, location), SuitMass(holder, body.number("mass"), center, inertia)


def _unused(cuffs: Mapping[str, tuple[SuitPoint, SuitMass]]) -> tuple[SuitPoint, SuitMass]:
    """Shoulder of a suit with a straight cord: the point of its first end, and no mass."""
    point, _ = cuffs[CUFF_NAMES[0]]
    return point, SuitMass(point.body, 0.0, point.location, np.zeros(3))


def _require_no_bend(cord: Element, worn: tuple[str, ...]) -> None:
    """Raise ModelError unless the cord runs from cuff to cuff."""
    path = cord.child("GeometryPath")
    points = path.objects("PathPointSet")
    bodies = tuple(posixpath.basename(point.child("socket_parent_frame").text) for point in points)
    if bodies != worn or any(point.numbers("location", 3).any() for point in points):
        raise cord.refusal(f"does not run straight through the origins of {', '.join(worn)}; export it again")
    if path.objects("PathWrapSet"):
        raise cord.refusal("wraps over a surface, expected a cord that does not; export it again")


def _names_of_parts(cord: Element, worn: tuple[str, ...]) -> dict[str, str]:
    """Waist, shoulder or arm → its name; the cord's points carry these names."""
    points = cord.child("GeometryPath").objects("PathPointSet")
    parts = (name.removesuffix("_cuff") for name in worn)
    return {part: point.name.removeprefix(f"{CORD}_") or part for part, point in zip(parts, points, strict=True)}


def _spring(element: Element, part: Literal["waist", "arm"]) -> CuffParameters | None:
    bushing = _named(element, "ForceSet", f"{part}_cuff_bushing")
    if bushing is None:
        return None
    stiffness, damping = (_isotropic(bushing, f"translational_{what}") for what in ("stiffness", "damping"))
    for what in ("stiffness", "damping"):
        if bushing.numbers(f"rotational_{what}", 3, "0 0 0").any():
            raise bushing.refusal(f"resists rotation, expected a cuff that does not; set rotational_{what} to 0")
    cuff = CuffParameters(part, part, stiffness, damping, 0.0, source=f"the bushing of {element.file.name}")
    ensure_possible(cuff)
    return cuff


def _isotropic(bushing: Element, tag: str) -> float:
    values = bushing.numbers(tag, 3)
    if np.ptp(values):
        raise bushing.refusal(f"has a {tag} that differs between axes, expected equal values; make them equal")
    return float(values[0])


def _bare(element: Element) -> Element:
    """The model element without the suit."""
    worn = {CORD, *CUFF_NAMES, *(f"{name}_{what}" for name in CUFF_NAMES for what in ("joint", "bushing"))}
    children = []
    for child in element.children:
        if child.tag in SETS:
            kept = [member for member in child.members("objects") if member.name not in worn]
            holder = replace(child.child("objects"), children=kept)
            child = replace(child, children=[holder if kept.tag == "objects" else kept for kept in child.children])  # noqa: PLW2901
        children.append(child)
    return replace(element, children=children)


CORD = "exotendon"
CUFF_NAMES = tuple(f"{part}_cuff" for part in PARTS)
CUFFS_AT_ENDS = (CUFF_NAMES[0], CUFF_NAMES[2])
"""Names in a file; the cuff between is not there where the cord is straight."""


@dataclass(frozen=True, eq=False)
class SuitedModel:
    """The bare model and its suit at the reference rest length; a cuff at waist or arm that is None is rigid."""

    bare: Model
    suit: Suit
    waist: CuffParameters | None
    arm: CuffParameters | None

    @property
    def model(self) -> Model:
        """With the suit's masses on its bodies."""
        return with_suit_masses(self.bare, self.suit)

    def loads(self, kinematics: Kinematics, every: int = 1) -> tuple[ExternalForce, ...]:
        """Forces on the bodies of the suit's parts in every N-th frame; the cuffs follow all frames.

        Raises SuitError where a cuff has no equilibrium.
        """
        suit, bodies = self.suit, [body.name for body in self.bare.bodies]
        state = postures(self.bare, kinematics.positions, kinematics.speeds)
        forces = suit_forces(
            suit,
            cord_line(suit, self.bare, state, kinematics.interval),
            np.array([suit.reference_rest_length]),
            (self.waist, self.arm),
            yields=self.waist is not None or self.arm is not None,
            every=every,
        )
        return tuple(
            ExternalForce(
                name=f"{part}_cuff",
                body=bodies.index(getattr(suit, part).body),
                axes=GROUND,
                force=forces.forces[0, :, place],
                torque=np.zeros_like(forces.forces[0, :, place]),
                origin=GROUND,
                point=forces.points[0, :, place],
            )
            for place, part in enumerate(("waist", "arm", "shoulder"))
            if part in suit.parts
        )
