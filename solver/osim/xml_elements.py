"""Elements of an OpenSim document that is written: names, values with all digits, sets, frames."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.model import GROUND, Body, Placement

Array = NDArray[np.float64]

VERSION = "40500"


def add(parent: Xml.Element, tag: str, name: str = "") -> Xml.Element:
    return Xml.SubElement(parent, tag, {"name": name} if name else {})


def add_values(parent: Xml.Element, **values: Any) -> None:
    """Add one element for every property: text as it is, booleans as words, numbers with all digits."""
    for tag, value in values.items():
        add(parent, tag).text = _text(value)


def objects_of(model: Xml.Element, tag: str) -> Xml.Element:
    """The <objects> of one of the model's sets; created if missing."""
    found = model.find(tag)
    found = add(model, tag, tag.lower()) if found is None else found
    objects = found.find("objects")
    return add(found, "objects") if objects is None else objects


def frame_of(bodies: Sequence[Body], body: int) -> str:
    return "/ground" if body == GROUND else f"/bodyset/{bodies[body].name}"


def add_offset_frame(frames: Xml.Element, name: str, path: str, placement: Placement) -> None:
    """A frame of the body at that path."""
    frame = add(frames, "PhysicalOffsetFrame", name)
    angles = angles_of(placement.rotation)
    add_values(frame, socket_parent=path, translation=placement.translation, orientation=angles)


def angles_of(rotation: Array) -> Array:
    """Body-fixed x-y-z angles of a rotation."""
    r = rotation
    return np.array([np.arctan2(-r[1, 2], r[2, 2]), np.arcsin(np.clip(r[0, 2], -1, 1)), np.arctan2(-r[0, 1], r[0, 0])])


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) else " ".join(map(repr, np.ravel(value).tolist()))
