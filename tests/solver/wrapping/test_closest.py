"""The closest point of an ellipsoid: on it, and the line to it is normal to it."""

from __future__ import annotations

import numpy as np
import pytest

from solver.wrapping.closest import ANY_AXIS, closest_on_ellipse, closest_on_ellipsoid, closest_to_each

SEMI_AXES = (0.7, 1.6, 0.7 + 1e-9)
RANDOM = np.random.default_rng(8)


@pytest.mark.parametrize("spread", [0.4, 3.0])
def test_the_closest_point_of_an_ellipsoid_is_the_foot_of_a_normal(spread: float) -> None:
    a = np.array(SEMI_AXES)
    for point in RANDOM.normal(size=(200, 3)) * spread:
        foot = np.array(closest_on_ellipsoid(SEMI_AXES, tuple(point), ANY_AXIS))
        normal = foot / a**2
        assert np.sum((foot / a) ** 2) == pytest.approx(1.0, abs=1e-5)
        assert np.linalg.norm(np.cross(point - foot, normal)) < 1e-9 * (1 + np.linalg.norm(point - foot))


def test_points_in_a_coordinate_plane_keep_to_it() -> None:
    for axis in range(3):
        point = RANDOM.normal(size=3)
        point[axis] = 0.0
        foot = closest_on_ellipsoid(SEMI_AXES, tuple(point), ANY_AXIS)
        assert foot[axis] == 0.0
        assert sum((foot[i] / SEMI_AXES[i]) ** 2 for i in range(3)) == pytest.approx(1.0, abs=1e-5)


def test_the_centre_is_closest_to_the_shortest_semi_axis_of_the_narrowest_ellipse() -> None:
    assert closest_on_ellipsoid((0.7, 1.6, 0.9), (0.0, 0.0, 0.0), ANY_AXIS) == (0.7, 0.0, 0.0)


def test_points_on_an_axis_of_an_ellipse() -> None:
    a, b = 2.0, 1.0
    assert closest_on_ellipse(a, b, 0.0, 0.5) == (0.0, 1.0)
    assert closest_on_ellipse(a, b, 0.0, -0.5) == (0.0, -1.0)
    assert closest_on_ellipse(a, b, 1.7, 0.0) == (2.0, 0.0)
    x, y = closest_on_ellipse(a, b, 0.6, 0.0)
    assert (x / a) ** 2 + (y / b) ** 2 == pytest.approx(1.0)
    assert x == pytest.approx(a**2 * 0.6 / (a**2 - b**2))
    swapped = closest_on_ellipse(b, a, 0.0, 0.6)
    assert swapped == (y, x)
    assert closest_on_ellipse(a, b, 0.0, 0.0) == (0.0, 1.0)
    assert closest_on_ellipse(b, a, 0.0, 0.0) == (1.0, 0.0)


def test_many_points_at_once_give_bit_for_bit_the_same_points() -> None:
    points = RANDOM.normal(size=(3, 101))
    points[1, 7] = points[0, 8] = points[2, 8] = 0.0
    one_by_one = [closest_on_ellipsoid(SEMI_AXES, tuple(point), ANY_AXIS) for point in points.T]
    assert np.array_equal(closest_to_each(SEMI_AXES, points).T, one_by_one)
