"""How repeats are put together."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.uncertainty import NORMAL_95, Estimate, Repeat, combine


def _half_width(estimate: Estimate) -> float:
    return (estimate.ci95[1] - estimate.ci95[0]) / 2


def test_one_repeat_keeps_its_noise_and_what_it_shares() -> None:
    estimate = combine([Repeat(10.0, 0.3, common=0.4)])
    assert estimate.value == 10.0
    assert estimate.standard_error == pytest.approx(0.5)
    assert _half_width(estimate) == pytest.approx(NORMAL_95 * 0.5)


def test_what_trials_share_is_not_averaged_away() -> None:
    estimate = combine([Repeat(10.0, 0.3, common=0.4)] * 9)
    assert estimate.standard_error == pytest.approx(np.hypot(0.1, 0.4))


def test_repeats_that_differ_by_more_than_noise_widen_the_interval_as_student_asks() -> None:
    estimate = combine([Repeat(value, 0.1) for value in (9.0, 10.0, 11.0)])
    assert estimate.standard_error == pytest.approx(1 / np.sqrt(3))
    assert _half_width(estimate) == pytest.approx(4.302653 / np.sqrt(3), rel=1e-6)


def test_scatter_within_a_trial_beyond_its_noise_widens_the_interval() -> None:
    quiet, rough = Repeat(10.0, 0.1, chi_square=4.0, dof=4), Repeat(10.0, 0.1, chi_square=36.0, dof=4)
    assert combine([rough]).standard_error == pytest.approx(3 * combine([quiet]).standard_error)


def test_the_interval_for_the_mean_of_three_covers_when_repeats_differ_by_two_percent() -> None:
    random = np.random.default_rng(5)
    covered = 0
    for _ in range(400):
        repeats = [Repeat(100 + 2 * random.standard_normal() + 0.5 * random.standard_normal(), 0.5) for _ in range(3)]
        low, high = combine(repeats).ci95
        covered += low <= 100 <= high
    assert 0.90 <= covered / 400 <= 0.98
