"""A path over an ellipsoid against the sphere, and against the ellipse that a coordinate plane cuts out of it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from tests.solver.wrapping.laid import Method, ellipsoid, lengths_over, lines_through, sphere, straight_lengths

Array = NDArray[np.float64]

METHODS: tuple[Method, ...] = ("hybrid", "midpoint", "axial")
RADII = (0.05, 0.09, 0.06)


def _touching(a: float, b: float, x: float, y: float) -> list[float]:
    """Angles t of the two points (a cos t, b sin t) whose tangents pass (x, y): x/a cos t + y/b sin t = 1."""
    middle, half = np.arctan2(y / b, x / a), np.arccos(1 / np.hypot(x / a, y / b))
    return [middle - half, middle + half]


def _over_ellipse(a: float, b: float, start: Array, end: Array) -> float:
    """The path from start over the top (through t = π/2) to an end further along in t, by quadrature."""
    t1, t2 = _touching(a, b, *start)[1], _touching(a, b, *end)[0] % (2 * np.pi)
    arc, _ = quad(lambda t: np.hypot(a * np.sin(t), b * np.cos(t)), t1, t2)
    touch_1, touch_2 = np.array([a * np.cos(t1), b * np.sin(t1)]), np.array([a * np.cos(t2), b * np.sin(t2)])
    return float(np.linalg.norm(start - touch_1) + arc + np.linalg.norm(end - touch_2))


@pytest.mark.parametrize("method", METHODS)
def test_with_equal_semi_axes_it_is_a_sphere(method: Method) -> None:
    """To the loose end of the tangents' search and the chords of 1 mm: 1e-4 m at worst, 1e-6 m mostly."""
    lines = lines_through(0.06, reach=2.5, count=200)
    over_sphere = lengths_over([sphere(0.06)], lines)
    difference = np.abs(lengths_over([ellipsoid((0.06, 0.06, 0.06))], lines, method) - over_sphere)
    assert (over_sphere > straight_lengths(lines) + 1e-6).sum() > 100
    assert difference.max() < 1e-4
    assert np.median(difference) < 2e-6


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("axes", [(1, 0), (2, 0)])
def test_in_a_coordinate_plane_the_path_follows_the_ellipse(method: Method, axes: tuple[int, int]) -> None:
    """Over the shortest semi-axis: elsewhere the path leaves the plane for it."""
    a, b = RADII[axes[0]], RADII[axes[1]]
    start, end = np.array([2.0 * a, 0.1 * b]), np.array([-1.5 * a, 0.2 * b])
    line = np.zeros((1, 2, 3))
    line[0][:, list(axes)] = start, end
    assert lengths_over([ellipsoid(RADII)], line, method)[0] == pytest.approx(_over_ellipse(a, b, start, end), abs=2e-5)


@pytest.mark.parametrize("method", METHODS)
def test_the_path_is_never_shorter_than_straight_and_moves_with_its_ends(method: Method) -> None:
    start, end = np.array([-0.02, -0.15, 0.03]), np.array([0.015, 0.16, 0.0])
    drift = np.linspace(0.0, 0.06, 400)[:, None]
    lines = np.stack([start + drift * [0.0, 0.0, 1.0], end + drift * [1.0, 0.0, 0.0]], axis=1)
    lengths = lengths_over([ellipsoid(RADII)], lines, method)
    assert (lengths >= straight_lengths(lines)).all()
    assert (lengths > straight_lengths(lines) + 1e-4).sum() > 50
    assert max(abs(b - a) for a, b in pairwise(lengths)) < 1e-3


def test_an_end_inside_and_ends_in_one_direction_and_a_miss_stay_straight() -> None:
    inside = [[0.0, 0.0, 0.01], [0.2, 0.0, 0.0]]
    one_direction = [[0.1, 0.1, 0.0], [0.2, 0.2001, 0.0]]
    miss = [[-0.2, 0.0, 0.07], [0.2, 0.0, 0.07]]
    lines = [inside, inside[::-1], one_direction, miss]
    assert np.array_equal(lengths_over([ellipsoid(RADII)], lines), straight_lengths(lines))


def test_an_end_on_the_surface_is_its_own_tangent_point() -> None:
    on_it, off_it = lengths_over(
        [ellipsoid(RADII)], [[[height * RADII[0], 0.0, 0.0], [-0.1, 0.01, 0.0]] for height in (1.0 + 1e-6, 1.0 + 1e-4)]
    )
    assert on_it == pytest.approx(off_it, abs=2e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("axis", "letter"), list(enumerate("xyz")))
def test_a_quadrant_mirrors_the_path(method: Method, axis: int, letter: str) -> None:
    """Ends a little to one side: the path over that side, and the mirrored ends' path over the other, are the same."""
    along, across = (axis + 1) % 3, (axis + 2) % 3
    line = np.zeros((1, 2, 3))
    line[0, :, along] = 1.8 * RADII[along], -1.9 * RADII[along]
    line[0, :, axis] = 0.1 * RADII[axis], 0.15 * RADII[axis]
    line[0, :, across] = 0.05 * RADII[across], 0.02 * RADII[across]
    mirrored = line.copy()
    mirrored[..., axis] *= -1.0
    free = lengths_over([ellipsoid(RADII)], line, method)[0]
    assert lengths_over([ellipsoid(RADII, f"+{letter}")], line, method)[0] == pytest.approx(free, abs=1e-12)
    assert lengths_over([ellipsoid(RADII, f"-{letter}")], mirrored, method)[0] == pytest.approx(free, abs=1e-12)


def test_a_quadrant_sends_the_path_over_the_allowed_side() -> None:
    a, b = RADII[0], RADII[1]
    line = np.array([[[2.0 * a, 0.1 * b, 0.0], [-2.0 * a, 0.1 * b, 0.0]]])
    over_the_top = _over_ellipse(a, b, line[0, 0, :2], line[0, 1, :2])
    below = line[0, :, :2] * [1.0, -1.0]
    round_the_bottom = _over_ellipse(a, b, below[0], below[1])
    assert lengths_over([ellipsoid(RADII, "+y")], line, "midpoint")[0] == pytest.approx(over_the_top, abs=2e-5)
    assert lengths_over([ellipsoid(RADII, "-y")], line, "midpoint")[0] == pytest.approx(round_the_bottom, abs=2e-5)
