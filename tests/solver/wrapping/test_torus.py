"""A path over a torus against plane geometry: in a plane through its axis the tube is a circle."""

from __future__ import annotations

import numpy as np
import pytest

from solver.model import GROUND, Placement, WrapSurface
from tests.solver.wrapping.laid import lengths_over, straight_lengths

TUBE, RING = 0.02, 0.1
ANGLES = [0.0, 0.7, 2.5, 4.0]


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
