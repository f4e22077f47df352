"""The turn from a laboratory's frame to the model's, for a person who faces any direction.

Gaps of a trial: short ones are bridged, long ones end the motion.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.inverse_kinematics.marker_fit import TO_Y_UP, longest_whole_motion, rotation_laboratory_to_ground
from solver.inverse_kinematics.solve import InverseKinematics, PostureOutcome
from tests.solver.inverse_kinematics.marked import tasks_of, with_markers
from tests.solver.inverse_kinematics.test_solve import noisy
from tests.solver.refusals import raises_refusal

MODEL = with_markers(bundled_model())
MARKERS = tasks_of(MODEL).markers
BUNDLED = bundled_model()
TIME = np.arange(400) / 100.0
TRUTH = np.sin(TIME)[:, None] * np.ones(len(BUNDLED.coordinates))


@pytest.mark.parametrize("vertical", ["x", "y", "z"])
@pytest.mark.parametrize("facing_deg", [0.0, 90.0, 200.0])
def test_up_is_up_and_the_person_faces_as_the_model(vertical: str, facing_deg: float) -> None:
    expected = noisy(MODEL, 1, 0.0)[1]
    spread = expected - expected.mean(axis=1, keepdims=True)
    turn = Rotation.from_euler("y", facing_deg, degrees=True).as_matrix()
    laboratory = spread @ turn.T @ TO_Y_UP[vertical] + 3.0  # rows: the inverse of TO_Y_UP is its transpose
    rotation = rotation_laboratory_to_ground(MODEL, MARKERS, laboratory, vertical)
    up = np.zeros(3)
    up["xyz".index(vertical)] = 1.0
    np.testing.assert_allclose(rotation @ up, [0.0, 1.0, 0.0], atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    back = laboratory @ rotation.T
    np.testing.assert_allclose(back - back.mean(axis=1, keepdims=True), spread, atol=0.1)  # another posture


def test_two_markers_are_too_few() -> None:
    observed = noisy(MODEL, 1, 0.0)[1]
    observed[:, 2:] = np.nan
    with raises_refusal(SolverCode.TOO_FEW_MARKERS, naming="found 2"):
        rotation_laboratory_to_ground(MODEL, MARKERS, observed)


def solution(*hidden: slice) -> InverseKinematics:
    """The truth, without a posture in these frames."""
    found, outcomes = TRUTH.copy(), np.full(len(TIME), PostureOutcome.SOLVED, dtype=object)
    for part in hidden:
        found[part], outcomes[part] = np.nan, PostureOutcome.NO_MARKERS
    nothing = np.zeros(len(TIME))
    return InverseKinematics(
        found, np.zeros((len(TIME), 0)), nothing, nothing, np.zeros((len(TIME), 0)), tuple(outcomes), np.zeros(1, int)
    )


def test_a_gap_of_a_quarter_of_a_second_is_interpolated() -> None:
    whole = longest_whole_motion(BUNDLED, TIME, solution(slice(100, 125)))
    assert (whole.start, whole.interpolated, whole.left_out) == (0, 25, 0)
    np.testing.assert_allclose(whole.motion.coordinates, TRUTH, atol=5e-3)


def test_the_longest_part_between_longer_gaps_is_kept() -> None:
    whole = longest_whole_motion(BUNDLED, TIME, solution(slice(0, 3), slice(100, 126), slice(380, 400)))
    assert (whole.start, whole.interpolated, whole.left_out) == (126, 0, 146)
    np.testing.assert_array_equal(whole.motion.time, TIME[126:380])


def test_a_trial_with_hardly_any_posture_is_refused() -> None:
    for hidden in (slice(50, 400), slice(0, 400)):
        with raises_refusal(SolverCode.NOT_COVERED):
            longest_whole_motion(BUNDLED, TIME, solution(hidden))
