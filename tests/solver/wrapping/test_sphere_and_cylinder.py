"""A path over a cylinder against the unrolled surface, where the shortest path is a straight line.

A path over a sphere against plane trigonometry: it lies in the plane of its ends and the centre.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.model import GROUND, Placement, WrapSurface
from tests.solver.wrapping.laid import cylinder, lengths_over, lines_through, sphere, straight_lengths

Array = NDArray[np.float64]

RADIUS, LENGTH = 0.04, 0.4
OUT_OF_THE_WAY = sphere(0.001, centre=(0.0, 0.0, 5.0))
SPHERE_RADIUS = 0.05
TUBE, RING = 0.02, 0.1
ANGLES = [0.0, 0.7, 2.5, 4.0]


def _shortest(start: Array, end: Array, opening: float) -> float:
    """Unrolled: tangents and arc in line, the rise across them; `opening` is the angle between the ends' radii."""
    distances = np.array([np.hypot(*start[:2]), np.hypot(*end[:2])])
    around = np.sqrt(distances**2 - RADIUS**2).sum() + RADIUS * (opening - np.arccos(RADIUS / distances).sum())
    return float(np.hypot(around, end[2] - start[2]))


def _at(angle: float, distance: float, height: float) -> Array:
    return np.array([distance * np.cos(angle), distance * np.sin(angle), height])


def _length(*line: Array, quadrant: str = "all", length: float = LENGTH, is_alone: bool = True) -> float:
    surfaces = [cylinder(RADIUS, length, quadrant)]
    return float(lengths_over(surfaces if is_alone else [*surfaces, OUT_OF_THE_WAY], [line])[0])


@pytest.mark.parametrize("is_alone", [True, False])
def test_without_rise_the_path_is_that_over_a_circle(is_alone: bool) -> None:
    start, end = _at(0.2, 0.09, 0.03), _at(2.9, 0.07, 0.03)
    assert _length(start, end, is_alone=is_alone) == pytest.approx(_shortest(start, end, 2.7), abs=1e-13)


@pytest.mark.parametrize("rise", [0.01, 0.04, 0.08])
def test_with_another_surface_the_tangents_slide_until_the_path_is_almost_the_shortest(rise: float) -> None:
    start, end = _at(0.1, 0.06, -0.2 * rise), _at(2.8, 0.09, 0.8 * rise)
    shortest = _shortest(start, end, 2.7)
    assert shortest - 1e-12 <= _length(start, end, is_alone=False) < shortest + 2e-6


def test_alone_the_tangents_do_not_slide_and_the_path_is_a_little_longer() -> None:
    start, end = _at(0.1, 0.06, -0.01), _at(2.8, 0.09, 0.06)
    shortest = _shortest(start, end, 2.7)
    assert _length(start, end, is_alone=False) < _length(start, end) < 1.02 * shortest
    assert _length(start, end) > shortest


def test_a_path_that_misses_the_cylinder_or_ends_inside_it_stays_straight() -> None:
    missing = [_at(0.1, 0.09, 0.0), _at(1.5, 0.09, 0.0)]
    inside = [_at(0.1, 0.02, 0.0), _at(2.9, 0.09, 0.0)]
    along_the_axis = [_at(0.1, 0.05, -0.1), _at(0.1, 0.05, 0.1)]
    for line in (missing, inside, inside[::-1], along_the_axis):
        assert _length(*line) == straight_lengths([line])[0]


def test_a_path_beyond_the_end_of_the_cylinder_stays_straight() -> None:
    line = [_at(0.1, 0.09, 0.06), _at(2.9, 0.09, 0.06)]
    assert _length(*line, length=0.1) == straight_lengths([line])[0]
    assert _length(*line, length=0.14) > straight_lengths([line])[0]


@pytest.mark.parametrize(("quadrant", "turn"), [("+x", 0.0), ("+y", np.pi / 2), ("-x", np.pi), ("-y", -np.pi / 2)])
def test_a_quadrant_sends_the_path_over_the_allowed_side(quadrant: str, turn: float) -> None:
    """Both ends are seen just beyond ±90° from the allowed side: that way round is the longer one."""
    start, end = _at(turn - 1.7, 0.09, 0.0), _at(turn + 1.8, 0.08, 0.0)
    opposite = quadrant.translate(str.maketrans("+-", "-+"))
    assert _length(start, end, quadrant=quadrant) == pytest.approx(_shortest(start, end, 3.5), abs=1e-12)
    assert _length(start, end, quadrant=opposite) == pytest.approx(_shortest(start, end, 2 * np.pi - 3.5), abs=1e-12)


def test_a_quadrant_pulls_a_path_over_that_would_pass_on_the_other_side() -> None:
    start, end = _at(-np.pi / 2 - 1.1, 0.09, 0.0), _at(-np.pi / 2 + 1.1, 0.09, 0.0)
    assert straight_lengths([[start, end]])[0] < _length(start, end, quadrant="+y")
    assert _length(start, end, quadrant="+y") == pytest.approx(_shortest(start, end, 2 * np.pi - 2.2), abs=1e-12)


def test_a_path_on_the_allowed_side_that_clears_the_cylinder_stays_straight() -> None:
    line = [_at(np.pi / 2 - 0.9, 0.09, 0.0), _at(np.pi / 2 + 0.9, 0.09, 0.0)]
    assert _length(*line, quadrant="+y") == straight_lengths([line])[0]


def test_an_end_in_the_plane_z_0_keeps_the_other_tangent_point_unslid_as_in_opensim() -> None:
    start, end = _at(0.1, 0.06, 0.05), _at(2.8, 0.09, 0.0)
    nearly = _at(2.8, 0.09, 1e-9)
    assert abs(_length(start, end) - _length(start, nearly)) > 1e-5


def _tangents_and_arc(lines: Array, opening: Array | float) -> Array:
    """Length over a circle between two points seen from its centre under the angle `opening`."""
    distances: Array = np.linalg.norm(lines, axis=-1)
    arc = opening - np.arccos(SPHERE_RADIUS / distances).sum(axis=1)
    length: Array = np.sqrt(distances**2 - SPHERE_RADIUS**2).sum(axis=1) + SPHERE_RADIUS * arc
    return length


def _opening(lines: Array) -> Array:
    start, end = lines[:, 0], lines[:, 1]
    opening: Array = np.arctan2(np.linalg.norm(np.cross(start, end), axis=1), np.sum(start * end, axis=1))
    return opening


def test_a_path_that_would_pierce_the_sphere_takes_tangents_and_the_great_circle() -> None:
    lines = lines_through(SPHERE_RADIUS, reach=3.0, count=300)
    taut = _tangents_and_arc(lines, _opening(lines))
    is_pierced = _opening(lines) > np.arccos(SPHERE_RADIUS / np.linalg.norm(lines, axis=-1)).sum(axis=1)
    assert 100 < is_pierced.sum() < 300
    expected = np.where(is_pierced, taut, straight_lengths(lines))
    assert np.allclose(lengths_over([sphere(SPHERE_RADIUS)], lines), expected, rtol=0, atol=1e-13)


def test_an_end_inside_the_sphere_leaves_the_path_straight() -> None:
    lines = np.array([[[0.0, 0.01, 0.0], [0.1, 0.02, 0.0]], [[-0.1, 0.02, 0.0], [0.0, 0.01, 0.0]]])
    assert np.array_equal(lengths_over([sphere(SPHERE_RADIUS)], lines), straight_lengths(lines))


def test_a_line_through_the_centre_has_no_plane_and_stays_straight() -> None:
    lines = np.array([[[-0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]])
    assert np.array_equal(lengths_over([sphere(SPHERE_RADIUS)], lines), straight_lengths(lines))


def test_a_quadrant_of_a_sphere_sends_the_path_over_the_allowed_side() -> None:
    below = np.array([[[-0.1, -0.02, 0.01], [0.12, -0.015, 0.01]]])
    above = below * [1.0, -1.0, 1.0]
    assert np.allclose(lengths_over([sphere(SPHERE_RADIUS, "+y")], above), _tangents_and_arc(above, _opening(above)))
    assert np.allclose(lengths_over([sphere(SPHERE_RADIUS, "-y")], below), _tangents_and_arc(below, _opening(below)))
    round_the_other_side = _tangents_and_arc(below, 2 * np.pi - _opening(below))
    assert np.allclose(lengths_over([sphere(SPHERE_RADIUS, "+y")], below), round_the_other_side)


def test_a_quadrant_counts_for_a_path_with_one_end_on_either_side() -> None:
    lines = np.array([[[-0.1, -0.03, 0.0], [0.1, 0.02, 0.0]]])
    through_plus_y = _tangents_and_arc(lines, 2 * np.pi - _opening(lines))
    through_minus_y = _tangents_and_arc(lines, _opening(lines))
    assert np.allclose(lengths_over([sphere(SPHERE_RADIUS, "+y")], lines), through_plus_y)
    assert np.allclose(lengths_over([sphere(SPHERE_RADIUS, "-y")], lines), through_minus_y)


def test_of_several_pieces_the_one_with_the_shortest_detour_is_wrapped() -> None:
    far, near, mid = [-0.2, 0.049, 0.0], [0.2, 0.0, 0.01], [0.2, 0.049, 0.0]
    line = np.array([[far, mid, [0.3, 0.0, 0.01], [-0.2, 0.0, 0.01]]])
    pieces = np.array([[far, mid], [[0.3, 0.0, 0.01], [-0.2, 0.0, 0.01]]])
    detours = lengths_over([sphere(SPHERE_RADIUS)], pieces) - straight_lengths(pieces)
    assert detours[0] < detours[1], near
    assert np.allclose(lengths_over([sphere(SPHERE_RADIUS)], line), straight_lengths(line) + detours[0])
    assert np.allclose(lengths_over([sphere(SPHERE_RADIUS)], line[:, ::-1]), straight_lengths(line) + detours[0])


# A path over a torus against plane geometry: in a plane through its axis the tube is a circle.


def torus(quadrant: str = "all") -> WrapSurface:
    return WrapSurface("torus", GROUND, Placement(np.eye(3), np.zeros(3)), "torus", np.array([TUBE, RING, 0]), quadrant)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_path_through_the_hole_wraps_round_the_inside_of_the_tube(angle: float) -> None:
    outside, height = 0.015, 0.2
    outwards = np.array([np.cos(angle), np.sin(angle), 0.0])
    line = [(RING + outside) * outwards + [0, 0, height], (RING + outside) * outwards - [0, 0, height]]
    distance = np.hypot(outside, height)
    arc = 2 * (np.arctan2(outside, height) + np.arcsin(TUBE / distance))
    taut = 2 * np.sqrt(distance**2 - TUBE**2) + TUBE * arc
    assert lengths_over([torus()], [line]) == pytest.approx(taut, abs=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_path_along_the_axis_stays_straight(angle: float) -> None:
    line = [[0.03 * np.cos(angle), 0.03 * np.sin(angle), 0.2], [0.03 * np.cos(angle), 0.03 * np.sin(angle), -0.2]]
    assert lengths_over([torus()], [line]) == pytest.approx(straight_lengths([line])[0])


def test_a_path_over_the_side_that_is_not_allowed_stays_straight() -> None:
    line = [[RING + 0.015, 0.0, 0.2], [RING + 0.015, 0.0, -0.2]]
    straight = straight_lengths([line])[0]
    assert lengths_over([torus("+x")], [line]) > straight + 1e-3
    assert lengths_over([torus("-x")], [line]) == straight
