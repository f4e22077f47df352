"""<defaults> of a model: values of the properties that an object lacks, as OpenSim reads them.

OpenSim makes each object of a file as a copy of its class's default, then reads what its element holds. So a property
that the element lacks comes from the default, one that it holds replaces the default's as a whole, and an object within
it (the curve of a muscle) is in turn made from its own class's default, not from the part of its owner's. Defaults are
read in the order of the file, so that one counts in those after it, and the first of a class counts. Only those
directly below <Model> do.
"""

from __future__ import annotations

from dataclasses import replace

from solver.osim.document import Element


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
