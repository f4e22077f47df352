"""Vectors of three for compiled code: tuples, which live in registers where arrays would be allocated."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import TypeVar, cast

from numba import njit

Vector = tuple[float, float, float]
Function = TypeVar("Function", bound=Callable[..., object])

ORIGIN = (0.0, 0.0, 0.0)
SMALLEST_LENGTH = 2.220446049250313e-16


def compiled(function: Function) -> Function:
    """The function as machine code, kept on disk between runs; division by zero gives inf or NaN, as in C."""
    return cast(Function, njit(cache=True, error_model="numpy", nogil=True)(function))


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
    return (
        start[0] + distance * direction[0],
        start[1] + distance * direction[1],
        start[2] + distance * direction[2],
    )


@compiled
def divide(a: Vector, b: Vector) -> Vector:
    """Component by component."""
    return (a[0] / b[0], a[1] / b[1], a[2] / b[2])


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
def distance(a: Vector, b: Vector) -> float:
    return norm(subtract(a, b))
