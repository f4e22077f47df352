"""Gaps of a trial: short ones are bridged, long ones end the motion."""

from __future__ import annotations

import numpy as np

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.inverse_kinematics.gaps import longest_whole_motion
from solver.inverse_kinematics.solve import InverseKinematics, PostureOutcome
from tests.solver.refusals import raises_refusal

MODEL = bundled_model()
TIME = np.arange(400) / 100.0
TRUTH = np.sin(TIME)[:, None] * np.ones(len(MODEL.coordinates))


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
    whole = longest_whole_motion(MODEL, TIME, solution(slice(100, 125)))
    assert (whole.start, whole.interpolated, whole.left_out) == (0, 25, 0)
    np.testing.assert_allclose(whole.motion.coordinates, TRUTH, atol=5e-3)


def test_the_longest_part_between_longer_gaps_is_kept() -> None:
    whole = longest_whole_motion(MODEL, TIME, solution(slice(0, 3), slice(100, 126), slice(380, 400)))
    assert (whole.start, whole.interpolated, whole.left_out) == (126, 0, 146)
    np.testing.assert_array_equal(whole.motion.time, TIME[126:380])


def test_a_trial_with_hardly_any_posture_is_refused() -> None:
    for hidden in (slice(50, 400), slice(0, 400)):
        with raises_refusal(SolverCode.NOT_COVERED):
            longest_whole_motion(MODEL, TIME, solution(hidden))
