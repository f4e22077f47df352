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
from solver.osim.elements import VERSION, add
from solver.osim.model_writer import add_marker


def read_marker_set(path: Path, model: Model) -> tuple[tuple[Marker, ...], tuple[str, ...]]:
    """Markers of a MarkerSet on bodies of the model, and the names of those on bodies that it lacks.

    Files of OpenSim 4 name a frame (socket_parent_frame), those of OpenSim 3 a body. Raises ModelError, with the line,
    for any other file, and for a marker that names no frame.
    """
    root = read_document(path)
    found = root.own("MarkerSet")
    if found is None:
        raise root.refusal("has no MarkerSet; give OpenSim's file of one", SolverCode.WRONG_DOCUMENT)
    read = {one.name: _marker(one, model) for one in found.members("objects") if one.tag == "Marker"}
    unattached = tuple(name for name, marker in read.items() if marker is None)
    return tuple(marker for marker in read.values() if marker is not None), unattached


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


def _marker(element: Element, model: Model) -> Marker | None:
    frame = element.word("socket_parent_frame", "") or element.word("body", "")
    if not frame:
        raise element.refusal(f"names no frame; name a body of {model.name}", SolverCode.UNKNOWN_NAME)
    name = frame.rsplit("/", 1)[-1]
    if name not in {body.name for body in model.bodies}:
        return None
    location = np.asarray(element.numbers("location", 3))
    return Marker(element.name, model.body_index(name), location, element.flag("fixed"))
