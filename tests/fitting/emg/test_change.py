"""Change between conditions: Welch's interval as SciPy has it, and its coverage."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fitting.emg.change import RepeatUnit, emg_change

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
