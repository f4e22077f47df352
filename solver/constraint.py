"""Constraints of a model besides its joints. Those between two bodies hold a place in each: location (3,) [m] and, of a
weld, rotation (3, 3), which turns vectors of the held frame into those of the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.checks import freeze_arrays
from solver.functions.coordinate_functions import Function

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _BetweenBodies:
    name: str
    body_1: int
    body_2: int
    location_1: Array
    location_2: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, location_1=(3,), location_2=(3,))


@dataclass(frozen=True, eq=False)
class PointConstraint(_BetweenBodies):
    """A point of one body held on a point of another."""


@dataclass(frozen=True, eq=False)
class WeldConstraint(_BetweenBodies):
    """A frame of one body held on a frame of another."""

    rotation_1: Array
    rotation_2: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        freeze_arrays(self, rotation_1=(3, 3), rotation_2=(3, 3))


@dataclass(frozen=True, eq=False)
class ConstantDistanceConstraint(_BetweenBodies):
    """A point of one body held at a distance [m] from a point of another."""

    distance: float


@dataclass(frozen=True, eq=False)
class PointOnLineConstraint(_BetweenBodies):
    """A point of body 2 held on the line through location_1 of body 1 along direction (3,), a unit vector in it."""

    direction: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        freeze_arrays(self, direction=(3,))


@dataclass(frozen=True)
class CoordinateCoupler:
    """Coupled coordinates: q_dependent = Σ functions[k](q_independents[k])."""

    name: str
    dependent: int
    independents: tuple[int, ...]
    functions: tuple[Function, ...]


@dataclass(frozen=True)
class CoordinateLock:
    """A locked coordinate and its value [rad or m]."""

    name: str
    coordinate: int
    value: float


@dataclass(frozen=True)
class CoordinatePrescription:
    """A coordinate that follows a function of time [s]."""

    name: str
    coordinate: int
    function: Function


BodyConstraint = PointConstraint | WeldConstraint | ConstantDistanceConstraint | PointOnLineConstraint
Constraint = BodyConstraint | CoordinateCoupler | CoordinateLock | CoordinatePrescription
