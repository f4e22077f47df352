"""Passive forces on a coordinate: springs, limits and formulas (OpenSim's SpringGeneralizedForce,
CoordinateLimitForce, ExpressionBasedCoordinateForce).

Each gives a force (frames,) [N or N m] for values q (frames,) [rad or m] and speeds u (frames,) of its coordinate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.functions.expression import Expression

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CoordinateSpring:
    """−stiffness (q − rest_length) − viscosity u."""

    name: str
    coordinate: int
    stiffness: float
    rest_length: float
    viscosity: float

    def at(self, q: Array, u: Array) -> Array:
        return -self.stiffness * (q - self.rest_length) - self.viscosity * u


@dataclass(frozen=True)
class CoordinateLimit:
    """A spring and a damper beyond each limit, which come in over the transition by 10 t³ − 15 t⁴ + 6 t⁵.

    limits [rad or m], stiffnesses [N m/rad or N/m] of the lower and the upper side, damping [N m s/rad or N s/m]
    """

    name: str
    coordinate: int
    limits: tuple[float, float]
    stiffnesses: tuple[float, float]
    damping: float
    transition: float

    def at(self, q: Array, u: Array) -> Array:
        force = np.zeros_like(q)
        for sense, limit, stiffness in zip((-1.0, 1.0), self.limits, self.stiffnesses, strict=True):
            t = np.clip(sense * (q - limit) / self.transition, 0.0, 1.0)
            onset = t**3 * (10.0 + t * (6.0 * t - 15.0))
            force -= onset * (stiffness * (q - limit) + self.damping * u)
        return force


@dataclass(frozen=True)
class CoordinateExpression:
    """A formula in q and qdot, which is the speed u."""

    name: str
    coordinate: int
    expression: Expression

    def at(self, q: Array, u: Array) -> Array:
        return self.expression.at(q, u)
