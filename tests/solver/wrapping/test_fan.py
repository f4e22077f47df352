"""The mean direction of OpenSim's fan: sums over nodes against the blades themselves, in NumPy.

The closest point of an ellipsoid: on it, and the line to it is normal to it.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.compiled import compiled_for_python
from solver.vectors import Array, Vector, read, write
from solver.wrapping.fan import (
    ANY_AXIS,
    Fan,
    allocate_fan,
    closest_on_ellipse,
    closest_on_ellipsoid,
    closest_to_each,
    fan_direction,
)

STOP, SPACINGS = 1e-9, 300  # of OpenSim's search, and of its blades
SEMI_AXES = (0.7, 1.6, 0.7 + 1e-9)
RANDOM = np.random.default_rng(8)


@compiled_for_python
def _directions(starts: Array, inner: Array, radii: Array, fan: Fan, code: NDArray[np.int8], found: Array) -> None:
    for k in range(len(starts)):
        r, d, a = starts[k], inner[k], radii[k]
        vector = fan_direction((r[0], r[1], r[2]), (d[0], d[1], d[2]), (a[0], a[1], a[2]), fan, code)
        found[k, 0], found[k, 1], found[k, 2] = vector


def _found(starts: Array, inner: Array, radii: Array) -> Array:
    found = np.empty_like(starts)
    _directions(starts, inner, radii, allocate_fan(), np.zeros(1, np.int8), found)
    return found


def _direction_of_blades(start: Array, inner: Array, radii: Array) -> Array:
    x = start + (np.arange(1, SPACINGS - 1) / SPACINGS)[:, None] * inner
    squares, t = radii**2, np.zeros(len(x))
    for _ in range(64):
        sums = t[:, None] + squares
        product = (sums**2).prod(axis=1)
        terms = squares * x**2 / sums**2
        f = product * (1 - terms.sum(axis=1))
        slope = product * (2 * (1 / sums).sum(axis=1) * (1 - terms.sum(axis=1)) + 2 * (terms / sums).sum(axis=1))
        unfinished = np.abs(f) >= STOP
        if not unfinished.any():
            break
        t[unfinished] -= (f / slope)[unfinished]
    blades = squares * x / (t[:, None] + squares) - x
    lengths = np.linalg.norm(blades, axis=1, keepdims=True)
    total = np.divide(blades, lengths, out=np.zeros_like(blades), where=lengths > 0).sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))


def _segments(count: int) -> tuple[Array, Array, Array]:
    """Segments that pierce ellipsoids, from grazing ones to those near the centre; the semi-axes average 1."""
    generator = np.random.default_rng(11)
    radii = generator.uniform(0.4, 2.0, (count, 3))
    radii *= 3 / radii.sum(axis=1, keepdims=True)
    ends = generator.normal(size=(2, count, 3))
    ends /= np.linalg.norm(ends, axis=2, keepdims=True)
    near = ends[0] + generator.uniform(0.05, 1.0, (count, 1)) * ends[1]
    ends[1] = near / np.linalg.norm(near, axis=1, keepdims=True)
    return ends[0] * radii, (ends[1] - ends[0]) * radii, radii


@pytest.mark.slow
def test_the_fan_is_the_mean_of_its_blades() -> None:
    starts, inner, radii = _segments(400)
    expected = np.array([_direction_of_blades(*segment) for segment in zip(starts, inner, radii, strict=True)])
    np.testing.assert_allclose(_found(starts, inner, radii), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shift", [0.0, 1e-4])
def test_the_fan_of_a_segment_through_a_plane_of_symmetry_at_a_blade(shift: float) -> None:
    radii = np.array([0.8, 1.3, 0.9])
    start = np.array([-0.5, 0.6, 0.3 + shift])
    inner = np.array([1.0, 0.1, 0.05])  # blade 150 starts at x = 0
    expected = _direction_of_blades(start, inner, radii)
    np.testing.assert_allclose(_found(*np.array([[start], [inner], [radii]]))[0], expected, rtol=0, atol=1e-10)


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
