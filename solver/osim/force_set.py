"""The forces of an OpenSim file, of every kind: those of a model, or of an additional ForceSet file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from solver.errors import SolverCode
from solver.model import Actuator, CoordinateForce, Muscle
from solver.multibody.force_element import ForceElement
from solver.osim.actuators import ACTUATORS, read_actuators
from solver.osim.document import Element
from solver.osim.force_elements import FORCE_ELEMENTS, ForceContext, read_force_element
from solver.osim.forces import COORDINATE_FORCES, read_coordinate_force
from solver.osim.muscles import MUSCLES, read_muscle
from solver.osim.obstacles import Obstacles

T = TypeVar("T")

FORCES = (*MUSCLES, *ACTUATORS, *COORDINATE_FORCES, *FORCE_ELEMENTS)


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

    names, surfaces = context.names, context.surfaces
    return ForceSet(
        muscles=read(MUSCLES, lambda element: [read_muscle(element, names, surfaces)]),
        actuators=read(ACTUATORS, lambda element: read_actuators(element, names, surfaces)),
        coordinate_forces=read(COORDINATE_FORCES, lambda element: [read_coordinate_force(element, names)]),
        forces=read(FORCE_ELEMENTS, lambda element: [read_force_element(element, context)]),
    )


def ensure_known_force(element: Element) -> None:
    """Raises ModelError for a class of force that the solver does not have."""
    if element.tag not in FORCES:
        raise element.refusal(
            "is a force that the solver does not support; remove it, or read the model without such forces "
            "(ignore_forces, --ignore-forces); docs/osim-files.md lists those that are supported",
            SolverCode.UNSUPPORTED,
        )
