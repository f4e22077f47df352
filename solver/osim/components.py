"""Components of an OpenSim file that are not in the set of their kind: below <components> of the model, or in its
ComponentSet, where OpenSim 4 allows any.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

from solver.osim.document import Element
from solver.osim.force_set import FORCES


def with_components_in_sets(model: Element) -> Element:
    """The <Model> with its bodies, joints, forces, … in their sets; frames and points stay among its <components>."""
    loose = [*model.members("components"), *model.objects("ComponentSet")]
    if not loose:
        return model
    added: dict[str, list[Element]] = {}
    for component in loose:
        added.setdefault(_set_of(component), []).append(component)
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


def _set_of(component: Element) -> str:
    kinds = {"Body": "BodySet", "Joint": "JointSet", "Constraint": "ConstraintSet", "Controller": "ControllerSet"}
    found = next((tag for kind, tag in kinds.items() if component.tag.endswith(kind)), "components")
    if component.tag.startswith("Contact"):
        found = "ContactGeometrySet"
    return "ForceSet" if component.tag in FORCES or component.tag.endswith("Force") else found


def _joined(model: Element, tag: str, found: list[Element]) -> Element:
    if tag == "components":
        return Element(model.file, model.line, tag, {}, found)
    return Element(model.file, model.line, tag, {}, [Element(model.file, model.line, "objects", {}, found)])
