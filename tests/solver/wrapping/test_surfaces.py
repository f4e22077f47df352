"""Paths over one surface against geometry: unrolled cylinders, great circles, ellipses, and circles round a torus."""

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.integrate import quad

from solver.model import Array, WrapSurface
from tests.solver.wrapping.laid import (
    METHODS,
    Method,
    at_angle,
    cylinder,
    ellipsoid,
    lengths_over,
    lines_through,
    sphere,
    straight_lengths,
    torus,
    unrolled,
)

RADIUS, LENGTH = 0.04, 0.4
OUT_OF_THE_WAY = sphere(0.001, centre=(0.0, 0.0, 5.0))
SPHERE_RADIUS = 0.05
TUBE, RING = 0.02, 0.1
ANGLES = [0.0, 0.7, 2.5, 4.0]
RADII = (0.05, 0.09, 0.06)
TUBES = {side: torus(TUBE, RING, side) for side in ("all", "+x", "-x")}


def _length(surface: WrapSurface, *line: ArrayLike) -> float:
    return float(lengths_over([surface], [line])[0])


def _over_cylinder(*line: Array, is_alone: bool) -> float:
    surfaces = [cylinder(RADIUS, LENGTH)]
    return float(lengths_over(surfaces if is_alone else [*surfaces, OUT_OF_THE_WAY], [line])[0])


def _tangents_and_arc(lines: ArrayLike, opening: Array | float | None = None) -> Array:
    """Length over a sphere between two points seen from its centre under the angle `opening`, theirs unless given."""
    lines = np.asarray(lines)
    distances: Array = np.linalg.norm(lines, axis=-1)
    opening = _opening(lines) if opening is None else opening
    arc = opening - np.arccos(SPHERE_RADIUS / distances).sum(axis=1)
    length: Array = np.sqrt(distances**2 - SPHERE_RADIUS**2).sum(axis=1) + SPHERE_RADIUS * arc
    return length


def _opening(lines: Array) -> Array:
    start, end = lines[:, 0], lines[:, 1]
    opening: Array = np.arctan2(np.linalg.norm(np.cross(start, end), axis=1), np.sum(start * end, axis=1))
    return opening


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


TUBE_SIDE = [(RING + 0.015, 0.0, 0.2), (RING + 0.015, 0.0, -0.2)]
STRAIGHT: dict[str, tuple[WrapSurface, list[ArrayLike]]] = {
    "cylinder missed": (cylinder(RADIUS, LENGTH), [at_angle(0.1, 0.09, 0.0), at_angle(1.5, 0.09, 0.0)]),
    "inside a cylinder": (cylinder(RADIUS, LENGTH), [at_angle(0.1, 0.02, 0.0), at_angle(2.9, 0.09, 0.0)]),
    "along a cylinder's axis": (cylinder(RADIUS, LENGTH), [at_angle(0.1, 0.05, -0.1), at_angle(0.1, 0.05, 0.1)]),
    "beyond a cylinder's end": (cylinder(RADIUS, 0.1), [at_angle(0.1, 0.09, 0.06), at_angle(2.9, 0.09, 0.06)]),
    "on the allowed side": (
        cylinder(RADIUS, LENGTH, "+y"),
        [at_angle(np.pi / 2 - 0.9, 0.09, 0.0), at_angle(np.pi / 2 + 0.9, 0.09, 0.0)],
    ),
    "inside a sphere": (sphere(SPHERE_RADIUS), [(0.0, 0.01, 0.0), (0.1, 0.02, 0.0)]),
    "through a sphere's centre, without a plane": (sphere(SPHERE_RADIUS), [(-0.1, 0.0, 0.0), (0.2, 0.0, 0.0)]),
    "inside an ellipsoid": (ellipsoid(RADII), [(0.0, 0.0, 0.01), (0.2, 0.0, 0.0)]),
    "ends in one direction": (ellipsoid(RADII), [(0.1, 0.1, 0.0), (0.2, 0.2001, 0.0)]),
    "ellipsoid missed": (ellipsoid(RADII), [(-0.2, 0.0, 0.07), (0.2, 0.0, 0.07)]),
    "tube on the side that is not allowed": (TUBES["-x"], list(TUBE_SIDE)),
    **{
        f"along a torus's axis at {angle} rad": (
            TUBES["all"],
            [at_angle(angle, 0.03, 0.2), at_angle(angle, 0.03, -0.2)],
        )
        for angle in ANGLES
    },
}


@pytest.mark.parametrize("name", STRAIGHT)
def test_a_path_stays_straight(name: str) -> None:
    surface, line = STRAIGHT[name]
    for ends in (line, line[::-1]):
        assert _length(surface, *ends) == straight_lengths([ends])[0]


def test_a_path_of_those_wraps_over_a_longer_cylinder_and_over_the_allowed_side_of_a_tube() -> None:
    _, beyond = STRAIGHT["beyond a cylinder's end"]
    for surface, line in ((cylinder(RADIUS, 0.14), beyond), (TUBES["+x"], TUBE_SIDE)):
        assert _length(surface, *line) > straight_lengths([line])[0] + 1e-3


@pytest.mark.parametrize("is_alone", [True, False])
def test_without_rise_the_path_is_that_over_a_circle(is_alone: bool) -> None:
    line = at_angle(0.2, 0.09, 0.03), at_angle(2.9, 0.07, 0.03)
    assert _over_cylinder(*line, is_alone=is_alone) == pytest.approx(unrolled(RADIUS, *line, 2.7), abs=1e-13)


@pytest.mark.parametrize("rise", [0.01, 0.04, 0.08])
def test_with_another_surface_the_tangents_slide_until_the_path_is_almost_the_shortest(rise: float) -> None:
    line = at_angle(0.1, 0.06, -0.2 * rise), at_angle(2.8, 0.09, 0.8 * rise)
    shortest = unrolled(RADIUS, *line, 2.7)
    assert shortest - 1e-12 <= _over_cylinder(*line, is_alone=False) < shortest + 2e-6


def test_alone_the_tangents_do_not_slide_and_the_path_is_a_little_longer() -> None:
    line = at_angle(0.1, 0.06, -0.01), at_angle(2.8, 0.09, 0.06)
    shortest, alone = unrolled(RADIUS, *line, 2.7), _over_cylinder(*line, is_alone=True)
    assert max(shortest, _over_cylinder(*line, is_alone=False)) < alone < 1.02 * shortest


@pytest.mark.parametrize(("quadrant", "turn"), [("+x", 0.0), ("+y", np.pi / 2), ("-x", np.pi), ("-y", -np.pi / 2)])
def test_a_quadrant_sends_the_path_over_the_allowed_side_of_a_cylinder(quadrant: str, turn: float) -> None:
    """Ends just beyond ±90° from the allowed side go the longer way round, and others are pulled over it."""
    line = at_angle(turn - 1.7, 0.09, 0.0), at_angle(turn + 1.8, 0.08, 0.0)
    surface = cylinder(RADIUS, LENGTH, quadrant)
    opposite = cylinder(RADIUS, LENGTH, quadrant.translate(str.maketrans("+-", "-+")))
    assert _length(surface, *line) == pytest.approx(unrolled(RADIUS, *line, 3.5), abs=1e-12)
    assert _length(opposite, *line) == pytest.approx(unrolled(RADIUS, *line, 2 * np.pi - 3.5), abs=1e-12)
    other_side = at_angle(turn + np.pi - 1.1, 0.09, 0.0), at_angle(turn + np.pi + 1.1, 0.09, 0.0)
    assert straight_lengths([other_side])[0] < _length(surface, *other_side)
    pulled = unrolled(RADIUS, *other_side, 2 * np.pi - 2.2)
    assert _length(surface, *other_side) == pytest.approx(pulled, abs=1e-12)


def test_an_end_in_the_plane_z_0_keeps_the_other_tangent_point_unslid_as_in_opensim() -> None:
    start, *ends = at_angle(0.1, 0.06, 0.05), at_angle(2.8, 0.09, 0.0), at_angle(2.8, 0.09, 1e-9)
    in_plane, nearly = (_over_cylinder(start, end, is_alone=True) for end in ends)
    assert abs(in_plane - nearly) > 1e-5


def test_a_path_that_would_pierce_the_sphere_takes_tangents_and_the_great_circle() -> None:
    lines = lines_through(SPHERE_RADIUS, reach=3.0, count=300)
    is_pierced = _opening(lines) > np.arccos(SPHERE_RADIUS / np.linalg.norm(lines, axis=-1)).sum(axis=1)
    assert 100 < is_pierced.sum() < 300
    expected = np.where(is_pierced, _tangents_and_arc(lines), straight_lengths(lines))
    assert np.allclose(lengths_over([sphere(SPHERE_RADIUS)], lines), expected, rtol=0, atol=1e-13)


def test_a_quadrant_of_a_sphere_sends_the_path_over_the_allowed_side() -> None:
    """Also if an end is on either side: it then goes round by the allowed one."""
    below, either = (
        np.array([[-0.1, -0.02, 0.01], [0.12, -0.015, 0.01]]),
        np.array([[-0.1, -0.03, 0.0], [0.1, 0.02, 0]]),
    )
    above = below * [1.0, -1.0, 1.0]
    for side, line, is_far in (
        ("+y", above, 0),
        ("-y", below, 0),
        ("+y", below, 1),
        ("-y", either, 0),
        ("+y", either, 1),
    ):
        opening = _opening(line[None])
        expected = _tangents_and_arc(line[None], 2 * np.pi - opening if is_far else opening)
        assert _length(sphere(SPHERE_RADIUS, side), *line) == pytest.approx(expected[0], rel=1e-12), (side, line)


def test_of_several_pieces_the_one_with_the_shortest_detour_is_wrapped() -> None:
    far, near, mid = [-0.2, 0.049, 0.0], [-0.2, 0.0, 0.01], [0.2, 0.049, 0.0]
    line = np.array([[far, mid, [0.3, 0.0, 0.01], near]])
    pieces = np.array([[far, mid], [[0.3, 0.0, 0.01], near]])
    detours = lengths_over([sphere(SPHERE_RADIUS)], pieces) - straight_lengths(pieces)
    assert detours[0] < detours[1]
    for course in (line, line[:, ::-1]):
        assert np.allclose(lengths_over([sphere(SPHERE_RADIUS)], course), straight_lengths(line) + detours[0])


@pytest.mark.parametrize("method", METHODS)
def test_an_ellipsoid_with_equal_semi_axes_is_a_sphere(method: Method) -> None:
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


def test_a_quadrant_of_an_ellipsoid_sends_the_path_over_the_allowed_side() -> None:
    a, b = RADII[0], RADII[1]
    line = np.array([[[2.0 * a, 0.1 * b, 0.0], [-2.0 * a, 0.1 * b, 0.0]]])
    for side, mirrored in (("+y", [1.0, 1.0]), ("-y", [1.0, -1.0])):
        expected = _over_ellipse(a, b, *(line[0, :, :2] * mirrored))
        assert lengths_over([ellipsoid(RADII, side)], line, "midpoint")[0] == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize("method", METHODS)
def test_over_an_ellipsoid_the_path_moves_with_its_ends(method: Method) -> None:
    start, end = np.array([-0.02, -0.15, 0.03]), np.array([0.015, 0.16, 0.0])
    drift = np.linspace(0.0, 0.06, 400)[:, None]
    lines = np.stack([start + drift * [0.0, 0.0, 1.0], end + drift * [1.0, 0.0, 0.0]], axis=1)
    lengths = lengths_over([ellipsoid(RADII)], lines, method)
    assert (lengths >= straight_lengths(lines)).all()
    assert (lengths > straight_lengths(lines) + 1e-4).sum() > 50
    assert np.abs(np.diff(lengths)).max() < 1e-3


def test_an_end_on_an_ellipsoid_is_its_own_tangent_point() -> None:
    lines = [[[height * RADII[0], 0.0, 0.0], [-0.1, 0.01, 0.0]] for height in (1.0 + 1e-6, 1.0 + 1e-4)]
    on_it, off_it = lengths_over([ellipsoid(RADII)], lines)
    assert on_it == pytest.approx(off_it, abs=2e-5)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_path_through_the_hole_of_a_torus_wraps_round_the_inside_of_the_tube(angle: float) -> None:
    outside, height = 0.015, 0.2
    distance = np.hypot(outside, height)
    arc = 2 * (np.arctan2(outside, height) + np.arcsin(TUBE / distance))
    taut = 2 * np.sqrt(distance**2 - TUBE**2) + TUBE * arc
    line = at_angle(angle, RING + outside, height), at_angle(angle, RING + outside, -height)
    assert _length(TUBES["all"], *line) == pytest.approx(taut, abs=1e-9)
