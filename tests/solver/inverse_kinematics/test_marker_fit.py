"""The turn from a laboratory's frame to the model's, for a person who faces any direction.

Gaps of a trial: short ones are bridged, long ones end the motion.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.bundled import Array, bundled_model
from solver.errors import SolverCode
from solver.inverse_kinematics.marker_fit import (
    TO_Y_UP,
    Exchange,
    find_exchanges,
    longest_whole_motion,
    rotation_laboratory_to_ground,
)
from solver.inverse_kinematics.solve import InverseKinematics, PostureOutcome
from tests.refusals import raises_refusal
from tests.solver.inverse_kinematics.marked import tasks_of, with_markers
from tests.solver.inverse_kinematics.test_solve import noisy

MODEL = with_markers(bundled_model())
MARKERS = tasks_of(MODEL).markers
BUNDLED = bundled_model()
TIME = np.arange(400) / 100.0
TRUTH = np.sin(TIME)[:, None] * np.ones(len(BUNDLED.coordinates))
RATE = 100.0


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


@pytest.mark.parametrize(
    ("hidden", "start", "interpolated", "left_out"),
    [([slice(100, 125)], 0, 25, 0), ([slice(0, 3), slice(100, 126), slice(380, 400)], 126, 0, 146)],
    ids=["25 frames", "3, 26 and 20 frames"],
)
def test_a_gap_of_a_quarter_of_a_second_is_interpolated_and_the_longest_part_between_longer_ones_is_kept(
    hidden: list[slice], start: int, interpolated: int, left_out: int
) -> None:
    whole = longest_whole_motion(BUNDLED, TIME, solution(*hidden))
    assert (whole.start, whole.interpolated, whole.left_out) == (start, interpolated, left_out)
    kept = slice(start, start + len(TIME) - left_out)
    np.testing.assert_array_equal(whole.motion.time, TIME[kept])
    np.testing.assert_allclose(whole.motion.coordinates, TRUTH[kept], atol=5e-3)


def test_a_trial_with_hardly_any_posture_is_refused() -> None:
    for hidden in (slice(50, 400), slice(0, 400)):
        with raises_refusal(SolverCode.NOT_COVERED):
            longest_whole_motion(BUNDLED, TIME, solution(hidden))


# Exchanged labels are found from trajectories alone, whichever they are and whatever is hidden.


def moving(frames: int = 200, markers: int = 8, seed: int = 1) -> Array:
    """Markers decimetres apart that move together at up to 1.5 m/s, with 0.5 mm of noise."""
    chance = np.random.default_rng(seed)
    time = np.arange(frames) / RATE
    path = 0.3 * np.sin(2 * np.pi * 0.8 * time)[:, None] * np.array([1.0, 0.5, 0.2])
    places = chance.uniform(-0.25, 0.25, (markers, 3))
    return path[:, None] + places + 5e-4 * chance.standard_normal((frames, markers, 3))


def exchanged(observed: Array, one: int, other: int, start: int, stop: int) -> Array:
    changed = observed.copy()
    changed[start:stop, [one, other]] = observed[start:stop, [other, one]]
    return changed


def test_a_gap_or_a_marker_that_jumps_away_is_no_exchange() -> None:
    for hidden, away in ((np.nan, 0.0), (0.0, np.array([0.1, 0.0, 0.1]))):
        observed = moving()
        observed[50:80, 2] += hidden
        observed[60:80, 3] += away
        assert find_exchanges(observed) == ()


@pytest.mark.parametrize(
    ("pair", "start", "stop"),
    [((0, 1), 60, 80), ((2, 7), 60, 80), ((3, 5), 60, 80), ((1, 2), 150, 200), ((1, 2), 0, 50)],
    ids=str,
)
def test_an_exchange_is_found_with_its_frames_and_labels_are_right_in_the_longer_part(
    pair: tuple[int, int], start: int, stop: int
) -> None:
    assert find_exchanges(exchanged(moving(), *pair, start, stop)) == (Exchange(pair, start, stop),)


def test_an_exchange_is_found_across_a_gap_and_beside_another() -> None:
    observed = exchanged(exchanged(moving(), 0, 1, 60, 80), 4, 6, 70, 90)
    observed[58:60, 0] = np.nan
    assert find_exchanges(observed) == (Exchange((0, 1), 60, 80), Exchange((4, 6), 70, 90))
