"""Constraints of a model besides its joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.frozen import freeze_arrays
from solver.functions.coordinate import Function

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PointConstraint:
    """A point of one body, location (3,) [m] in it, held on a point of another."""

    name: str
    body_1: int
    body_2: int
    location_1: Array
    location_2: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, location_1=(3,), location_2=(3,))


@dataclass(frozen=True)
class CoordinateCoupler:
    """Coupled coordinates: q_dependent = function(q_independent)."""

    name: str
    dependent: int
    independent: int
    function: Function


@dataclass(frozen=True)
class CoordinateLock:
    """A locked coordinate and its value [rad or m]."""

    name: str
    coordinate: int
    value: float


Constraint = PointConstraint | CoordinateCoupler | CoordinateLock
