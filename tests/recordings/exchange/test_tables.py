from __future__ import annotations

import numpy as np
import pytest

from recordings.errors import RecordingCode
from recordings.exchange.tables import count_samples, require_rising, settle_times, without_origin
from tests.recordings.refusals import raises_refusal


@pytest.mark.parametrize(
    ("times", "code", "naming"),
    [
        ([0.0], RecordingCode.FOREIGN_TOO_SHORT, ""),
        ([0.0, float("nan"), 0.2], RecordingCode.FOREIGN_NOT_A_NUMBER, "line 8"),
        ([0.0, 0.1, 0.1], RecordingCode.FOREIGN_TIME_NOT_RISING, "line 9"),
        ([0.0, 0.2, 0.1], RecordingCode.FOREIGN_TIME_NOT_RISING, "line 9"),
    ],
)
def test_times_that_do_not_rise_are_refused_with_their_line(
    times: list[float], code: RecordingCode, naming: str
) -> None:
    with raises_refusal(code, naming):
        require_rising(np.array(times), "daq.csv, time_s,", 7)


def test_samples_are_counted_from_their_times_and_a_gap_is_a_jump() -> None:
    times = np.delete(np.arange(1000) / 400, slice(300, 317))
    numbers, rate = count_samples(times)
    assert rate == pytest.approx(400)
    assert list(np.flatnonzero(np.diff(numbers) != 1)) == [299]
    assert numbers[300] == 317


def test_times_rounded_to_milliseconds_are_still_counted_one_by_one() -> None:
    numbers, rate = count_samples(np.round(np.arange(4000) / 400, 3))
    assert np.all(np.diff(numbers) == 1)
    assert rate == pytest.approx(400, rel=1e-3)


def test_a_jittering_clock_loses_no_sample() -> None:
    times = np.arange(600) / 20 + 0.01 * np.random.default_rng(1).uniform(-1, 1, 600)
    numbers, rate = count_samples(times)
    assert np.all(np.diff(numbers) == 1)
    assert rate == pytest.approx(20, rel=1e-2)


def test_exact_zeros_and_half_a_position_are_missing_markers() -> None:
    positions = np.array([[[0.0, 0.0, 0.0], [0.0, 1.0, 2.0], [np.nan, 1.0, 2.0]]])
    assert np.isnan(without_origin(positions)).all(axis=2).tolist() == [[True, False, True]]


def test_a_frame_without_time_is_placed_by_its_number() -> None:
    assert settle_times(np.array([101.0, 102.0, 104.0]), None, 100.0, "f", 1)[1] == pytest.approx([1.0, 1.01, 1.03])


def test_a_rate_and_times_that_contradict_each_other_are_refused() -> None:
    with raises_refusal(RecordingCode.FOREIGN_CONTRADICTORY, "200"):
        settle_times(np.arange(1.0, 9.0), np.arange(8) / 200, 100.0, "f", 1)
    with raises_refusal(RecordingCode.FOREIGN_NO_RATE):
        settle_times(np.arange(1.0, 9.0), None, 0.0, "f", 1)
