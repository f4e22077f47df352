"""Springs and limits of coordinates in an OpenSim file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from solver.forces.coordinate_force import CoordinateExpression, CoordinateLimit, CoordinateSpring
from solver.functions.expression import Expression, ExpressionError
from solver.model import Coordinate, CoordinateForce
from solver.osim.document import Element
from solver.osim.frames import Names


def read_coordinate_force(element: Element, names: Names) -> CoordinateForce:
    return _READERS[element.tag](element, names, names.coordinate(element, element.child("coordinate").text))


def read_expression(element: Element, tag: str, *variables: str) -> Expression:
    """The formula in a property, 0 without it. Raises ModelError for one that is not arithmetic in the variables."""
    try:
        return Expression(element.word(tag, "0.0") or "0.0", variables)
    except ExpressionError as error:
        raise (element.find(tag) or element).refusal(f"of {element.tag} {element.name} {error}") from None


def unit_of_limits(coordinate: Coordinate) -> float:
    """OpenSim takes degrees for coordinates that are angles, and the coordinate itself for all others."""
    return np.pi / 180 if coordinate.motion == "rotation" else 1.0


def _spring(element: Element, _: Names, coordinate: int) -> CoordinateForce:
    stiffness, rest_length, viscosity = (element.number(tag, "0") for tag in ("stiffness", "rest_length", "viscosity"))
    return CoordinateSpring(element.name, coordinate, stiffness, rest_length, viscosity)


def _limits(element: Element, names: Names, coordinate: int) -> CoordinateForce:
    unit = unit_of_limits(names.coordinates[coordinate])
    sides = ("lower", "upper")
    return CoordinateLimit(
        element.name,
        coordinate,
        limits=tuple(element.number(f"{side}_limit", "0") * unit for side in sides),  # type: ignore[arg-type]
        stiffnesses=tuple(element.number(f"{side}_stiffness", "1") / unit for side in sides),  # type: ignore[arg-type]
        damping=element.number("damping", "0.001") / unit,
        transition=element.positive("transition", "0.1") * unit,
    )


def _formula(element: Element, _: Names, coordinate: int) -> CoordinateForce:
    return CoordinateExpression(element.name, coordinate, read_expression(element, "expression", "q", "qdot"))


_READERS: dict[str, Callable[[Element, Names, int], CoordinateForce]] = {
    "SpringGeneralizedForce": _spring,
    "CoordinateLimitForce": _limits,
    "ExpressionBasedCoordinateForce": _formula,
}
COORDINATE_FORCES = tuple(_READERS)
