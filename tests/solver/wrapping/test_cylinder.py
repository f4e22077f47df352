"""A path over a cylinder against the unrolled surface, where the shortest path is a straight line."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.solver.wrapping.laid import cylinder, lengths_over, sphere, straight_lengths

Array = NDArray[np.float64]

RADIUS, LENGTH = 0.04, 0.4
OUT_OF_THE_WAY = sphere(0.001, centre=(0.0, 0.0, 5.0))


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
