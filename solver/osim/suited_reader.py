"""Read a suited model written by solver/osim/suited.py: the suit, and the model without it.

A compliant cuff is a body on a bushing, with three coordinates that a motion from markers does not have. Therefore it
is not solved as a body: its quasi-static equilibrium gives its force, as in an assessment.
"""

from __future__ import annotations

import posixpath
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.osim.document import Element
from solver.osim.reader import read_osim_model
from solver.suit.cord import ensure_possible
from solver.suit.suit import PARTS, Suit, SuitMass, SuitPoint
from solver.suit.suited_model import CORD, CUFF_NAMES, CUFFS_AT_ENDS, SuitedModel

Array = NDArray[np.float64]

SETS = ("BodySet", "JointSet", "ForceSet")


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
    """What a suit with a straight cord has for its shoulder: the point of its first end, and no mass."""
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
    """Waist, shoulder or arm → what it is called; the cord's points carry these names."""
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
