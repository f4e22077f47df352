"""Files with a ForceSet, as OpenSim's tools append them to a model: residual and reserve actuators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from solver.errors import SolverCode
from solver.osim.defaults import with_defaults
from solver.osim.document import Element
from solver.osim.earlier_versions import force_set_as_version_4, is_earlier


def with_force_sets(model: Element, documents: Sequence[Element]) -> Element:
    """The <Model> with the forces of these documents behind its own. ModelError for a document without a force."""
    added = [force for document in documents for force in _forces(document)]
    if not added:
        return model
    own = model.find("ForceSet") or Element(model.file, model.line, "ForceSet", {}, [], [""])
    objects = own.find("objects") or Element(own.file, own.line, "objects", {}, [], [""])
    objects = replace(objects, children=[*objects.children, *added])
    force_set = replace(own, children=[*(part for part in own.children if part.tag != "objects"), objects])
    return replace(model, children=[*(part for part in model.children if part.tag != "ForceSet"), force_set])


def _forces(document: Element) -> list[Element]:
    """Objects of the document's ForceSet; its defaults are its own."""
    force_set = document.find("ForceSet") if document.tag == "OpenSimDocument" else None
    if force_set is None:
        sentence = "has no ForceSet; give a file of actuators as OpenSim's tools append it to a model"
        raise document.refusal(sentence, SolverCode.WRONG_DOCUMENT)
    force_set = with_defaults(force_set_as_version_4(force_set) if is_earlier(document) else force_set)
    forces = force_set.members("objects")
    if not forces:
        raise force_set.refusal("has no forces; add actuators, or do not give this file", SolverCode.WRONG_DOCUMENT)
    return forces
