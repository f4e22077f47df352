"""Vectors of three for compiled code: tuples, which live in registers where arrays would be allocated."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Function = TypeVar("Function", bound=Callable[..., object])

ORIGIN = (0.0, 0.0, 0.0)
SMALLEST_LENGTH = 2.220446049250313e-16


def compiled(function: Function) -> Function:
    """The function as machine code for other compiled functions; division by zero gives inf or NaN, as in C.

    It cannot be called from Python: to leave out the door saves a third of the time to compile.
    """
    options: dict[str, Any] = {
        "error_model": "numpy",
        "nogil": True,
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
    }
    return cast(Function, njit(**options)(function))


def compiled_for_python(function: Function) -> Function:
    """Like compiled, with a door, and kept on disk until its file or one of its closure's variables changes."""
    return cast(Function, njit(error_model="numpy", nogil=True, cache=True)(function))


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
