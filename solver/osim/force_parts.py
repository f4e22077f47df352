"""Parts of which the forces of an OpenSim file consist, and a class of force as a list of them.

A part is declared once, for the reader and for the writer; the writer gives all digits.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from solver.functions.coordinate_functions import Expression, ExpressionError
from solver.model import GROUND, Model, Placement, WrapSurface
from solver.osim.document import Element
from solver.osim.elements import add, add_offset_frame, add_values, add_whole_path, body_path, find_objects
from solver.osim.muscle_elements import geometry_path, read_path
from solver.osim.names import Names

Fields = dict[str, Any]
"""Arguments of the class of a force."""


@dataclass(frozen=True)
class ForceContext:
    """Objects that a force refers to: frames, wrap surfaces, and the elements of the contact geometry."""

    names: Names
    surfaces: Sequence[WrapSurface]
    geometries: Sequence[Element]


@dataclass(frozen=True)
class WrittenForce:
    """The element of a force, the <Model> that it is written into, and its model."""

    element: Xml.Element
    document: Xml.Element
    model: Model

    def add_values(self, **values: Any) -> None:
        add_values(self.element, **values)


class ForcePart(NamedTuple):
    """Properties of an element that are one or several fields of a force."""

    read: Callable[[Element, ForceContext], Fields]
    write: Callable[[WrittenForce, Any], None]


class ForceClass:
    """A class of OpenSim, the class that stands for it, and the parts of it in the order in which they are written."""

    def __init__(self, tag: str, kind: type[Any], *parts: ForcePart) -> None:
        self.tag, self.kind, self._parts = tag, kind, parts

    def read(self, element: Element, context: ForceContext) -> Any:
        fields: Fields = {}
        for part in self._parts:
            fields |= part.read(element, context)
        return self.kind(name=element.name, **fields)

    def add(self, document: Xml.Element, model: Model, force: Any) -> None:
        written = WrittenForce(add(find_objects(document, "ForceSet"), self.tag, force.name), document, model)
        for part in self._parts:
            part.write(written, force)


def value_part(tag: str, read: Callable[[Element], Any], field: str = "") -> ForcePart:
    """A property that is one field, by default of the same name."""
    field = field or tag
    return ForcePart(
        lambda element, _: {field: read(element)},
        lambda written, force: written.add_values(**{tag: getattr(force, field)}),
    )


def number_part(tag: str, default: str | None = None, field: str = "", read: Any = Element.number) -> ForcePart:
    """read: the method of Element, which refuses numbers that the property cannot have."""
    return value_part(tag, lambda element: read(element, tag, default), field)


def flag_part(tag: str, field: str, default: str = "false") -> ForcePart:
    return value_part(tag, lambda element: element.flag(tag, default), field)


def point_part(tag: str, field: str) -> ForcePart:
    """(3,) [m]"""
    return value_part(tag, lambda element: element.numbers(tag, 3, "0 0 0"), field)


def part_by_motion(kind: str) -> ForcePart:
    """(6,) rotational, then translational."""
    tags = [f"{motion}_{kind}" for motion in ("rotational", "translational")]
    return ForcePart(
        lambda element, _: {kind: np.concatenate([element.numbers(tag, 3, "0 0 0") for tag in tags])},
        lambda written, force: written.add_values(**dict(zip(tags, np.split(getattr(force, kind), 2), strict=True))),
    )


def expression_part(*variables: str) -> ForcePart:
    return ForcePart(
        lambda element, _: {"expression": read_expression(element, "expression", *variables)},
        lambda written, force: written.add_values(expression=force.expression.text),
    )


def read_expression(element: Element, tag: str, *variables: str) -> Expression:
    """The formula in a property, 0 without it. Raises ModelError for one that is not arithmetic in the variables."""
    try:
        return Expression(element.word(tag, "0.0") or "0.0", variables)
    except ExpressionError as error:
        raise (element.find(tag) or element).refusal(f"of {element.tag} {element.name} {error}") from None


COORDINATE = ForcePart(
    lambda element, context: {"coordinate": context.names.coordinate(element, element.child("coordinate").text)},
    lambda written, force: written.add_values(coordinate=written.model.coordinates[force.coordinate].name),
)
PATH = ForcePart(
    lambda element, context: {"path": read_path(geometry_path(element), context.names, context.surfaces)},
    lambda written, force: add_whole_path(written.element, written.model, force.path, force.name),
)
BODY = ForcePart(
    lambda element, context: {"body": context.names.body(element, "body")},
    lambda written, force: written.add_values(body=body_name(written.model, force.body)),
)


def body_name(model: Model, body: int) -> str:
    return "ground" if body == GROUND else model.bodies[body].name


def own_path(element: Element) -> str:
    return f"/forceset/{element.name}"


def named_body(names: Names, element: Element, tag: str) -> int:
    """The body in a property that is a name or a path."""
    return names.named_frame(element, tag).body


def socket_body(names: Names, element: Element, tag: str) -> int:
    return names.frame(element, tag, own_path(element)).body


def two_bodies_part(
    tags: tuple[str, str],
    fields: tuple[str, str],
    find: Callable[[Names, Element, str], int],
    name: Callable[[Model, int], str] = body_name,
) -> ForcePart:
    """Two bodies with a point each, between which a force acts."""

    def read(element: Element, context: ForceContext) -> Fields:
        one, two = (find(context.names, element, tag) for tag in tags)
        if one == two:
            sentence = f"acts between two points of the same body, which has no effect; correct {tags[0]} or {tags[1]}"
            raise element.refusal(sentence)
        return dict(zip(fields, (one, two), strict=True))

    def write(written: WrittenForce, force: Any) -> None:
        names = [name(written.model, getattr(force, field)) for field in fields]
        written.add_values(**dict(zip(tags, names, strict=True)))

    return ForcePart(read, write)


def _read_frames(element: Element, context: ForceContext) -> Fields:
    path = own_path(element)
    context.names.add_offset_frames(element.members("frames"), path)
    one, two = (context.names.frame(element, f"socket_frame{number}", path) for number in (1, 2))
    return {"body_1": one.body, "body_2": two.body, "frame_1": one.placement, "frame_2": two.placement}


def _write_frames(written: WrittenForce, force: Any) -> None:
    names = [f"{force.name}_frame{number}" for number in (1, 2)]
    written.add_values(socket_frame1=names[0], socket_frame2=names[1])
    frames = add(written.element, "frames")
    ends: list[tuple[int, Placement]] = [(force.body_1, force.frame_1), (force.body_2, force.frame_2)]
    for name, (body, placement) in zip(names, ends, strict=True):
        add_offset_frame(frames, name, body_path(written.model.bodies, body), placement)


FRAMES = ForcePart(_read_frames, _write_frames)
