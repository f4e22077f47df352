"""Postures for the picture of the body: three elevations of the arm, with the lines of model and suit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.motion import differentiate
from solver.multibody.postures import points_in_ground, postures
from solver.raise_arm import simulate_arm_raise
from solver.suit.suit import read_suit
from station.assessment.drawn_postures import PostureEntry, plain_postures

MODEL, SUIT = bundled_model(), read_suit()
MOTION = differentiate(simulate_arm_raise(MODEL))


@pytest.fixture(scope="module")
def drawn() -> list[dict[str, Any]]:
    return plain_postures(MODEL, MOTION, SUIT, MOTION.time[::20])


def test_the_arm_is_at_its_lowest_in_the_middle_and_at_its_highest(drawn: list[dict[str, Any]]) -> None:
    elevations = [posture["elevation_deg"]["value"] for posture in drawn]
    state = postures(MODEL, MOTION.positions[::20], MOTION.speeds[::20])
    of = {marker.name: marker for marker in MODEL.markers}
    epicondyles = np.mean(
        [points_in_ground(state, of[name].body, of[name].location) for name in ("EpL", "EpM")], axis=0
    )
    along = epicondyles - state.origin_in_ground[:, MODEL.body_index("humerus")]
    by_markers = np.degrees(np.arccos(-along[:, 1] / np.linalg.norm(along, axis=1)))
    middle = (by_markers.min() + by_markers.max()) / 2
    assert elevations == pytest.approx([by_markers.min(), middle, by_markers.max()], abs=4.0)
    assert elevations == sorted(elevations)


def test_lines_are_those_of_the_model_and_the_suit_at_that_time(drawn: list[dict[str, Any]]) -> None:
    for posture in drawn:
        PostureEntry.model_validate(posture)
        frame = int(np.argmin(np.abs(MOTION.time - posture["time_s"]["value"])))
        state = postures(MODEL, MOTION.positions[[frame]], MOTION.speeds[[frame]])
        for muscle in MODEL.muscles:
            line = np.array(posture["muscles_m"][muscle.name]["value"])
            for end, point in ((line[0], muscle.path.points[0]), (line[-1], muscle.path.points[-1])):
                np.testing.assert_allclose(end, points_in_ground(state, point.body, point.location)[0], atol=6e-4)
        arm = points_in_ground(state, MODEL.body_index(SUIT.arm.body), SUIT.arm.location)[0]
        np.testing.assert_allclose(posture["cord_m"]["value"][-1], arm, atol=6e-4)
        ring = np.array(posture["cuffs_m"]["arm"]["value"])
        assert np.linalg.norm(ring - arm, axis=1).min() < 0.01, "the cord ends on the cuff"
