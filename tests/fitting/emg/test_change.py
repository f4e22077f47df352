"""Change between conditions: Welch's interval as SciPy has it, and its coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats

from fitting.emg.change import RepeatUnit, emg_change, pool_shapes
from fitting.emg.shape import ShapeComparison, ShapeOutcome, compare_shapes
from tests.fitting.emg.simulated import activation

TRIAL, CYCLE = RepeatUnit.TRIAL, RepeatUnit.CYCLE


def single(levels: list[float]) -> list[list[float]]:
    """Trials of one cycle."""
    return [[level] for level in levels]


def test_the_interval_is_welch_s_on_logarithms() -> None:
    without, worn = [1.0, 1.2, 0.9, 1.1], [0.7, 0.8, 0.95]
    expected = stats.ttest_ind(np.log(worn), np.log(without), equal_var=False).confidence_interval()
    for reference, condition, units in (
        (single(without), single(worn), (TRIAL, TRIAL)),
        ([without], [worn], (CYCLE, CYCLE)),
    ):
        found = emg_change(reference, condition)
        assert found.ci95 == pytest.approx(tuple(np.exp([expected.low, expected.high])))
        assert found.ratio == pytest.approx(stats.gmean(worn) / stats.gmean(without))
        assert (found.repeats, found.units) == ((4, 3), units)


def test_a_single_repeat_has_a_ratio_and_no_interval() -> None:
    found = emg_change(single([2.0]), [[1.0, 1.0]])
    assert (found.ratio, found.ci95, found.standard_error) == (0.5, None, None)
    assert found.units == (TRIAL, CYCLE)


def covered(trials: int, cycles: int, spread: tuple[float, float], *, is_flat: bool = False) -> float:
    """Share of intervals that contain the ratio 0.7; spread between trials and between the cycles of a trial."""
    random, hits, sessions = np.random.default_rng(6), 0, 1000
    for _ in range(sessions):
        person = spread[0] * random.standard_normal((2, trials, 1))
        levels = np.exp(person + spread[1] * random.standard_normal((2, trials, cycles)))
        before, after = levels[0], 0.7 * levels[1]
        if is_flat:
            before, after = before.reshape(1, -1), after.reshape(1, -1)
        low, high = emg_change(before.tolist(), after.tolist()).ci95 or (0.0, 0.0)
        hits += low <= 0.7 <= high
    return hits / sessions


def test_the_interval_over_trials_covers_what_cycles_taken_as_independent_would_miss() -> None:
    assert 0.93 <= covered(3, 4, (0.2, 0.1)) <= 0.98
    assert covered(3, 4, (0.2, 0.1), is_flat=True) < 0.8


@pytest.mark.parametrize(("repeats", "spread"), [((3, 3), (0.1, 0.1)), ((5, 3), (0.05, 0.15)), ((8, 8), (0.3, 0.1))])
def test_the_interval_covers_the_true_ratio(repeats: tuple[int, int], spread: tuple[float, float]) -> None:
    random = np.random.default_rng(6)
    hits = 0
    for _ in range(1500):
        without = np.exp(spread[0] * random.standard_normal(repeats[0]))
        worn = 0.7 * np.exp(spread[1] * random.standard_normal(repeats[1]))
        low, high = emg_change(single(without.tolist()), single(worn.tolist())).ci95 or (0.0, 0.0)
        hits += low <= 0.7 <= high
    assert 0.93 <= hits / 1500 <= 0.975


# Correlation and lag over several trials: against Student's interval, and coverage on simulated sessions.


TIME = np.arange(0, 8, 0.01)
EMPTY = np.zeros(0)


def compared(
    correlation: float, lag: float, half_width: float = 0.02, outcome: ShapeOutcome = ShapeOutcome.COMPARED
) -> ShapeComparison:
    low, high = np.tanh(np.arctanh(correlation) + np.array([-0.1, 0.1])).tolist()
    ends = lag - half_width, lag + half_width
    return ShapeComparison(outcome, EMPTY, EMPTY, EMPTY, correlation, (low, high), lag, ends)


def test_trials_that_differ_by_far_more_than_their_intervals_have_student_s_interval() -> None:
    correlations, lags = [0.5, 0.7, 0.9], [0.0, 0.1, 0.3]
    found = pool_shapes([compared(*pair, half_width=1e-4) for pair in zip(correlations, lags, strict=True)])
    assert found is not None and found.lag is not None
    expected = stats.ttest_1samp(lags, 0.0).confidence_interval()
    assert found.lag.value == pytest.approx(np.mean(lags), rel=1e-5)
    assert found.lag.ci95 == pytest.approx((expected.low, expected.high), rel=1e-4)
    z = stats.ttest_1samp(np.arctanh(correlations), 0.0).confidence_interval()
    assert found.correlation == pytest.approx(np.tanh(np.arctanh(correlations).mean()), rel=1e-2)
    assert found.correlation_ci95 == pytest.approx(np.tanh([z.low, z.high]), rel=2e-2)


def test_equal_trials_have_an_interval_narrower_by_the_root_of_their_number() -> None:
    found = pool_shapes([compared(0.8, 0.05)] * 4)
    assert found is not None and found.lag is not None
    assert found.lag.ci95 == pytest.approx((0.04, 0.06))
    assert found.correlation_ci95 == pytest.approx(np.tanh(np.arctanh(0.8) + np.array([-0.05, 0.05])))


def test_a_trial_without_a_lag_enters_the_correlation_alone() -> None:
    unidentified = compared(0.2, 0.4, outcome=ShapeOutcome.LAG_NOT_IDENTIFIED)
    resting = ShapeComparison(ShapeOutcome.MODEL_AT_REST, EMPTY, EMPTY, EMPTY)
    found = pool_shapes([compared(0.8, 0.05), unidentified, compared(0.8, 0.06), resting])
    assert found is not None and found.lag is not None
    assert (found.trials, found.trials_of_lag) == (3, 2)
    assert found.lag.value == pytest.approx(0.055)
    assert found.correlation < 0.75
    alone = pool_shapes([compared(0.8, 0.05), unidentified])
    assert alone is not None and alone.lag is None


def test_a_single_trial_is_not_pooled() -> None:
    assert pool_shapes([compared(0.8, 0.05)]) is None


def test_perfect_correlations_stay_finite() -> None:
    perfect = replace(compared(0.9, 0.0, half_width=0.0), correlation=1.0, correlation_ci95=(1.0, 1.0))
    found = pool_shapes([perfect] * 3)
    assert found is not None
    assert found.correlation == pytest.approx(1.0) and np.isfinite(found.correlation_ci95).all()


@pytest.mark.slow
@pytest.mark.parametrize("between_s", [0.0, 0.03])
def test_the_interval_of_the_lag_covers_the_mean_lag_of_a_person(between_s: float) -> None:
    """Three trials a session; the lag of a trial is normal about the person's."""
    random, hits, sessions = np.random.default_rng(4), 0, 300
    low_pass = signal.butter(2, 6.0, fs=100.0, output="sos")
    model = activation(TIME)
    for _ in range(sessions):
        trials = []
        for _ in range(3):
            lag = 0.05 + between_s * random.standard_normal()
            noise = signal.sosfiltfilt(low_pass, random.standard_normal(len(TIME) + 200))[100:-100]
            envelope = np.interp(TIME - lag, TIME, model) + 0.15 * noise
            trials.append(compare_shapes((TIME, envelope), (TIME, model), 6.0))
        found = pool_shapes(trials)
        assert found is not None and found.lag is not None
        hits += found.lag.ci95[0] <= 0.05 <= found.lag.ci95[1]
    assert 0.93 <= hits / sessions <= 1.0
