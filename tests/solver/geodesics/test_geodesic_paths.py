"""Paths over points and pulled taut over surfaces: forces and speeds are derivatives of lengths, and nothing jumps."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import ellipe, ellipeinc

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.model import (
    GROUND,
    Array,
    ConditionalPathPoint,
    Model,
    MovingPathPoint,
    Path,
    PathWrap,
    Placement,
    WrapSurface,
)
from solver.motion import decimate, differentiate, read_motion
from solver.multibody.postures import Postures, jacobians, postures, rates_of_coordinates, speeds_from_rates
from solver.muscle import PathMode, PathState, evaluate_paths, muscle_forces
from solver.osim.model_reader import read_osim
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import LoadedMotion, solve_motion
from solver.suit.scenarios import prepare_suited_motion
from solver.suit.suit import BUNDLED_SUIT, read_suit
from tests.refusals import raises_refusal
from tests.solver.references import NO_WEIGHT, SHARED, TWO_KILOGRAM_WEIGHT
from tests.solver.wrapping.laid import (
    at_angle,
    cylinder,
    ellipsoid,
    lengths_over,
    lines_through,
    point,
    sphere,
    straight_lengths,
    unrolled,
)

MODEL = bundled_model()
RANDOM = np.random.default_rng(3)
STEP = 1e-6
RADIUS = 0.04
RADII = np.array([0.03, 0.05, 0.04])
POINTS_RANDOM = np.random.default_rng(8)
NEAR_CENTRE = [  # semi-axes, start, end: heights over the line mislead
    ((0.07244, 0.07625, 0.0507), (0.03401, -0.07531, -0.14828), (-0.01564, 0.03491, 0.0564)),
    ((0.04174, 0.03639, 0.0784), (0.00396, -0.01951, -0.07595), (-0.0052, 0.03639, 0.09891)),
    ((0.03958, 0.05508, 0.07851), (-0.1061, -0.03239, 0.20249), (0.02458, 0.0083, -0.06795)),
    ((0.07614, 0.03894, 0.05254), (-0.09749, 0.12885, 0.05673), (0.06286, -0.0379, -0.01399)),
]


MODES = pytest.mark.parametrize("mode", ["opensim", "geodesic"])
HAND, THORAX, HUMERUS = (MODEL.body_index(name) for name in ("hand", "thorax", "humerus"))
ELEVATION = MODEL.coordinate_index("shoulder_elv")
ON_THORAX = point(THORAX, (0.0, 0.3, 0.0)), point(THORAX, (0.2, 0.0, 0.1))
LINES = (polynomial([0.0, 0.02]), polynomial([0.1, -0.03, 0.02]), polynomial([0.0, 0.01]))
MOVER = MovingPathPoint(THORAX, Placement(np.eye(3), np.zeros(3)), ELEVATION, LINES, (-0.5, 1.0))
CORD = Path((point(GROUND, (0.1, 0.2, 0.3)), point(THORAX, (0.0, -0.1, 0.2)), point(HAND, (0.0, -0.05, 0.0))), ())
WITHIN = Path((ON_THORAX[0], MOVER, ON_THORAX[1]), ())
TO_HUMERUS = Path((MOVER, point(HUMERUS, (0.0, -0.1, 0.0))), ())
BOUNDLESS = Path((replace(MOVER, range=(-9.0, 9.0)), *TO_HUMERUS.points[1:]), ())


def _lengths(model: Model, coordinates: Array, paths: list[Path] | None = None, mode: PathMode = "geodesic") -> Array:
    return evaluate_paths(model, postures(model, coordinates, np.zeros_like(coordinates)), paths, mode).lengths


def _length(surfaces: list[WrapSurface], *line: Array) -> float:
    return float(lengths_over(surfaces, [line], mode="geodesic")[0])


def _random_coordinates(model: Model, frames: int) -> Array:
    coordinates: Array = model.default_coordinates + 0.2 * RANDOM.normal(size=(frames, len(model.coordinates)))
    return coordinates


def _forces(model: Model, state: Postures, laid: PathState) -> Array:
    """(frames, paths, coordinates) generalised forces of a unit tension."""
    return np.einsum("fpbi,fbij->fpj", laid.wrench_per_tension, jacobians(model, state)) + laid.mobility_per_tension


def _mismatch(model: Model, coordinates: Array, paths: list[Path] | None = None, mode: PathMode = "geodesic") -> Array:
    """(frames, paths) max |Q + dL/dq|, Q being the generalised forces of a unit tension, by central differences."""
    state = postures(model, coordinates, np.zeros_like(coordinates))
    forces = _forces(model, state, evaluate_paths(model, state, paths, mode))
    slopes = np.empty_like(forces)
    for k, step in enumerate(STEP * np.eye(coordinates.shape[1])):
        ahead, back = (_lengths(model, coordinates + side, paths, mode) for side in (step, -step))
        slopes[..., k] = (ahead - back) / (2 * STEP)
    rates, _ = rates_of_coordinates(model, state)
    mismatch: Array = np.abs(forces + slopes @ rates).max(axis=-1)
    return mismatch


def test_forces_are_the_derivative_of_lengths_for_every_muscle() -> None:
    assert _mismatch(MODEL, _random_coordinates(MODEL, 40)).max() < 1e-8


@pytest.mark.shared
@pytest.mark.parametrize("file", [NO_WEIGHT, TWO_KILOGRAM_WEIGHT])
def test_forces_are_the_derivative_of_lengths_for_every_muscle_of_the_published_models(file) -> None:  # type: ignore[no-untyped-def]
    model = read_osim(file)
    assert _mismatch(model, _random_coordinates(model, 40)).max() < 1e-8


@pytest.mark.shared
@pytest.mark.parametrize("motion", ["FLX01", "ABD02", "SHRUG01"])
def test_forces_are_the_derivative_of_lengths_throughout_the_published_motions(motion: str) -> None:
    model = read_osim(NO_WEIGHT)
    moved = differentiate(read_motion(SHARED / "motions" / f"{motion}.mot", model)).positions
    assert _mismatch(model, moved[::25]).max() < 1e-8


@pytest.mark.parametrize(
    ("mode", "paths", "raised"),
    [
        ("geodesic", [CORD, WITHIN, TO_HUMERUS], (-0.7, 0.2, 0.8, 1.4)),
        ("opensim", [CORD, TO_HUMERUS], (-0.3, 0.2, 0.8, 0.9)),
    ],
)
def test_a_moving_point_pulls_at_its_coordinate_also_within_one_body_and_stops_at_the_end_of_its_range(
    mode: PathMode, paths: list[Path], raised: tuple[float, ...]
) -> None:
    """OpenSim's pulls at its coordinate only between two bodies, and also beyond its range."""
    coordinates = _random_coordinates(MODEL, 4)
    coordinates[:, ELEVATION] = raised
    assert _mismatch(MODEL, coordinates, paths, mode).max() < 1e-8
    coordinates = np.tile(coordinates[0], (4, 1))
    coordinates[:, ELEVATION] = -0.7, -0.5, 1.4, 1.0
    below, lowest, above, highest = _lengths(MODEL, coordinates, [WITHIN], mode)[:, 0]
    assert (below, above) == (lowest, highest)


def test_a_conditional_point_is_passed_only_within_its_range() -> None:
    start, end = point(THORAX, (0.0, 0.0, 0.0)), point(THORAX, (0.2, 0.0, 0.0))
    detour = ConditionalPathPoint(THORAX, np.array([0.1, 0.1, 0.0]), ELEVATION, (0.5, 1.0))
    raised = np.tile(MODEL.default_coordinates, (4, 1))
    raised[:, ELEVATION] = 0.4, 0.5 - 5e-6, 0.7, 1.1
    lengths = _lengths(MODEL, raised, [Path((start, detour, end), ())], "opensim")[:, 0]
    assert np.allclose(lengths, [0.2, 0.02**0.5 * 2, 0.02**0.5 * 2, 0.2], atol=1e-14)


@pytest.mark.parametrize(("mode", "paths"), [("geodesic", None), ("opensim", [CORD, BOUNDLESS])])
def test_speeds_are_the_work_of_the_forces(mode: PathMode, paths: list[Path] | None) -> None:
    coordinates = _random_coordinates(MODEL, 40)
    speeds = speeds_from_rates(MODEL, coordinates, RANDOM.normal(size=coordinates.shape))
    state = postures(MODEL, coordinates, speeds)
    laid = evaluate_paths(MODEL, state, paths, mode)
    work = np.einsum("fpj,fj->fp", _forces(MODEL, state, laid), speeds)
    assert np.allclose(laid.speeds, -work, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("mode", "tolerance"), [("geodesic", 1e-12), ("opensim", 1e-14)])
def test_a_path_pulls_the_bodies_together_in_equilibrium(mode: PathMode, tolerance: float) -> None:
    """Moments too: where the path runs over a surface it is in equilibrium with the surface's body, but in OpenSim."""
    coordinates = _random_coordinates(MODEL, 40)
    laid = evaluate_paths(MODEL, postures(MODEL, coordinates, np.zeros_like(coordinates)), mode=mode)
    total, straight = laid.wrench_per_tension.sum(axis=2), [not muscle.path.wraps for muscle in MODEL.muscles]
    assert np.abs(total[..., 3:]).max() < tolerance
    assert np.abs(total if mode == "geodesic" else total[:, straight]).max() < tolerance


def test_points_on_one_body_pull_on_nothing() -> None:
    within = Path((point(HAND, (0.0, 0.0, 0.0)), point(HAND, (0.1, 0.0, 0.0))), ())
    coordinates = _random_coordinates(MODEL, 8)
    state = evaluate_paths(MODEL, postures(MODEL, coordinates, RANDOM.normal(size=coordinates.shape)), [within])
    assert state.lengths == pytest.approx(0.1)
    assert not state.wrench_per_tension.any()
    assert np.abs(state.speeds).max() < 1e-15
    with pytest.raises(ValueError, match="read-only"):
        state.lengths[0, 0] = 0.0


def test_a_path_that_does_not_fit_the_model_is_refused() -> None:
    beginning, nowhere = point(GROUND, (0.0, 0.0, 0.0)), point(99, (0.0, 0.0, 0.0))
    state = postures(MODEL, MODEL.default_coordinates[None], np.zeros((1, len(MODEL.coordinates))))
    for path, naming in (
        (Path((beginning,), ()), "1 point"),
        (Path((beginning, nowhere), ()), "body 99"),
        (Path((beginning, replace(MOVER, coordinate=99)), ()), "coordinate 99"),
        (Path((beginning, beginning), (PathWrap(99, "hybrid"),)), "surface 99"),
    ):
        with raises_refusal(SolverCode.WRONG_PATH, naming):
            evaluate_paths(MODEL, state, [path])
    torus = replace(MODEL.surfaces[0], kind="torus", dimensions=np.array([0.01, 0.05, 0.0]))
    model, path = replace(MODEL, surfaces=(torus, *MODEL.surfaces[1:])), replace(CORD, wraps=(PathWrap(0, "hybrid"),))
    assert np.isfinite(evaluate_paths(model, state, [path]).lengths).all()
    with raises_refusal(SolverCode.UNSUPPORTED):
        evaluate_paths(model, state, [path], mode="geodesic")


def test_raising_the_arm_in_tiny_steps_no_length_jumps_and_no_moment_arm_either() -> None:
    """Every length changes by what its slopes at both ends say, to the third order, through each touch and lift-off."""
    kinematics = differentiate(simulate_arm_raise(MODEL))
    nodes = kinematics.positions[:: max(len(kinematics.positions) // 12, 1)]
    sweep = np.concatenate([np.linspace(a, b, 100, endpoint=False) for a, b in pairwise(nodes)])
    steps = np.diff(sweep, axis=0)
    before, behind = (
        evaluate_paths(MODEL, postures(MODEL, part, speeds_from_rates(MODEL, part, steps)), mode="geodesic")
        for part in (sweep[:-1], sweep[1:])
    )
    change = behind.lengths - before.lengths
    straight = evaluate_paths(MODEL, postures(MODEL, sweep, np.zeros_like(sweep)), _without_surfaces(MODEL)).lengths
    touches = np.diff(_lengths(MODEL, sweep) > straight + 1e-12, axis=0).sum()
    assert touches >= 5
    assert np.abs(change - (before.speeds + behind.speeds) / 2).max() < 1e-7


@MODES
def test_frames_are_independent_and_other_paths_may_be_evaluated(mode: PathMode) -> None:
    coordinates = _random_coordinates(MODEL, 6)
    forwards, order = _lengths(MODEL, coordinates, mode=mode), RANDOM.permutation(6)
    assert np.array_equal(forwards[order], _lengths(MODEL, coordinates[order], mode=mode))
    single = [_lengths(MODEL, frame[None], mode=mode) for frame in coordinates]
    assert np.array_equal(forwards, np.concatenate(single))
    infraspinatus = MODEL.muscle_names.index("Infraspinatus_I")
    one = _lengths(MODEL, coordinates, [MODEL.muscles[infraspinatus].path], mode)
    assert np.array_equal(one[:, 0], forwards[:, infraspinatus])
    assert _lengths(MODEL, coordinates, [], mode).shape == (6, 0)
    assert _lengths(MODEL, coordinates[:0], mode=mode).shape == (0, len(MODEL.muscles))


def test_it_lays_most_paths_as_opensim_does() -> None:
    """But for paths over two surfaces, where OpenSim mixes two iterations, by millimetres (docs/paths.md)."""
    moved = differentiate(simulate_arm_raise(MODEL)).positions[::20]
    opensim_paths = evaluate_paths(MODEL, postures(MODEL, moved, np.zeros_like(moved))).lengths
    one_surface = [k for k, muscle in enumerate(MODEL.muscles) if len(muscle.path.wraps) < 2]
    difference = np.abs(_lengths(MODEL, moved) - opensim_paths)
    assert difference[:, one_surface].max() < 2e-3
    assert np.median(difference) < 1e-6


def test_the_redundancy_problem_is_posed_on_the_paths_that_are_asked_for() -> None:
    kinematics = decimate(differentiate(simulate_arm_raise(MODEL)), 150)
    lengths = _lengths(MODEL, kinematics.positions)
    state = postures(MODEL, kinematics.positions, kinematics.speeds)
    passive = muscle_forces(MODEL, lengths, evaluate_paths(MODEL, state, mode="geodesic").speeds).passive
    solved = solve_motion(MODEL, kinematics, RedundancyOptions(path_mode="geodesic"))
    assert np.array_equal(solved.passive_forces, passive)
    assert solved.unsolved == 0
    suit = read_suit(BUNDLED_SUIT)
    geodesic, opensim_paths = (
        prepare_suited_motion(LoadedMotion(MODEL, kinematics, options=RedundancyOptions(path_mode=mode)), suit)
        for mode in ("geodesic", "opensim")
    )
    bare = evaluate_motion(MODEL, kinematics, path_mode="geodesic")
    assert np.array_equal(geodesic.bare_problem.matrix, bare.maps(MODEL).acceleration_per_control)
    assert not np.array_equal(geodesic.problem.matrix, opensim_paths.problem.matrix)


def _without_surfaces(model: Model) -> list[Path]:
    return [Path(muscle.path.points, ()) for muscle in model.muscles]


# Paths pulled taut over one surface or two, against what geometry says of them.


def _over_sphere(lines: Array) -> Array:
    """Two tangents and an arc of a great circle, where the straight line would pierce the sphere."""
    start, end = lines[:, 0], lines[:, 1]
    away = np.linalg.norm(lines, axis=-1)
    arc = np.arccos(np.sum(start * end, axis=1) / away.prod(axis=1)) - np.arccos(RADIUS / away).sum(axis=1)
    laid: Array = np.sqrt(away**2 - RADIUS**2).sum(axis=1) + RADIUS * arc
    return np.where(arc > 0, laid, straight_lengths(lines))


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
    start, end = at_angle(0.1, 0.06, -0.2 * rise), at_angle(2.8, 0.09, 0.8 * rise)
    assert _length([cylinder(RADIUS, 1.0)], start, end) == pytest.approx(unrolled(RADIUS, start, end, 2.7), abs=1e-15)


def test_a_cylinder_s_quadrant_sends_it_round_by_the_allowed_side() -> None:
    start, end = at_angle(-1.7, 0.09, 0.0), at_angle(1.8, 0.08, 0.02)
    allowed, forbidden = (_length([cylinder(RADIUS, 1.0, quadrant)], start, end) for quadrant in ("+x", "-x"))
    assert allowed == pytest.approx(unrolled(RADIUS, start, end, 3.5), abs=1e-15)
    assert forbidden == pytest.approx(unrolled(RADIUS, start, end, 2 * np.pi - 3.5), abs=1e-15)


@pytest.mark.parametrize("surface", [sphere, lambda radius, quadrant: ellipsoid([radius] * 3, quadrant)])
def test_a_sphere_s_quadrant_sends_it_round_by_the_allowed_side(surface) -> None:  # type: ignore[no-untyped-def]
    start, end = np.array([-0.09, 0.01, 0.0]), np.array([0.08, -0.001, 0.0])
    opening = np.arccos(start @ end / np.linalg.norm(start) / np.linalg.norm(end))
    assert _length([surface(RADIUS, "+y")], start, end) == pytest.approx(
        unrolled(RADIUS, start, end, opening), abs=1e-12
    )
    long_way = unrolled(RADIUS, start, end, 2 * np.pi - opening)
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
    points = POINTS_RANDOM.normal(size=(300, 3))
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
    start, end = at_angle(0.2, 0.09, 0.0), at_angle(2.9, 0.07, 0.03)
    assert _length([cylinder(RADIUS, 1.0, "-z")], start, end) == _length([cylinder(RADIUS, 1.0)], start, end)


@pytest.mark.parametrize("surface", [sphere(RADIUS), cylinder(RADIUS, 1.0), ellipsoid(RADII)])
def test_a_place_that_is_not_a_number_gives_none(surface: WrapSurface) -> None:
    assert np.isnan(lengths_over([surface], [[(np.nan, 0.0, 0.0), (0.1, 0.0, 0.0)]], mode="geodesic")).all()


def test_every_segment_of_a_path_wraps_over_a_surface_that_it_intersects() -> None:
    left, middle, right = (-0.1, 0.0, 0.0), (0.0, 0.042, 0.0), (0.1, 0.0, 0.0)
    pieces = lengths_over([sphere(RADIUS)], [[left, middle], [middle, right]], mode="geodesic")
    assert (pieces > straight_lengths([[left, middle], [middle, right]])).all()
    assert lengths_over([sphere(RADIUS)], [[left, middle, right]], mode="geodesic")[0] == pytest.approx(pieces.sum())
