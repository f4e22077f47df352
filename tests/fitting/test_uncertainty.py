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


def test_two_repeats_as_far_apart_as_noise_puts_them_are_not_widened_by_luck() -> None:
    widths = [_half_width(combine([Repeat(10.0, 0.1), Repeat(10.0 + apart, 0.1)])) for apart in (0.0, 0.1, 0.2)]
    assert all(0.1 < width < 0.4 for width in widths)
    assert widths == sorted(widths)


def test_two_repeats_that_contradict_each_other_are_as_uncertain_as_student_says() -> None:
    assert _half_width(combine([Repeat(9.0, 0.1), Repeat(11.0, 0.1)])) == pytest.approx(12.7062, rel=1e-5)


@pytest.mark.parametrize(("extra", "least"), [(0.0, 0.97), (0.5, 0.95)])
def test_the_interval_of_two_repeats_covers_although_noise_is_taken_as_known(extra: float, least: float) -> None:
    random = np.random.default_rng(8)
    means = 100 + np.hypot(0.5, extra) * random.standard_normal((500, 2))
    estimates = [combine([Repeat(value, 0.5) for value in pair]) for pair in means]
    assert np.mean([e.ci95[0] <= 100 <= e.ci95[1] for e in estimates]) >= least
    assert np.median([_half_width(e) for e in estimates]) < 1.5


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
