"""How repeats are put together."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fitting.uncertainty import NORMAL_95, Estimate, Repeat, as_inverse, combine


def _half_width(estimate: Estimate) -> float:
    return (estimate.ci95[1] - estimate.ci95[0]) / 2


def test_one_repeat_keeps_its_noise_and_what_it_shares() -> None:
    estimate = combine([Repeat(10.0, 0.3, common=0.4)])
    assert estimate.value == 10.0
    assert estimate.standard_error == pytest.approx(0.5)
    assert _half_width(estimate) == pytest.approx(NORMAL_95 * 0.5)


def test_an_estimate_is_widened_by_what_it_did_not_hold_and_keeps_student_s_ends() -> None:
    narrow = Estimate(10.0, 0.3, (9.0, 10.8))
    wide = narrow.widened({"lag": 0.4, "gain": 0.0})
    assert wide.value == 10.0
    assert wide.standard_error == pytest.approx(0.5)
    assert wide.ci95 == pytest.approx((10 - np.hypot(1.0, 0.4 * NORMAL_95), 10 + np.hypot(0.8, 0.4 * NORMAL_95)))
    assert wide.parts == {"noise": 0.3, "lag": 0.4, "gain": 0.0}


def test_what_trials_share_is_not_averaged_away() -> None:
    estimate = combine([Repeat(10.0, 0.3, common=0.4)] * 9)
    assert estimate.standard_error == pytest.approx(np.hypot(0.1, 0.4))


def test_repeats_that_differ_by_more_than_noise_widen_the_interval_as_student_asks() -> None:
    estimate = combine([Repeat(value, 0.1) for value in (9.0, 10.0, 11.0)])
    assert estimate.standard_error == pytest.approx(1 / np.sqrt(3))
    assert _half_width(estimate) == pytest.approx(4.302653 / np.sqrt(3), rel=1e-6)


@pytest.mark.parametrize(("count", "extra"), [(2, 0.0), (2, 1.0), (2, 4.0), (3, 0.0), (3, 2.0), (3, 8.0), (5, 1.0)])
def test_the_interval_covers_what_it_claims_whether_repeats_differ_by_noise_or_really(count: int, extra: float) -> None:
    random = np.random.default_rng(8)
    means = 100 + 0.5 * np.hypot(1.0, extra) * random.standard_normal((600, count))
    intervals = [combine([Repeat(value, 0.5) for value in row]).ci95 for row in means]
    assert np.mean([low <= 100 <= high for low, high in intervals]) >= 0.925  # 95 % less three standard errors


@pytest.mark.parametrize("count", [2, 3, 5])
def test_half_the_interval_of_repeats_that_really_differ_would_be_found_out(count: int) -> None:
    means = 100 + 4 * np.random.default_rng(8).standard_normal((600, count))
    intervals = [combine([Repeat(value, 0.5) for value in row]).ci95 for row in means]
    assert np.mean([0.25 <= (100 - low) / (high - low) <= 0.75 for low, high in intervals]) < 0.925


def test_repeats_of_different_noise_are_weighted_by_it_until_their_spread_drowns_it() -> None:
    alike = combine([Repeat(9.9, 0.1), Repeat(10.4, 1.0)])
    apart = combine([Repeat(5.0, 0.1), Repeat(15.0, 1.0)])
    assert alike.value == pytest.approx(9.9 + 0.5 / 101)
    assert apart.value == pytest.approx(10.0, abs=0.1)


def test_the_parts_of_an_error_add_up_to_it() -> None:
    causes = {"lag": 0.3, "gain": 0.4}
    estimate = combine([Repeat(value, 0.1, 0.5, causes=causes) for value in (9.0, 10.0, 11.0)])
    assert math.hypot(*estimate.parts.values()) == pytest.approx(estimate.standard_error)
    assert estimate.parts["gain"] == pytest.approx(0.4)
    assert estimate.parts["noise"] == pytest.approx(0.1 / math.sqrt(3))
    assert estimate.bound == pytest.approx(math.hypot(0.1 / math.sqrt(3), 0.5))


def test_an_inverse_turns_the_interval_over_and_scales_the_parts() -> None:
    turned = as_inverse(Estimate(0.5, 0.01, (0.4, 0.8), {"noise": 0.01}, 0.005))
    assert turned == Estimate(2.0, 0.04, (1.25, 2.5), {"noise": 0.04}, 0.02)
    assert as_inverse(Estimate(0.5, 0.5, (-0.1, 1.0))).ci95[1] == math.inf


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
