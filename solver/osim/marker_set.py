"""OpenSim's MarkerSet file: body and location of every marker."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from solver.errors import SolverCode
from solver.model import Marker, Model
from solver.osim.document import Element, read_document
from solver.osim.writer import add_marker
from solver.osim.xml_elements import VERSION, add


def read_marker_set(path: Path, model: Model) -> tuple[Marker, ...]:
    """Markers of a MarkerSet that belong to bodies of the model.

    Files of OpenSim 4 name a frame (socket_parent_frame), those of OpenSim 3 a body. Raises ModelError, with the line,
    for any other file, and for a frame that is not a body of the model.
    """
    root = read_document(path)
    found = root.own("MarkerSet")
    if found is None:
        raise root.refusal("has no MarkerSet; give OpenSim's file of one", SolverCode.WRONG_DOCUMENT)
    return tuple(_marker(element, model) for element in found.members("objects") if element.tag == "Marker")


def with_markers(model: Model, markers: Sequence[Marker]) -> Model:
    """The model with these markers added; they replace markers of the same name."""
    names = {marker.name for marker in markers}
    return replace(model, markers=(*(marker for marker in model.markers if marker.name not in names), *markers))


def marker_set_document(model: Model, markers: Sequence[Marker]) -> Xml.Element:
    """The root of a document of OpenSim 4 with these markers of the model."""
    root = Xml.Element("OpenSimDocument", Version=VERSION)
    objects = add(add(root, "MarkerSet", "markerset"), "objects")
    for marker in markers:
        add_marker(objects, model.bodies, marker)
    return root


def _marker(element: Element, model: Model) -> Marker:
    frame = element.word("socket_parent_frame", "") or element.word("body", "")
    name = frame.rsplit("/", 1)[-1]
    if name not in {body.name for body in model.bodies}:
        raise element.refusal(
            f"is in {frame or 'no frame'}, which is not a body of {model.name}; name one of its bodies",
            SolverCode.UNKNOWN_NAME,
        )
    location = np.asarray(element.numbers("location", 3))
    return Marker(element.name, model.body_index(name), location, element.flag("fixed"))
