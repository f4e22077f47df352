"""Vectors of three for compiled code, as tuples: they stay in registers, while arrays would be allocated."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

ORIGIN = (0.0, 0.0, 0.0)
SMALLEST_LENGTH = 2.220446049250313e-16


@compiled
def add(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@compiled
def subtract(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def scale(factor: float, a: Vector) -> Vector:
    return (factor * a[0], factor * a[1], factor * a[2])


@compiled
def along(start: Vector, distance: float, direction: Vector) -> Vector:
    """start + distance · direction."""
    return (start[0] + distance * direction[0], start[1] + distance * direction[1], start[2] + distance * direction[2])


@compiled
def divide(a: Vector, b: Vector) -> Vector:
    """Component by component."""
    return (a[0] / b[0], a[1] / b[1], a[2] / b[2])


@compiled
def multiply(a: Vector, b: Vector) -> Vector:
    """Component by component."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@compiled
def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def norm(a: Vector) -> float:
    return sqrt(dot(a, a))


@compiled
def unit(a: Vector) -> Vector:
    """a / |a|, or zero where a has no direction."""
    length = norm(a)
    return scale(1.0 / length, a) if length >= SMALLEST_LENGTH else ORIGIN


@compiled
def any_across(a: Vector) -> Vector:
    """Some unit vector at right angles to a."""
    x, y, z = abs(a[0]), abs(a[1]), abs(a[2])
    if x <= y and x <= z:
        return unit(cross(a, (1.0, 0.0, 0.0)))
    if y <= z:
        return unit(cross(a, (0.0, 1.0, 0.0)))
    return unit(cross(a, (0.0, 0.0, 1.0)))


@compiled
def distance(a: Vector, b: Vector) -> float:
    return norm(subtract(a, b))


@compiled
def turn(rotation: Array, a: Vector) -> Vector:
    """Rotation (3, 3) times a."""
    return (
        rotation[0, 0] * a[0] + rotation[0, 1] * a[1] + rotation[0, 2] * a[2],
        rotation[1, 0] * a[0] + rotation[1, 1] * a[1] + rotation[1, 2] * a[2],
        rotation[2, 0] * a[0] + rotation[2, 1] * a[1] + rotation[2, 2] * a[2],
    )


@compiled
def turn_back(rotation: Array, a: Vector) -> Vector:
    """The transpose of rotation (3, 3) times a."""
    return (
        rotation[0, 0] * a[0] + rotation[1, 0] * a[1] + rotation[2, 0] * a[2],
        rotation[0, 1] * a[0] + rotation[1, 1] * a[1] + rotation[2, 1] * a[2],
        rotation[0, 2] * a[0] + rotation[1, 2] * a[1] + rotation[2, 2] * a[2],
    )


@compiled
def read(array: Array) -> Vector:
    """A vector out of an array (3,)."""
    return array[0], array[1], array[2]


@compiled
def write(array: Array, a: Vector) -> None:
    """A vector into an array (3,)."""
    array[0], array[1], array[2] = a
