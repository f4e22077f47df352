"""The restricted likelihood, by its textbook form and by closed forms of balanced designs."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.results.outcome import FitOutcome
from fitting.study import reml
from fitting.study.reml import ErrorContrasts, contrast, dependencies, evaluate, maximise

Array = NDArray[np.float64]
RNG = np.random.default_rng(7)
GROUPS = np.repeat(np.eye(3), 4, axis=0)  # 3 groups of 4
VALUES = np.repeat([0.0, 3.0, 4.0], 4) + np.tile([1.0, -1.0, 2.0, -2.0], 3)
ONES = np.ones((12, 1))


def one_way(values: Array = VALUES, noise: float = 0.0) -> ErrorContrasts:
    return contrast(values, ONES, noise * np.eye(12), [GROUPS, np.eye(12)])


def harville(values: Array, fixed: Array, covariance: Array) -> float:
    """−2 ℓ up to a constant: log|V| + log|X'V⁻¹X| + (y − Xβ)' V⁻¹ (y − Xβ) (Harville 1974, Biometrika 61:383)."""
    inverse = np.linalg.inv(covariance)
    information = fixed.T @ inverse @ fixed
    residual = values - fixed @ np.linalg.solve(information, fixed.T @ inverse @ values)
    return float(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(information)[1] + residual @ inverse @ residual)


def test_the_deviance_differs_from_harville_s_form_by_a_constant() -> None:
    fixed, noise = np.column_stack([np.ones(12), np.arange(12.0)]), np.diag(np.linspace(0.5, 2.0, 12))
    rest = contrast(VALUES, fixed, noise, [GROUPS, np.eye(12)])
    assert rest.count == 2
    differences = []
    for theta in ([0.0, 0.5], [2.0, 0.7], [5.0, 0.0]):
        covariance = noise + theta[0] * GROUPS @ GROUPS.T + theta[1] * np.eye(12)
        ours = evaluate(rest, np.array(theta) / rest.scale**2).deviance
        differences.append(ours - harville(VALUES, fixed, covariance))
    assert differences == pytest.approx([differences[0]] * 3, abs=1e-9)


def test_the_scale_is_the_root_mean_square_of_the_contrasts_or_else_of_the_noise() -> None:
    """Without a fixed effect, contrasts are a rotation of the values."""
    none = np.zeros((4, 0))
    assert contrast(np.array([3.0, -3.0, 3.0, 3.0]), none, np.eye(4), []).scale == pytest.approx(3.0)
    assert contrast(np.array([3.0]), none[:1], np.eye(1), []).scale == pytest.approx(3.0)
    assert contrast(np.zeros(4), none, 4.0 * np.eye(4), []).scale == pytest.approx(2.0)
    assert contrast(np.zeros(4), none, np.zeros((4, 4)), []).scale == 1.0
    assert contrast(np.ones(1), np.ones((1, 1)), np.zeros((1, 1)), []).scale == 1.0
    scaled = contrast(np.array([3.0, -3.0, 3.0, 3.0]), none, np.eye(4), [np.eye(4)])
    np.testing.assert_allclose(scaled.known, np.eye(4) / 9, atol=1e-12)
    np.testing.assert_allclose(scaled.covariance(np.array([0.5])), np.eye(4) * (1 / 9 + 0.5), atol=1e-12)


def test_gradient_and_information_are_those_of_the_textbook() -> None:
    """Searle, Casella and McCulloch 1992, section 6.6: derivatives with P = V⁻¹ in the space of the contrasts."""
    rest, theta = one_way(noise=0.3), np.array([0.4, 0.9])
    here = evaluate(rest, theta)
    covariance = rest.known + sum(t * root @ root.T for t, root in zip(theta, rest.roots, strict=True))
    inverse = np.linalg.inv(covariance)
    slopes = [root @ root.T for root in rest.roots]
    y = inverse @ rest.values
    for i, a in enumerate(slopes):
        assert here.gradient[i] == pytest.approx(np.trace(inverse @ a) - y @ a @ y)
        for j, b in enumerate(slopes):
            expected = np.trace(inverse @ a @ inverse @ b) / 2
            assert here.information[i, j] == pytest.approx(expected)
            assert here.observed[i, j] == pytest.approx(y @ a @ inverse @ b @ y - expected)


@pytest.mark.parametrize("start", [None, [50.0, 0.01], [0.0, 20.0]])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_the_optimum_of_a_balanced_design_is_that_of_the_analysis_of_variance(
    start: list[float] | None, noise: float
) -> None:
    """Mean squares: between 52/3 on 2, within 10/3 on 9 degrees of freedom. Known noise is part of that within."""
    rest = one_way(noise=noise)
    solution = maximise(rest, None if start is None else np.array(start))
    assert solution.outcome is FitOutcome.CONVERGED
    assert solution.theta * rest.scale**2 == pytest.approx([14 / 4, 10 / 3 - noise], rel=2e-5)
    assert solution.curvature.gradient == pytest.approx([0.0, 0.0], abs=1e-4)


@pytest.mark.parametrize("square_between", [0.0, 3.2])
def test_a_component_whose_likelihood_falls_from_zero_on_stays_at_zero(square_between: float) -> None:
    """Groups that differ by less than the values within, on 2 and 9 degrees of freedom: all variance is within."""
    means = np.sqrt(square_between / 4) * np.array([0.0, 1.0, -1.0])
    rest = one_way(np.repeat(means, 4) + np.tile([1.0, -1.0, 2.0, -2.0], 3))
    solution = maximise(rest)
    assert solution.theta * rest.scale**2 == pytest.approx([0.0, (30 + 2 * square_between) / 11], rel=1e-6)
    assert solution.theta[0] == 0.0 and solution.curvature.gradient[0] > 0
    assert solution.outcome is FitOutcome.CONVERGED


def test_without_a_component_the_noise_alone_gives_the_deviance() -> None:
    rest = contrast(VALUES, ONES, np.eye(12), [])
    solution = maximise(rest)
    assert solution.outcome is FitOutcome.CONVERGED and solution.theta.size == 0
    assert solution.curvature.deviance == pytest.approx(
        11 * np.log(1 / rest.scale**2) + float(np.sum((VALUES - VALUES.mean()) ** 2))
    )


def test_values_without_variance_raise() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        maximise(one_way(np.zeros(12)), np.zeros(2))


@pytest.mark.parametrize(
    ("share", "expected"),
    [(0.2, 0.2), (0.55, 1 - 4.5 / 8), (0.501, 1 - 249.5 / 512)],
    ids=["Fisher scoring", "Newton", "a longer step raises the deviance"],
)
def test_a_round_is_the_longest_of_halved_steps_that_lowers_the_deviance(
    share: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One variance θ of independent values with mean square S, from θ = S / share on.

    Newton's step is −θ (1 − share) / (2 share − 1). If the observed information, proportional to 2 share − 1, is
    negative, Fisher scoring reaches S at once. A step to θ ≤ 0 leaves a singular covariance.
    """
    monkeypatch.setattr(reml, "ROUNDS", 1)
    rest = contrast(np.array([3.0, -3.0, 3.0, 3.0]), np.zeros((4, 0)), np.zeros((4, 4)), [np.eye(4)])
    assert maximise(rest, np.array([1 / share])).theta == pytest.approx([expected / share])


@pytest.mark.parametrize("limit", ["ROUNDS", "HALVINGS"])
def test_a_search_that_is_stopped_early_has_not_converged(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reml, limit, 0)
    solution = maximise(one_way(), np.array([1.0, 1.0]))
    assert solution.outcome is FitOutcome.NOT_CONVERGED
    assert solution.theta.tolist() == [1.0, 1.0]


def test_a_component_depends_on_those_before_it_that_it_is_a_sum_of() -> None:
    cells = np.eye(6)
    pairs = np.repeat(np.eye(3), 2, axis=0)
    roots = (cells, pairs, np.zeros((6, 1)), cells[:, :3], cells[:, 3:], np.hstack([pairs, 2 * cells]))
    rest = ErrorContrasts(np.ones(6), np.eye(6), roots, 1.0)
    assert dependencies(rest) == [None, None, (), None, (0, 3), (0, 1)]
    assert dependencies(ErrorContrasts(np.ones(6), np.eye(6), (), 1.0)) == []


def test_a_factor_of_one_level_has_no_influence_and_one_of_single_observations_is_the_identity() -> None:
    rest = contrast(VALUES, ONES, np.eye(12), [ONES, np.eye(12)])
    assert not rest.roots[0].any()
    np.testing.assert_array_equal(rest.roots[1], np.eye(11))
    assert dependencies(rest) == [(), None]
    for difference, is_level in ((3e-8, True), (4e-8, False)):  # √12 · 1e-8 is the limit
        slope = np.arange(12.0)[:, None] * difference / np.sqrt(143)
        assert contrast(VALUES, ONES, np.eye(12), [ONES + slope]).roots[0].any() != is_level
