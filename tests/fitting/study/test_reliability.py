from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fitting.study.cuff_study import (
    ReliabilityOutcome,
    agree,
    estimate_effect,
    estimate_reliability,
    predict_observation,
)
from fitting.study.variance_components import Factor, MixedModel, fit_components
from tests.fitting.study.published import PEAK_FLOW, PENICILLIN, SHROUT_FLEISS


def _targets_and_judges(table: np.ndarray) -> MixedModel:
    target, judge = np.indices(table.shape).reshape(2, -1)
    factors = [Factor("target", target), Factor("rating", range(table.size)), Factor("judge", judge)]
    return fit_components(table.ravel(), factors, np.zeros((table.size, table.size)))


def test_the_icc_of_shrout_and_fleiss_is_the_published_one() -> None:
    """ICC(2,1) = 0.29; the interval of McGraw and Wong (1996), by F quantiles, is 0.02 to 0.76."""
    found = estimate_reliability(_targets_and_judges(SHROUT_FLEISS), "target", "rating", "judge")
    assert found.icc.value == pytest.approx(0.2898, abs=5e-4)
    assert found.icc.ci95 == pytest.approx((0.02, 0.76), abs=0.1)
    assert found.outcome is ReliabilityOutcome.COMPLETE
    assert found.mdc.value == pytest.approx(1.96 * np.sqrt(2) * found.sem.value, rel=1e-4)


def test_a_design_without_repeated_donnings_has_no_error_of_measurement() -> None:
    factors = [Factor("volunteer", range(4)), Factor("donning", range(4)), Factor("operator", "AABB")]
    model = fit_components(np.array([1.0, 2.0, 3.0, 5.0]), factors, 0.01 * np.eye(4))
    found = estimate_reliability(model, "volunteer", "donning", "operator")
    assert found.outcome is ReliabilityOutcome.NO_DONNINGS
    assert np.isnan(found.sem.value)


def test_one_volunteer_has_an_error_of_measurement_and_no_icc() -> None:
    factors = [Factor("volunteer", [0] * 4), Factor("donning", [0, 0, 1, 1]), Factor("operator", "AAAA")]
    model = fit_components(np.array([1.0, 1.1, 2.0, 2.2]), [*factors, Factor("repeat", range(4))], np.zeros((4, 4)))
    found = estimate_reliability(model, "volunteer", "donning", "operator")
    assert found.outcome is ReliabilityOutcome.ONE_VOLUNTEER
    assert found.sem.value > 0
    assert np.isnan(found.icc.value)


def test_a_treatment_has_the_published_error_and_degrees_of_freedom() -> None:
    """Penicillin: standard error 2.745 (Faraway, section 10.4), 12 degrees of freedom (analysis of variance)."""
    treatment, blend = np.indices(PENICILLIN.shape).reshape(2, -1)
    factors = [Factor("blend", blend), Factor("residual", range(20))]
    model = fit_components(PENICILLIN.ravel(), factors, np.zeros((20, 20)), np.eye(4)[treatment])
    effect = estimate_effect(model, np.array([-1.0, 0.0, 1.0, 0.0]))
    assert effect.value == pytest.approx(5.0, abs=1e-9)
    assert effect.standard_error == pytest.approx(2.745, abs=5e-4)
    assert effect.dof == pytest.approx(12.0, rel=1e-4)


def test_two_conditions_over_volunteers_give_the_paired_t_test() -> None:
    """A design in which the method of Kenward and Roger is exact."""
    first, second = PEAK_FLOW
    count = len(first)
    values, volunteer = np.concatenate([first, second]), [*range(count), *range(count)]
    condition = np.repeat([0.0, 1.0], count)
    fixed = np.column_stack([np.ones(2 * count), condition])
    factors = [Factor("volunteer", volunteer), Factor("residual", range(2 * count))]
    effect = estimate_effect(fit_components(values, factors, np.zeros((2 * count,) * 2), fixed), np.array([0.0, 1.0]))
    paired = stats.ttest_rel(second, first).confidence_interval()
    assert effect.dof == pytest.approx(count - 1, rel=1e-4)
    assert effect.ci95 == pytest.approx((paired.low, paired.high), rel=1e-4)


def test_the_prediction_of_independent_values_is_that_of_student() -> None:
    """x̄ ± t(n − 1) s √(1 + 1/n)."""
    values = PEAK_FLOW[0]
    count = len(values)
    model = fit_components(values, [Factor("volunteer", range(count))], np.zeros((count, count)))
    found = predict_observation(model, np.ones(1), 0.0)
    reach = stats.t.ppf(0.975, count - 1) * values.std(ddof=1) * np.sqrt(1 + 1 / count)
    assert found.dof == pytest.approx(count - 1, rel=1e-3)
    assert found.ci95 == pytest.approx((values.mean() - reach, values.mean() + reach), rel=1e-4)


def test_the_limits_of_agreement_of_bland_and_altman_are_the_published_ones() -> None:
    """Lancet 1986: bias −2.1 l/min (−22.0 to 17.8), SD 38.8. Its limits are at 2 SD, these at 1.96 SD."""
    found = agree(PEAK_FLOW[::-1].T)
    assert found.bias == pytest.approx(-2.1, abs=0.05)
    assert found.bias_ci95 == pytest.approx((-22.0, 17.8), abs=0.2)
    assert found.limits == pytest.approx((-78.1, 73.9), abs=0.2)
    assert np.diff(found.limits_ci95[0]) == pytest.approx(114.3 - 45.1, abs=1.0)


def test_two_pairs_have_no_limits_of_agreement() -> None:
    assert np.isnan(agree(np.array([[1.0, 2.0], [2.0, 3.5]])).limits).all()
