"""The closest point of an ellipsoid: on it, and the line to it is normal to it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.compiled import compiled_for_python
from solver.vectors import Vector, read, write
from solver.wrapping.closest import ANY_AXIS, closest_on_ellipse, closest_on_ellipsoid, closest_to_each

Array = NDArray[np.float64]

SEMI_AXES = (0.7, 1.6, 0.7 + 1e-9)
RANDOM = np.random.default_rng(8)


@compiled_for_python
def _feet(a: Vector, points: Array) -> Array:
    """Closest points (n, 3) to points (n, 3), one by one."""
    feet, code = np.empty_like(points), np.zeros(1, np.int8)
    for i in range(len(points)):
        write(feet[i], closest_on_ellipsoid(a, read(points[i]), ANY_AXIS, code))
    return feet


@compiled_for_python
def _feet_together(a: Vector, points: Array) -> Array:
    feet = np.empty_like(points)
    closest_to_each(a, points, np.empty(points.shape[1]), feet, np.zeros(1, np.int8))
    return feet


@compiled_for_python
def _foot_on_ellipse(a: float, b: float, u: float, v: float) -> tuple[float, float]:
    return closest_on_ellipse(a, b, u, v, np.zeros(1, np.int8))


@pytest.mark.parametrize("spread", [0.4, 3.0])
def test_the_closest_point_of_an_ellipsoid_is_the_foot_of_a_normal(spread: float) -> None:
    a = np.array(SEMI_AXES)
    points = RANDOM.normal(size=(200, 3)) * spread
    feet = _feet(SEMI_AXES, points)
    assert np.allclose(np.sum((feet / a) ** 2, axis=1), 1.0, atol=1e-5)
    assert np.allclose(np.cross(points - feet, feet / a**2), 0.0, atol=1e-9)


def test_points_in_a_coordinate_plane_keep_to_it() -> None:
    points = RANDOM.normal(size=(3, 3))
    np.fill_diagonal(points, 0.0)
    feet = _feet(SEMI_AXES, points)
    assert np.array_equal(np.diag(feet), np.zeros(3))
    assert np.allclose(np.sum((feet / np.array(SEMI_AXES)) ** 2, axis=1), 1.0, atol=1e-5)


def test_the_centre_is_closest_to_the_shortest_semi_axis_of_the_narrowest_ellipse() -> None:
    assert _feet((0.7, 1.6, 0.9), np.zeros((1, 3))).tolist() == [[0.7, 0.0, 0.0]]


def test_points_on_an_axis_of_an_ellipse() -> None:
    a, b = 2.0, 1.0
    assert _foot_on_ellipse(a, b, 0.0, 0.5) == (0.0, 1.0)
    assert _foot_on_ellipse(a, b, 0.0, -0.5) == (0.0, -1.0)
    assert _foot_on_ellipse(a, b, 1.7, 0.0) == (2.0, 0.0)
    x, y = _foot_on_ellipse(a, b, 0.6, 0.0)
    assert (x / a) ** 2 + (y / b) ** 2 == pytest.approx(1.0)
    assert x == pytest.approx(a**2 * 0.6 / (a**2 - b**2))
    swapped = _foot_on_ellipse(b, a, 0.0, 0.6)
    assert swapped == (y, x)
    assert _foot_on_ellipse(a, b, 0.0, 0.0) == (0.0, 1.0)
    assert _foot_on_ellipse(b, a, 0.0, 0.0) == (1.0, 0.0)


def test_many_points_at_once_give_bit_for_bit_the_same_points() -> None:
    points = RANDOM.normal(size=(3, 101))
    points[1, 7] = points[0, 8] = points[2, 8] = 0.0
    assert np.array_equal(_feet_together(SEMI_AXES, points).T, _feet(SEMI_AXES, points.T.copy()))
