"""A path over a sphere against plane trigonometry: it lies in the plane of its ends and the centre."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.solver.wrapping.laid import lengths_over, lines_through, sphere, straight_lengths

Array = NDArray[np.float64]

RADIUS = 0.05


def _tangents_and_arc(lines: Array, opening: Array | float) -> Array:
    """Length over a circle between two points seen from its centre under the angle `opening`."""
    distances: Array = np.linalg.norm(lines, axis=-1)
    arc = opening - np.arccos(RADIUS / distances).sum(axis=1)
    length: Array = np.sqrt(distances**2 - RADIUS**2).sum(axis=1) + RADIUS * arc
    return length


def _opening(lines: Array) -> Array:
    start, end = lines[:, 0], lines[:, 1]
    opening: Array = np.arctan2(np.linalg.norm(np.cross(start, end), axis=1), np.sum(start * end, axis=1))
    return opening


def test_a_path_that_would_pierce_the_sphere_takes_tangents_and_the_great_circle() -> None:
    lines = lines_through(RADIUS, reach=3.0, count=300)
    taut = _tangents_and_arc(lines, _opening(lines))
    is_pierced = _opening(lines) > np.arccos(RADIUS / np.linalg.norm(lines, axis=-1)).sum(axis=1)
    assert 100 < is_pierced.sum() < 300
    expected = np.where(is_pierced, taut, straight_lengths(lines))
    assert np.allclose(lengths_over([sphere(RADIUS)], lines), expected, rtol=0, atol=1e-13)


def test_an_end_inside_the_sphere_leaves_the_path_straight() -> None:
    lines = np.array([[[0.0, 0.01, 0.0], [0.1, 0.02, 0.0]], [[-0.1, 0.02, 0.0], [0.0, 0.01, 0.0]]])
    assert np.array_equal(lengths_over([sphere(RADIUS)], lines), straight_lengths(lines))


def test_a_line_through_the_centre_has_no_plane_and_stays_straight() -> None:
    lines = np.array([[[-0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]])
    assert np.array_equal(lengths_over([sphere(RADIUS)], lines), straight_lengths(lines))


def test_a_quadrant_sends_the_path_over_the_allowed_side() -> None:
    below = np.array([[[-0.1, -0.02, 0.01], [0.12, -0.015, 0.01]]])
    above = below * [1.0, -1.0, 1.0]
    assert np.allclose(lengths_over([sphere(RADIUS, "+y")], above), _tangents_and_arc(above, _opening(above)))
    assert np.allclose(lengths_over([sphere(RADIUS, "-y")], below), _tangents_and_arc(below, _opening(below)))
    round_the_other_side = _tangents_and_arc(below, 2 * np.pi - _opening(below))
    assert np.allclose(lengths_over([sphere(RADIUS, "+y")], below), round_the_other_side)


def test_a_quadrant_counts_for_a_path_with_one_end_on_either_side() -> None:
    lines = np.array([[[-0.1, -0.03, 0.0], [0.1, 0.02, 0.0]]])
    through_plus_y = _tangents_and_arc(lines, 2 * np.pi - _opening(lines))
    through_minus_y = _tangents_and_arc(lines, _opening(lines))
    assert np.allclose(lengths_over([sphere(RADIUS, "+y")], lines), through_plus_y)
    assert np.allclose(lengths_over([sphere(RADIUS, "-y")], lines), through_minus_y)


def test_of_several_pieces_the_one_with_the_shortest_detour_is_wrapped() -> None:
    far, near, mid = [-0.2, 0.049, 0.0], [0.2, 0.0, 0.01], [0.2, 0.049, 0.0]
    line = np.array([[far, mid, [0.3, 0.0, 0.01], [-0.2, 0.0, 0.01]]])
    pieces = np.array([[far, mid], [[0.3, 0.0, 0.01], [-0.2, 0.0, 0.01]]])
    detours = lengths_over([sphere(RADIUS)], pieces) - straight_lengths(pieces)
    assert detours[0] < detours[1], near
    assert np.allclose(lengths_over([sphere(RADIUS)], line), straight_lengths(line) + detours[0])
    assert np.allclose(lengths_over([sphere(RADIUS)], line[:, ::-1]), straight_lengths(line) + detours[0])
