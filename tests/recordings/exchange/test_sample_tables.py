""""""

from __future__ import annotations

import numpy as np
import pytest

from recordings.errors import RecordingCode
from recordings.exchange.sample_tables import MarkerTable, count_samples, require_rising, settle_times, without_origin
from tests.refusals import raises_refusal


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


def test_exact_zeros_half_a_position_and_one_in_space_are_missing_markers() -> None:
    positions = np.array([[[0.0, 0.0, 0.0], [0.0, 1.0, 2.0], [np.nan, 1.0, 2.0], [1.0, -1e300, 2.0]]])
    assert np.isnan(without_origin(positions)).all(axis=2).tolist() == [[True, False, True, True]]


def test_a_frame_without_time_is_placed_by_its_number() -> None:
    assert settle_times(np.array([101.0, 102.0, 104.0]), None, 100.0, "f", 1)[1] == pytest.approx([1.0, 1.01, 1.03])


@pytest.mark.parametrize(
    ("nominal", "decimals"), [(29.97, 5), (29.97, 3), (23.976, 6), (59.94, 4), (120.12, 9), (50.0, 2), (200.0, 3)]
)
def test_the_times_decide_where_the_stated_rate_is_not_theirs(nominal: float, decimals: int) -> None:
    times = np.round(np.arange(600) / nominal, decimals)
    rate, time, notes = settle_times(np.arange(1.0, 601.0), times, np.rint(2 * nominal) / 2 + 0.5, "f", 1)
    table = MarkerTable(("a",), rate, time, np.ones((600, 1, 3)), np.zeros((600, 1)))
    assert rate == pytest.approx(nominal, abs=nominal * 2 * 10.0**-decimals / times[-1])
    assert len(notes) == 1
    assert np.array_equal(table.frame_numbers, np.arange(1, 601))


@pytest.mark.parametrize(("rate", "decimals"), [(100.0, 3), (30.0, 2), (29.97, 3), (120.0, 5), (1 / 3, 1)])
def test_the_stated_rate_is_kept_where_the_times_are_rounded_to_their_last_digit(rate: float, decimals: int) -> None:
    times = np.round(7.3 + np.arange(700) / rate, decimals)
    assert settle_times(np.arange(700.0), times, rate, "f", 1)[::2] == (rate, ())


def test_frames_that_are_not_in_the_file_leave_a_gap_in_the_numbers() -> None:
    kept = np.delete(np.arange(600), slice(200, 217))
    rate, time, _ = settle_times(kept + 1.0, kept / 29.97, 30.0, "f", 1)
    table = MarkerTable(("a",), rate, time, np.ones((583, 1, 3)), np.zeros((583, 1)))
    assert np.array_equal(table.frame_numbers, kept + 1)


def test_times_in_milliseconds_are_refused() -> None:
    with raises_refusal(RecordingCode.FOREIGN_CONTRADICTORY, "in ms"):
        settle_times(np.arange(1.0, 9.0), 10.0 * np.arange(8), 100.0, "f", 1)
    with raises_refusal(RecordingCode.FOREIGN_NO_RATE):
        settle_times(np.arange(1.0, 9.0), None, 0.0, "f", 1)
