"""How repeats are put together."""

import math

import numpy as np
import pytest
from scipy import stats

from fitting import uncertainty
from fitting.results.codes import FitOutcome
from fitting.uncertainty import (
    NORMAL_95,
    Estimate,
    Repeat,
    as_inverse,
    between_variance,
    chi_square_limit,
    combine,
    normal_estimate,
    student_estimate,
    student_half_width,
)


def _half_width(estimate: Estimate) -> float:
    return (estimate.ci95[1] - estimate.ci95[0]) / 2


@pytest.mark.parametrize("dof", [1, 2, 3.5, 30])
def test_limits_of_distributions_are_those_of_scipy(dof: float) -> None:
    assert chi_square_limit(dof) == pytest.approx(stats.chi2.ppf(0.999, dof))
    assert chi_square_limit(dof, 0.95) == pytest.approx(stats.chi2.ppf(0.95, dof))
    assert student_half_width(dof) == pytest.approx(stats.t.ppf(0.975, dof))
    assert stats.norm.ppf(0.975) == pytest.approx(NORMAL_95, rel=1e-15)


def test_an_interval_is_normal_for_a_known_error_and_student_s_for_scatter() -> None:
    assert normal_estimate(5.0, 2.0).ci95 == pytest.approx((5 - 2 * 1.959964, 5 + 2 * 1.959964), abs=1e-5)
    assert student_estimate(5.0, 2.0, 4).ci95 == pytest.approx((5 - 2 * 2.776445, 5 + 2 * 2.776445), abs=1e-5)


def test_the_text_of_an_estimate_has_its_interval_if_that_has_a_width() -> None:
    estimate = Estimate(8515.0, 30.0, (8301.0, 8741.0))
    assert estimate.text("N/m") == "8515 ± 30 N/m, 95 %: 8301 to 8741"
    assert repr(estimate) == estimate.text() == "8515 ± 30, 95 %: 8301 to 8741"
    assert "95 %" not in Estimate(2.0, 0.0, (2.0, 2.0)).text("N")


@pytest.mark.parametrize(("value", "error", "is_too_wide"), [(4.0, 2.0, False), (-4.0, 2.0, False), (-4.0, 2.1, True)])
def test_an_error_above_half_of_the_value_is_too_wide(value: float, error: float, is_too_wide: bool) -> None:
    assert normal_estimate(value, error).is_too_wide is is_too_wide


@pytest.mark.parametrize("bound", [None, 0.2])
def test_a_negative_factor_swaps_the_ends_and_scales_the_errors(bound: float | None) -> None:
    estimate = Estimate(10.0, 0.5, (9.0, 12.0), {"lag": 0.3}, bound, FitOutcome.NOT_CONVERGED)
    scaled = estimate.scaled(-2.0)
    assert scaled.bound == (None if bound is None else 0.4)
    assert scaled == Estimate(-20.0, 1.0, (-24.0, -18.0), {"lag": 0.6}, scaled.bound, FitOutcome.NOT_CONVERGED)


@pytest.mark.parametrize(
    ("values", "noise", "variance"),
    [
        ([5.0], [1.0], 0.0),
        ([-1.0, 0.0, 1.0], [1.0, 1.0, 1.0], 0.0),
        ([-1.1, 0.0, 1.1], [1.0, 1.0, 1.0], 0.21),
        ([0.0, 20.0], [1.0, 1.0], 199.0),
        ([9.0, 10.0, 11.0], [0.1, 0.1, 0.1], 0.99),
    ],
    ids=["one", "noise alone", "little more", "two", "three"],
)
def test_the_variance_between_equal_repeats_is_that_of_their_values_less_the_noise(
    values: list[float], noise: list[float], variance: float
) -> None:
    found, outcome = between_variance(np.array(values), np.array(noise))
    assert found == pytest.approx(variance, rel=1e-9) and (found == 0.0) is (variance == 0.0)
    assert outcome is FitOutcome.CONVERGED


def test_the_mean_of_unequal_repeats_is_that_of_paule_and_mandel_in_statsmodels() -> None:
    """The weighted squares of the residuals are then their degrees of freedom; the interval is Hartung and Knapp's."""
    meta_analysis = pytest.importorskip("statsmodels.stats.meta_analysis")
    values, noise = np.array([9.0, 10.5, 11.0, 14.0]), np.array([0.3, 0.8, 0.1, 1.2])
    variance, _ = between_variance(values, noise)
    oracle = meta_analysis.combine_effects(values, noise**2, method_re="iterated", use_t=True)
    assert variance == pytest.approx(oracle.tau2, rel=1e-3)
    weights = 1 / (noise**2 + variance)
    mean = np.average(values, weights=weights)
    assert weights @ (values - mean) ** 2 == pytest.approx(3.0)
    found = combine([Repeat(*pair) for pair in zip(values, noise, strict=True)])
    assert found.value == pytest.approx(mean)
    assert found.ci95 == pytest.approx(
        oracle.conf_int_re if hasattr(oracle, "conf_int_re") else oracle.conf_int()[3], rel=1e-4
    )
    assert found.standard_error == pytest.approx(weights.sum() ** -0.5)


@pytest.mark.parametrize(
    ("rounds", "tolerance", "outcome"),
    [(40, 1e-12, FitOutcome.CONVERGED), (39, 1e-12, FitOutcome.NOT_CONVERGED), (10, 2**-10, FitOutcome.CONVERGED)],
)
def test_a_bisection_has_converged_once_its_interval_is_within_the_tolerance(
    rounds: int, tolerance: float, outcome: FitOutcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The interval of 64, the square of the range, is halved in every round."""
    monkeypatch.setattr(uncertainty, "ROUNDS", rounds)
    assert uncertainty.TOLERANCE == 1e-12
    monkeypatch.setattr(uncertainty, "TOLERANCE", tolerance)
    variance, found = between_variance(np.array([0.0, 8.0]), np.ones(2))
    assert found is outcome and variance == pytest.approx(31.0, abs=64 / 2 ** (rounds + 1))
    assert combine([Repeat(0.0, 1.0), Repeat(8.0, 1.0)]).outcome is outcome


@pytest.mark.parametrize(
    ("chi_squares", "error", "half_width"),
    [
        ((10.0, 6.0), 0.2, 2.776445 * 0.2),
        ((0.5, 0.5), 0.1, 1.959964 * 0.1),
        ((5.0, 0.0), 0.1 * 1.25**0.5, 2.776445 * 0.1 * 1.25**0.5),
    ],
    ids=["scatter of twice the noise", "of half the noise", "a little more"],
)
def test_scatter_beyond_the_noise_widens_error_and_interval_and_less_scatter_narrows_neither(
    chi_squares: tuple[float, float], error: float, half_width: float
) -> None:
    """Two equal repeats with 3 and 1 degrees of freedom; Student's t of 4 is 2.776."""
    noise = 0.1 * math.sqrt(2)
    repeats = [Repeat(10.0, noise, chi_square=square, dof=dof) for square, dof in zip(chi_squares, (3, 1), strict=True)]
    estimate = combine(repeats)
    assert estimate.standard_error == pytest.approx(error)
    assert _half_width(estimate) == pytest.approx(half_width, rel=1e-6)
    assert estimate.parts == {"noise": pytest.approx(error), "between_repeats": 0.0}


def test_the_bound_of_a_mean_is_that_of_its_repeats_and_a_cause_of_one_is_averaged() -> None:
    """Weights 1/u² of 4 and 1; without scatter."""
    repeats = [Repeat(10.0, 0.5, 0.3, causes={"lag": 0.3}, bound=0.25), Repeat(11.0, 1.0)]
    estimate = combine(repeats)
    assert estimate.value == pytest.approx(10.2)
    common = 0.3 * 4 / 5
    assert estimate.bound == pytest.approx(math.hypot(math.hypot(4 * 0.25, 1 * 1.0) / 5, common))
    assert estimate.parts["lag"] == pytest.approx(common)
    assert estimate.standard_error == pytest.approx(math.hypot(math.sqrt(1 / 5), common))
    assert _half_width(repeats[1].estimate) == pytest.approx(NORMAL_95)


def test_one_repeat_keeps_its_noise_and_what_it_shares() -> None:
    estimate = combine([Repeat(10.0, 0.3, common=0.4)])
    assert Repeat(10.0, 0.3) == Repeat(10.0, 0.3, common=0.0, chi_square=0.0, dof=0)
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


@pytest.mark.parametrize(
    ("values", "error", "student"),
    [((9.0, 10.0, 11.0), 1 / np.sqrt(3), 4.302653), ((9.0, 11.0), 1.0, 12.706205)],
    ids=["three", "two"],
)
def test_repeats_that_differ_by_more_than_noise_have_student_s_interval(
    values: tuple[float, ...], error: float, student: float
) -> None:
    estimate = combine([Repeat(value, 0.1) for value in values])
    assert (estimate.standard_error, _half_width(estimate)) == pytest.approx((error, student * error), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "extra"), [(2, 0.0), (2, 1.0), (2, 4.0), (3, 0.0), (3, 2.0), (3, 8.0), (5, 1.0)])
def test_the_interval_covers_what_it_claims_whether_repeats_differ_by_noise_or_really(count: int, extra: float) -> None:
    random = np.random.default_rng(8)
    means = 100 + 0.5 * np.hypot(1.0, extra) * random.standard_normal((600, count))
    intervals = [combine([Repeat(value, 0.5) for value in row]).ci95 for row in means]
    assert np.mean([low <= 100 <= high for low, high in intervals]) >= 0.925  # 95 % less three standard errors


def test_the_parts_of_an_error_add_up_to_it() -> None:
    causes = {"lag": 0.3, "gain": 0.4}
    estimate = combine([Repeat(value, 0.1, 0.5, causes=causes) for value in (9.0, 10.0, 11.0)])
    assert math.hypot(*estimate.parts.values()) == pytest.approx(estimate.standard_error)
    assert estimate.parts["gain"] == pytest.approx(0.4)
    assert estimate.parts["noise"] == pytest.approx(0.1 / math.sqrt(3))
    assert estimate.bound == pytest.approx(math.hypot(0.1 / math.sqrt(3), 0.5))


def test_an_inverse_turns_the_interval_over_and_scales_the_parts() -> None:
    turned = as_inverse(Estimate(0.25, 0.01, (0.2, 0.4), {"noise": 0.01}, 0.005))
    assert turned == Estimate(4.0, 0.16, (2.5, 5.0), {"noise": 0.16}, 0.08)
    for low in (-0.1, 0.0):
        assert as_inverse(Estimate(0.5, 0.5, (low, 1.0))).ci95 == (1.0, math.inf)
