"""A path over several surfaces: one after the other, until the length settles."""

from __future__ import annotations

import numpy as np
import pytest

from tests.solver.wrapping.laid import cylinder, ellipsoid, lengths_over, sphere, straight_lengths

LINE = np.array([[[-0.3, 0.001, 0.0], [0.3, 0.001, 0.0]]])


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
