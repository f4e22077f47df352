"""Paths pulled taut over one surface or two, against what geometry says of them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ellipe, ellipeinc

from solver.model import WrapSurface
from tests.solver.wrapping.laid import cylinder, ellipsoid, lengths_over, lines_through, sphere, straight_lengths

Array = NDArray[np.float64]

RADIUS = 0.04
RADII = np.array([0.03, 0.05, 0.04])
RANDOM = np.random.default_rng(8)


def _length(surfaces: list[WrapSurface], *line: Array) -> float:
    return float(lengths_over(surfaces, [line], mode="geodesic")[0])


def _over_sphere(lines: Array) -> Array:
    """Two tangents and an arc of a great circle, where the straight line would pierce the sphere."""
    start, end = lines[:, 0], lines[:, 1]
    away = np.linalg.norm(lines, axis=-1)
    arc = np.arccos(np.sum(start * end, axis=1) / away.prod(axis=1)) - np.arccos(RADIUS / away).sum(axis=1)
    laid: Array = np.sqrt(away**2 - RADIUS**2).sum(axis=1) + RADIUS * arc
    return np.where(arc > 0, laid, straight_lengths(lines))


def _at(angle: float, distance: float, height: float) -> Array:
    return np.array([distance * np.cos(angle), distance * np.sin(angle), height])


def _shortest_section(radii: Array, line: Array) -> float:
    """Length of the shortest of 40 taut strings in planes through both ends, their arcs as polygons.

    Divided by the semi-axes, the surface is the unit sphere and a section a circle, which the string touches where the
    tangents from both ends do.
    """
    start, end = line
    along = (end - start) / np.linalg.norm(end - start)
    foot = start - (start @ along) * along
    if np.linalg.norm(foot) >= 1:
        return float(np.linalg.norm((end - start) * radii))
    frame = np.linalg.svd(along[None])[2][1:]
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)[:, None]
    across = np.cos(angles) * frame[0] + np.sin(angles) * frame[1]
    height = across @ foot
    centre = foot - height[:, None] * across
    radius = np.sqrt(1 - np.sum(centre**2, axis=1))
    # Angles from `along` towards `across`, at which the ends lie and at which their tangents touch.
    at_start, at_end = np.arctan2(height, start @ along), np.arctan2(height, end @ along)
    touch_start = at_start - np.arccos(radius / np.hypot(height, start @ along))
    touch_end = at_end + np.arccos(radius / np.hypot(height, end @ along))
    arc = (touch_start - touch_end) % (2 * np.pi)
    turns = touch_start[:, None] - arc[:, None] * np.linspace(0, 1, 400)
    circle = np.cos(turns)[..., None] * along + np.sin(turns)[..., None] * across[:, None]
    ends = (np.broadcast_to(place, (40, 1, 3)) for place in (start, end))
    corners = np.concatenate([next(ends), centre[:, None] + radius[:, None, None] * circle, next(ends)], axis=1) * radii
    return float(np.linalg.norm(np.diff(corners, axis=1), axis=-1).sum(axis=1).min())


def _unrolled(start: Array, end: Array, opening: float) -> float:
    """Over a cylinder, in the plane: tangents and arc in line, the rise across them."""
    away = np.array([np.hypot(*start[:2]), np.hypot(*end[:2])])
    around = np.sqrt(away**2 - RADIUS**2).sum() + RADIUS * (opening - np.arccos(RADIUS / away).sum())
    return float(np.hypot(around, end[2] - start[2]))


def test_over_a_sphere_it_is_two_tangents_and_a_great_circle() -> None:
    lines = lines_through(RADIUS, 4.0, 200)
    found = lengths_over([sphere(RADIUS)], lines, mode="geodesic")
    assert (found > straight_lengths(lines)).sum() > 100
    assert np.allclose(found, _over_sphere(lines), rtol=0, atol=1e-15)


def test_through_the_middle_of_a_sphere_it_goes_round_like_its_neighbours() -> None:
    through, beside = ([(-0.1, offset, 0.0), (0.1, offset, 0.0)] for offset in (0.0, 1e-9))
    lengths = lengths_over([sphere(RADIUS)], [through, beside], mode="geodesic")
    assert lengths[0] == pytest.approx(lengths[1], abs=1e-9)
    assert lengths[0] == pytest.approx(2 * (np.sqrt(0.01 - RADIUS**2) + RADIUS * np.arcsin(RADIUS / 0.1)), abs=1e-15)


@pytest.mark.parametrize("rise", [0.0, 0.03, 0.3])
def test_over_a_cylinder_it_is_straight_once_unrolled(rise: float) -> None:
    start, end = _at(0.1, 0.06, -0.2 * rise), _at(2.8, 0.09, 0.8 * rise)
    assert _length([cylinder(RADIUS, 1.0)], start, end) == pytest.approx(_unrolled(start, end, 2.7), abs=1e-15)


def test_a_cylinder_s_quadrant_sends_it_round_by_the_allowed_side() -> None:
    start, end = _at(-1.7, 0.09, 0.0), _at(1.8, 0.08, 0.02)
    allowed, forbidden = (_length([cylinder(RADIUS, 1.0, quadrant)], start, end) for quadrant in ("+x", "-x"))
    assert allowed == pytest.approx(_unrolled(start, end, 3.5), abs=1e-15)
    assert forbidden == pytest.approx(_unrolled(start, end, 2 * np.pi - 3.5), abs=1e-15)


@pytest.mark.parametrize("surface", [sphere, lambda radius, quadrant: ellipsoid([radius] * 3, quadrant)])
def test_a_sphere_s_quadrant_sends_it_round_by_the_allowed_side(surface) -> None:  # type: ignore[no-untyped-def]
    start, end = np.array([-0.09, 0.01, 0.0]), np.array([0.08, -0.001, 0.0])
    opening = np.arccos(start @ end / np.linalg.norm(start) / np.linalg.norm(end))
    assert _length([surface(RADIUS, "+y")], start, end) == pytest.approx(_unrolled(start, end, opening), abs=1e-12)
    long_way = _unrolled(start, end, 2 * np.pi - opening)
    assert _length([sphere(RADIUS, "-y")], start, end) == pytest.approx(long_way, abs=1e-12)


def test_an_ellipsoid_with_equal_radii_is_a_sphere() -> None:
    lines = lines_through(RADIUS, 4.0, 200)
    found = lengths_over([ellipsoid([RADIUS] * 3)], lines, mode="geodesic")
    assert np.allclose(found, _over_sphere(lines), rtol=0, atol=1e-14)


@pytest.mark.parametrize("radii", [(0.03, 0.05, 0.09), (0.09, 0.02, 0.05), (0.05, 0.05, 0.08)])
def test_in_a_plane_of_symmetry_it_follows_the_ellipse(radii: tuple[float, float, float]) -> None:
    """From (−x, 0) to (x, 0) over the ellipse; the arc is an incomplete elliptic integral of the second kind."""
    a, b, _ = radii
    away = 1.6 * a
    touching = np.arccos(a / away)  # the ellipse being (a cos φ, b sin φ)
    tangent = np.hypot(away - a * np.cos(touching), b * np.sin(touching))
    eccentricity = 1 - (a / b) ** 2
    arc = 2 * b * (ellipeinc(np.pi / 2, eccentricity) - ellipeinc(touching, eccentricity))
    found = _length([ellipsoid(radii)], np.array([-away, 0, 0]), np.array([away, 0, 0]))
    assert found == pytest.approx(2 * tangent + arc, abs=1e-14)


def test_from_pole_to_pole_of_a_spheroid_it_is_any_meridian() -> None:
    """Just off the surface at both ends: half a meridian, 2 b E(1 − a²/b²), a complete elliptic integral."""
    a, b = 0.03, 0.09
    off = 1 + 1e-12
    found = _length([ellipsoid((a, b, a))], np.array([0, -b * off, 0]), np.array([0, b * off, 0]))
    assert found == pytest.approx(2 * b * ellipe(1 - (a / b) ** 2), abs=1e-8)


def test_a_point_on_the_way_never_makes_it_shorter_and_none_is_the_way_s_own() -> None:
    """Stationary and shortest: a detour by any point of the surface is longer, by the second order of its distance."""
    surface = ellipsoid(RADII)
    start, end = np.array([-0.05, 0.03, 0.02]), np.array([0.06, 0.02, -0.01])
    shortest = _length([surface], start, end)
    points = RANDOM.normal(size=(300, 3))
    points *= (1 + 1e-6) / np.linalg.norm(points / RADII, axis=1, keepdims=True)
    legs = np.array([[[start, point], [point, end]] for point in points]).reshape(-1, 2, 3)
    detours = lengths_over([surface], legs, mode="geodesic").reshape(-1, 2).sum(axis=1)
    assert shortest < detours.min() < shortest + 0.005


def test_it_is_the_same_from_either_end() -> None:
    lines = lines_through(float(RADII.mean()), 4.0, 200)
    forwards, backwards = (lengths_over([ellipsoid(RADII)], each, mode="geodesic") for each in (lines, lines[:, ::-1]))
    assert np.allclose(forwards, backwards, rtol=0, atol=1e-14)


def test_it_is_never_longer_than_the_way_that_opensim_finds_but_for_what_that_leaves_unsettled() -> None:
    lines = lines_through(float(RADII.mean()), 4.0, 300)
    surfaces = [ellipsoid(RADII)]
    excess = lengths_over(surfaces, lines, mode="geodesic") - lengths_over(surfaces, lines)
    assert excess.max() < 1e-5
    assert np.median(np.abs(excess)) < 1e-4


@pytest.mark.parametrize("surface", [sphere(RADIUS), cylinder(RADIUS, 1.0), ellipsoid(RADII)])
def test_it_lifts_off_without_a_jump_or_a_bend(surface: WrapSurface) -> None:
    """As the ends are lowered across the surface's top, the detour begins with the square of the depth."""
    depth = np.array([-1e-3, -1e-6, 1e-6, 1e-4, 2e-4])
    lines = [[(-0.1, surface.dimensions[1] - d, 0.0), (0.1, surface.dimensions[1] - d, 0.0)] for d in depth]
    detour = lengths_over([surface], lines, mode="geodesic") - straight_lengths(lines)
    assert np.array_equal(detour[:2], [0.0, 0.0])
    assert 0.0 <= detour[2] < 1e-10
    assert 2**1.9 < detour[4] / detour[3] < 2**2.1


NEAR_CENTRE = [  # semi-axes, start, end: heights over the line mislead
    ((0.07244, 0.07625, 0.0507), (0.03401, -0.07531, -0.14828), (-0.01564, 0.03491, 0.0564)),
    ((0.04174, 0.03639, 0.0784), (0.00396, -0.01951, -0.07595), (-0.0052, 0.03639, 0.09891)),
    ((0.03958, 0.05508, 0.07851), (-0.1061, -0.03239, 0.20249), (0.02458, 0.0083, -0.06795)),
    ((0.07614, 0.03894, 0.05254), (-0.09749, 0.12885, 0.05673), (0.06286, -0.0379, -0.01399)),
]


def test_no_plane_section_is_shorter() -> None:
    """Nor where the line passes the centre and a wrong side costs millimetres; arcs are measured as polygons."""
    lines = [(RADII, line) for line in lines_through(1.0, 3.0, 30) * RADII]
    lines += [(np.array(radii), np.array(line)) for radii, *line in NEAR_CENTRE]
    found = np.array([_length([ellipsoid(radii)], *line) for radii, line in lines])
    excess = found - [_shortest_section(radii, line / radii) for radii, line in lines]
    assert excess.max() < 1e-6
    assert np.median(excess) > -1e-3


def test_two_surfaces_are_passed_on_one_bitangent() -> None:
    """Two spheres in a plane, passed on the same side: by hand, a belt's straight run and arcs."""
    left, right = sphere(0.02, centre=(-0.1, 0.0, 0.0)), sphere(0.02, centre=(0.1, 0.0, 0.0))
    start, end = np.array([-0.3, 0.001, 0.0]), np.array([0.3, 0.001, 0.0])
    away = np.hypot(0.2, 0.001)
    arc = np.pi / 2 - np.arccos(0.02 / away) - np.arctan2(0.001, 0.2)
    by_hand = 2 * np.sqrt(away**2 - 0.02**2) + 2 * 0.02 * arc + 0.2
    assert _length([left, right], start, end) == pytest.approx(by_hand, abs=1e-14)
    assert _length([right, left], start, end) == pytest.approx(by_hand, abs=1e-14)


def test_surfaces_of_all_kinds_on_one_piece_do_not_depend_on_the_order_in_which_they_are_tried() -> None:
    surfaces = [
        sphere(0.03, centre=(-0.15, 0.0, 0.0)),
        cylinder(0.02, 0.5, centre=(0.0, -0.002, 0.0)),
        ellipsoid((0.03, 0.025, 0.04), centre=(0.15, 0.0, 0.005)),
    ]
    start, end = np.array([-0.3, 0.001, 0.02]), np.array([0.3, 0.001, -0.03])
    lengths = [_length([surfaces[k] for k in order], start, end) for order in ((0, 1, 2), (2, 1, 0), (1, 0, 2))]
    assert np.ptp(lengths) < 1e-14
    assert min(lengths) > straight_lengths([[start, end]])[0] + 0.003


def test_a_point_inside_a_surface_keeps_the_path_straight_as_in_opensim() -> None:
    line = [[(0.0, 0.01, 0.0), (0.2, 0.0, 0.0)]]
    for surface in (sphere(RADIUS), cylinder(RADIUS, 1.0), ellipsoid(RADII)):
        assert np.array_equal(lengths_over([surface], line, mode="geodesic"), straight_lengths(line))


def test_a_cylinder_is_passed_beyond_its_ends() -> None:
    line = [[(-0.1, 0.01, 0.06), (0.1, 0.01, 0.06)]]
    long, short = (lengths_over([cylinder(RADIUS, length)], line, mode="geodesic") for length in (0.14, 0.1))
    assert short == straight_lengths(line)
    assert long > short


def test_a_quadrant_along_a_cylinder_s_axis_allows_all_ways_round() -> None:
    start, end = _at(0.2, 0.09, 0.0), _at(2.9, 0.07, 0.03)
    assert _length([cylinder(RADIUS, 1.0, "-z")], start, end) == _length([cylinder(RADIUS, 1.0)], start, end)


@pytest.mark.parametrize("surface", [sphere(RADIUS), cylinder(RADIUS, 1.0), ellipsoid(RADII)])
def test_a_place_that_is_not_a_number_gives_none(surface: WrapSurface) -> None:
    assert np.isnan(lengths_over([surface], [[(np.nan, 0.0, 0.0), (0.1, 0.0, 0.0)]], mode="geodesic")).all()


def test_every_segment_of_a_path_wraps_over_a_surface_that_it_intersects() -> None:
    left, middle, right = (-0.1, 0.0, 0.0), (0.0, 0.042, 0.0), (0.1, 0.0, 0.0)
    pieces = lengths_over([sphere(RADIUS)], [[left, middle], [middle, right]], mode="geodesic")
    assert (pieces > straight_lengths([[left, middle], [middle, right]])).all()
    assert lengths_over([sphere(RADIUS)], [[left, middle, right]], mode="geodesic")[0] == pytest.approx(pieces.sum())
