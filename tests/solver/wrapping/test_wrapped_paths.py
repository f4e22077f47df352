"""A path over several surfaces, one after the other, and against OpenSim."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solver.model import Array, WrapSurface
from tests.solver.wrapping.laid import METHODS, Method, cylinder, ellipsoid, lengths_over, sphere, straight_lengths

LINE = np.array([[[-0.3, 0.001, 0.0], [0.3, 0.001, 0.0]]])
opensim: Any = pytest.importorskip("opensim", reason="needs OpenSim: pip install cuffstation[oracle]")
add_surface = pytest.importorskip("tests.solver.certify").add_surface
QUADRANTS = ("all", "+x", "-x", "+y", "-y", "+z", "-z")
PATHS_IN_A_MODEL = 12
SMALL, ROUND = sphere(0.05, centre=(0.04, 0.03, 0.02)), ellipsoid((0.05, 0.06, 0.07), centre=(0.04, 0.03, 0.02))


def test_two_spheres_far_apart_add_their_detours_to_a_millimetre() -> None:
    """No better: OpenSim stops when a sweep changes the length by less than half a millimetre."""
    left, right = sphere(0.02, centre=(-0.15, 0.0, 0.0)), sphere(0.02, centre=(0.15, 0.0, 0.0))
    middle = np.array([[[-0.3, 0.001, 0.0], [0.0, 0.02, 0.0], [0.3, 0.001, 0.0]]])
    over_both = lengths_over([left, right], LINE)
    by_hand = 2 * lengths_over([left], middle[:, :2])
    assert np.allclose(over_both, by_hand, atol=1e-3)
    assert over_both[0] > straight_lengths(LINE)[0] + 1e-3


def test_the_order_of_two_separate_surfaces_matters_only_by_what_is_left_unsettled() -> None:
    left, right = cylinder(0.02, 0.1, centre=(-0.1, 0.0, 0.0)), ellipsoid((0.02, 0.03, 0.02), centre=(0.1, 0.0, 0.0))
    assert lengths_over([left, right], LINE)[0] == pytest.approx(lengths_over([right, left], LINE)[0], abs=5e-4)


def test_a_path_does_not_wrap_over_a_surface_between_the_tangent_points_of_another() -> None:
    """The small sphere lies within the large one: the piece over the large one is left alone."""
    large, small = sphere(0.05), sphere(0.01)
    assert lengths_over([large, small], LINE)[0] == lengths_over([large], LINE)[0]


def test_a_second_surface_around_an_end_swaps_the_order_and_leaves_the_path_straight() -> None:
    missed, around_an_end = sphere(0.01, centre=(0.0, 0.2, 0.0)), sphere(0.05, centre=(0.3, 0.0, 0.0))
    assert lengths_over([missed, around_an_end], LINE)[0] == pytest.approx(straight_lengths(LINE)[0], abs=1e-15)


def test_a_path_point_between_surfaces_bends_the_path() -> None:
    via = np.array([[[-0.3, 0.001, 0.0], [0.0, 0.08, 0.0], [0.3, 0.001, 0.0]]])
    assert lengths_over([sphere(0.05)], via)[0] == straight_lengths(via)[0]


@pytest.fixture(autouse=True)
def _quiet(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(str(tmp_path))
    opensim.Logger.setLevelString("off")


@pytest.mark.parametrize("quadrant", QUADRANTS)
@pytest.mark.parametrize("method", METHODS)
def test_ellipsoid(quadrant: str, method: Method) -> None:
    _assert_same([ellipsoid((0.05, 0.09, 0.06), quadrant)], _random_lines(ends=2), method)


@pytest.mark.parametrize("quadrant", QUADRANTS)
def test_sphere(quadrant: str) -> None:
    _assert_same([sphere(0.06, quadrant)], _random_lines(ends=3))


@pytest.mark.parametrize(
    "quadrant", [*QUADRANTS[:2], *(pytest.param(quadrant, marks=pytest.mark.slow) for quadrant in QUADRANTS[2:5])]
)
@pytest.mark.parametrize("others", [[], [SMALL], [ROUND], [cylinder(0.03, 0.3, centre=(0.04, 0.03, 0.02))]])
def test_cylinder_alone_and_with_others(quadrant: str, others: list[WrapSurface]) -> None:
    _assert_same([cylinder(0.04, 0.2, quadrant), *others], _random_lines(ends=3))
    _assert_same([*others, cylinder(0.04, 0.2, quadrant)], _random_lines(ends=2))


def test_paths_in_a_coordinate_plane() -> None:
    for surface in (ellipsoid((0.05, 0.09, 0.06)), sphere(0.06), cylinder(0.04, 0.2), cylinder(0.04, 0.2, "-y")):
        for axis in range(3):
            lines = _random_lines(ends=3)
            lines[..., axis] = 0.0
            _assert_same([surface], lines)


def _random_lines(ends: int) -> Array:
    return np.random.default_rng(ends).uniform(-0.15, 0.15, (120, ends, 3))


def _assert_same(surfaces: Sequence[WrapSurface], lines: Array, method: Method = "hybrid") -> None:
    ours, theirs = lengths_over(surfaces, lines, method), _lengths_in_opensim(surfaces, lines, method)
    assert (theirs > straight_lengths(lines) + 1e-6).sum() > 10
    assert np.allclose(ours, theirs, rtol=1e-9, atol=1e-12, equal_nan=True)


def _lengths_in_opensim(surfaces: Sequence[WrapSurface], lines: Array, method: Method) -> Array:
    """In several models: OpenSim's addForce goes through all components of the model again."""
    parts = np.split(lines, range(PATHS_IN_A_MODEL, len(lines), PATHS_IN_A_MODEL))
    return np.concatenate([_lengths_in_one_model(surfaces, part, method) for part in parts])


def _lengths_in_one_model(surfaces: Sequence[WrapSurface], lines: Array, method: Method) -> Array:
    model = opensim.Model()
    ground = model.getGround()
    objects = [add_surface(ground, replace(surface, name=f"surface_{k}")) for k, surface in enumerate(surfaces)]
    for k, line in enumerate(lines):
        spring = opensim.PathSpring(f"path_{k}", 0.1, 1.0, 0.1)
        path = spring.updGeometryPath()
        for end, place in enumerate(line):
            path.appendNewPathPoint(f"path_{k}_{end}", ground, opensim.Vec3(*place))
        for j, wrap_object in enumerate(objects):
            path.addPathWrap(wrap_object)
            path.updWrapSet().get(j).setMethod(METHODS.index(method))
        model.addForce(spring)
    state = model.initSystem()
    model.realizePosition(state)
    springs = (opensim.PathSpring.safeDownCast(model.getForceSet().get(k)) for k in range(len(lines)))
    return np.array([spring.getLength(state) for spring in springs])
