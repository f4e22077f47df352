"""REML and mixed models: the textbook form, balanced designs, variance components of published data."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize, stats

from fitting.results.codes import FitOutcome
from fitting.study import restricted_likelihood
from fitting.study.cuff_study import Observation, _study_factors, fit_model
from fitting.study.donning_spread import SpreadOutcome, estimate_donning_spread
from fitting.study.restricted_likelihood import (
    Curvature,
    ErrorContrasts,
    RemlSolution,
    contrast,
    dependencies,
    evaluate,
    maximise,
)
from fitting.study.variance_components import (
    ComponentOutcome,
    Factor,
    TooFewObservations,
    _evaluate_odds,
    _lower_end,
    component_interval,
    deviance_quantile,
    fit_components,
    ratio_interval,
)
from tests.fitting.study.published import AIAG, PENICILLIN, SIRSTV
from tests.fitting.study.test_cuff_study import draw_study

Array = NDArray[np.float64]
RNG = np.random.default_rng(7)
GROUPS = np.repeat(np.eye(3), 4, axis=0)  # 3 groups of 4
VALUES = np.repeat([0.0, 3.0, 4.0], 4) + np.tile([1.0, -1.0, 2.0, -2.0], 3)
ONES = np.ones((12, 1))
SPREAD, WITHIN = 0.15, 0.02


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
    monkeypatch.setattr(restricted_likelihood, "ROUNDS", 1)
    rest = contrast(np.array([3.0, -3.0, 3.0, 3.0]), np.zeros((4, 0)), np.zeros((4, 4)), [np.eye(4)])
    assert maximise(rest, np.array([1 / share])).theta == pytest.approx([expected / share])


@pytest.mark.parametrize("limit", ["ROUNDS", "HALVINGS"])
def test_a_search_that_is_stopped_early_has_not_converged(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(restricted_likelihood, limit, 0)
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


def test_the_gauge_study_of_aiag_gives_its_published_standard_deviations() -> None:
    """MSA 4th edition, ANOVA method without interaction: PV 1.042327, AV 0.226838, EV 0.199933."""
    appraiser, _, part = np.indices(AIAG.shape).reshape(3, -1)
    cell = [f"{a} {p}" for a, p in zip(appraiser, part, strict=True)]
    factors = [Factor("part", part), Factor("appraiser", appraiser), Factor("interaction", cell)]
    model = fit_components(AIAG.ravel(), [*factors, Factor("repeat", range(90))], np.zeros((90, 90)))
    sd = {name: np.sqrt(component.variance) for name, component in model.components.items()}
    assert sd == pytest.approx(
        {"part": 1.042327, "appraiser": 0.226838, "interaction": 0.0, "repeat": 0.199933}, abs=1e-6
    )
    outcomes = {name: component.outcome for name, component in model.components.items()}
    assert outcomes.pop("interaction") is ComponentOutcome.AT_ZERO
    assert model.components["interaction"].ci95[0] == 0.0 < model.components["interaction"].ci95[1]
    assert set(outcomes.values()) == {ComponentOutcome.ESTIMATED}
    assert model.outcome is FitOutcome.CONVERGED
    free = np.array([True, True, False, True])  # a variance at its limit has no standard error
    covariance = model.theta_covariance()
    np.testing.assert_array_equal(covariance[~free], 0.0)
    within = np.linalg.inv(model.information[np.ix_(free, free)])
    np.testing.assert_allclose(covariance[np.ix_(free, free)], within, rtol=1e-6)


def test_the_silicon_wafers_of_nist_give_their_certified_mean_squares() -> None:
    """StRD SiRstv: between 1.27865654000E-02 on 4, within 1.08318280000E-02 on 20 degrees of freedom."""
    factors = [Factor("group", np.repeat(range(5), 5)), Factor("within", range(25))]
    model = fit_components(SIRSTV.ravel(), factors, np.zeros((25, 25)))
    assert model.components["within"].variance == pytest.approx(1.08318280000e-02, rel=1e-6)
    assert model.components["group"].variance == pytest.approx((1.27865654e-02 - 1.0831828e-02) / 5, rel=1e-5)


def test_blends_of_penicillin_give_the_published_reml_estimates() -> None:
    """Faraway, Extending the Linear Model with R, 2nd edition, section 10.4: blend 11.79, residual 18.83."""
    treatment, blend = np.indices(PENICILLIN.shape).reshape(2, -1)
    fixed = np.eye(4)[treatment]
    factors = [Factor("blend", blend), Factor("residual", range(20))]
    model = fit_components(PENICILLIN.ravel(), factors, np.zeros((20, 20)), fixed)
    found = [model.components[name].variance for name in ("blend", "residual")]
    assert found == pytest.approx([11.79, 18.83], abs=0.005)


def test_an_unbalanced_nested_design_agrees_with_statsmodels() -> None:
    formula_api = pytest.importorskip("statsmodels.formula.api")
    import pandas as pd

    rng = np.random.default_rng(3)
    rows = [(v, f"{v}{d}") for v in range(12) for d in range(1 + v % 3) for _ in range(1 + (v + d) % 3)]
    volunteer, donning = map(list, zip(*rows, strict=True))
    offsets = {name: rng.normal(0, 20) for name in donning}, rng.normal(0, 40, 12)
    values = np.array([500 + offsets[1][v] + offsets[0][d] + rng.normal(0, 10) for v, d in rows])
    factors = [Factor("volunteer", volunteer), Factor("donning", donning), Factor("repeat", range(len(rows)))]
    model = fit_components(values, factors, np.zeros((len(rows), len(rows))), with_intervals=False)

    table = pd.DataFrame({"y": values, "volunteer": volunteer, "donning": donning})
    nested = {"donning": "0 + C(donning)"}
    oracle = formula_api.mixedlm("y ~ 1", table, groups="volunteer", re_formula="1", vc_formula=nested).fit(reml=True)
    expected = [float(oracle.cov_re.iloc[0, 0]), float(oracle.vcomp[0]), float(oracle.scale)]
    assert model.theta == pytest.approx(expected, rel=2e-3)


def test_factors_that_the_design_does_not_separate_have_outcomes() -> None:
    volunteers = [0, 0, 1, 1, 2, 2]
    donnings, repeats = [f"{v}{i % 2}" for i, v in enumerate(volunteers)], range(6)
    factors = [Factor("volunteer", volunteers), Factor("donning", donnings), Factor("repeat", repeats)]
    factors.append(Factor("operator", ["A"] * 6))
    model = fit_components(np.array([1.0, 1.2, 2.0, 2.1, 3.0, 3.3]), factors, 0.01 * np.eye(6))
    assert model.components["repeat"].outcome is ComponentOutcome.CONFOUNDED
    assert model.components["repeat"].confounded_with == ("donning",)
    assert model.components["operator"].outcome is ComponentOutcome.ONE_LEVEL
    assert [component.name for component in model.estimated] == ["volunteer", "donning"]


@pytest.mark.parametrize(
    ("values", "factors"),
    [([1.0], []), ([2.0, 2.0], []), ([1.0, 1.0, 2.0, 2.0], [Factor("volunteer", [0, 0, 1, 1])])],
    ids=["one observation", "no variance and no noise", "a singular covariance"],
)
def test_values_whose_variance_is_unknown_are_refused(values: list[float], factors: list[Factor]) -> None:
    count = len(values)
    with pytest.raises(TooFewObservations):
        fit_components(np.array(values), factors, np.zeros((count, count)))


def test_one_observation_more_than_coefficients_is_enough() -> None:
    assert fit_components(np.array([1.0, 2.0]), [], np.eye(2)).estimated == []
    with pytest.raises(TooFewObservations):
        fit_components(np.array([1.0]), [], np.eye(1))


APART = VALUES + np.repeat([0.0, 10.0, 25.0], 4)


@pytest.mark.parametrize("noise", [0.0, 1.5])
def test_the_interval_of_a_share_is_that_of_harville_s_profile(noise: float) -> None:
    """At each end of ρ = θ / (θ + σ² + noise), the deviance over all σ² lies above its least by the quantile."""

    def profile(odds: float) -> float:
        def deviance(variance: float) -> float:
            groups = odds * (variance + noise) * GROUPS @ GROUPS.T
            return harville(APART, ONES, (variance + noise) * np.eye(12) + groups)

        return float(
            optimize.minimize_scalar(deviance, bounds=(1e-6, 50), method="bounded", options={"xatol": 1e-9}).fun
        )

    contrasts = one_way(APART, noise)
    solution, unit = maximise(contrasts), contrasts.scale**2
    least = profile(float(solution.theta[0]) / (float(solution.theta[1]) + noise / unit))
    ends = ratio_interval(contrasts, solution, 0, noise / unit, 2)
    assert 0.2 < ends[0] < ends[1] < 0.9999
    for end in ends:
        assert profile(end / (1 - end)) - least == pytest.approx(deviance_quantile(2), rel=5e-3)


def test_the_lower_end_of_a_share_is_that_of_the_lower_of_two_minima() -> None:
    """Of three operators either little variance, or so much that the share of the volunteers is small."""
    measurements, _ = draw_study(np.random.default_rng(49))
    model = fit_model(measurements, _study_factors(measurements))
    contrasts, solution, noise = model.contrasts, model.solution, model.noise / model.contrasts.scale**2
    low, _ = ratio_interval(contrasts, solution, 0, noise, 2)

    def deviance(logs: Array) -> float:
        others = np.exp(logs)
        return evaluate(contrasts, np.array([low / (1 - low) * (others.sum() + noise), *others])).deviance

    logs = np.log(solution.theta[1:] + 1e-3)
    starts = [logs + np.array([0.0, 0.0, change]) for change in (-3.0, 0.0, 1.0, 3.0)]
    least = [optimize.minimize(deviance, start, method="Nelder-Mead").fun for start in starts]
    assert np.ptp(least) > 0.1, "two minima"
    assert min(least) - solution.curvature.deviance == pytest.approx(deviance_quantile(2), abs=5e-3)


def test_a_share_beside_known_noise_alone_has_the_ends_of_its_variance() -> None:
    contrasts = contrast(APART, ONES, 2.0 * np.eye(12), [GROUPS])
    solution, noise = maximise(contrasts), 2.0 / contrasts.scale**2
    ends = component_interval(contrasts, solution, 0, 2)
    shares = [end / (end + noise) for end in ends]
    assert ratio_interval(contrasts, solution, 0, noise, 2) == pytest.approx(shares, rel=2e-3)
    contrasts = contrast(VALUES, ONES, np.zeros((12, 12)), [np.eye(12)])
    low, high = ratio_interval(contrasts, maximise(contrasts), 0, 0.0, 11)
    assert np.isnan(low) and high == 1.0


def test_variances_ends_and_information_have_the_unit_of_the_values() -> None:
    """The information is tr(P Z_i Z_i' P Z_j Z_j') / 2 (Searle, Casella and McCulloch 1992, Variance Components)."""
    known = np.diag(np.linspace(0.5, 2.0, 12))
    factors = [Factor("group", np.repeat(range(3), 4).tolist()), Factor("repeat", range(12))]
    model, tens = fit_components(APART, factors, known), fit_components(10 * APART, factors, 100 * known)
    assert (model.noise, tens.noise) == (pytest.approx(1.25), pytest.approx(125.0))
    group, repeat = model.estimated
    covariance = known + group.variance * GROUPS @ GROUPS.T + repeat.variance * np.eye(12)
    np.testing.assert_allclose(model.covariance(), covariance, rtol=1e-9)
    inverse = np.linalg.inv(covariance)
    projected = inverse - inverse @ ONES @ ONES.T @ inverse / inverse.sum()
    parts = [projected @ GROUPS @ GROUPS.T, projected]
    information = [[0.5 * np.trace(one @ other) for other in parts] for one in parts]
    np.testing.assert_allclose(model.theta_covariance(), np.linalg.inv(information), rtol=1e-4)
    np.testing.assert_allclose(tens.theta_covariance(), 1e4 * model.theta_covariance(), rtol=1e-3)
    for place, component in enumerate(model.estimated):
        ends = component_interval(model.contrasts, model.solution, place, component.levels - 1)
        assert component.ci95 == pytest.approx(np.array(ends) * model.contrasts.scale**2, rel=1e-9)
        assert tens.estimated[place].ci95 == pytest.approx(100 * np.array(component.ci95), rel=5e-3)


def profile_of_one_variance(theta: float, count: int, noise: float) -> float:
    """Deviance of contrasts of mean square 1 and variance θ + noise."""
    return count * np.log(theta + noise) + count / (theta + noise)


@pytest.mark.parametrize("noise", [1e-6, 0.3, 0.53, 0.54, 0.7, 1.5, 40.0])
def test_the_interval_of_a_variance_beside_known_noise_is_that_of_their_sum_less_the_noise(noise: float) -> None:
    """The sum has a lower end of 0.5338; noise beyond leaves a lower end of zero, and beyond 1 an estimate of zero."""
    values = np.random.default_rng(2).standard_normal(16)
    none = np.zeros((16, 0))
    contrasts = contrast(values, none, noise * np.mean(values**2) * np.eye(16), [np.eye(16)])
    low, high = component_interval(contrasts, maximise(contrasts), 0, 15)
    highest = profile_of_one_variance(max(0.0, 1 - noise), 16, noise) + deviance_quantile(15)
    excess = [profile_of_one_variance(end, 16, noise) - highest for end in (0.0, low, high)]
    slope = 16 * (1 - 1 / (high + noise)) / (high + noise)
    assert excess[2] == pytest.approx(0.0, abs=1e-3 * slope * high)
    assert (low > 0) == (noise < 0.5338) == (excess[0] > 0)
    assert low == 0 or low + noise == pytest.approx(0.5338, abs=5e-4)


def test_an_end_is_as_precise_where_a_part_of_the_values_is_far_more_precise_than_the_rest() -> None:
    """The variance is known from ten values alone; it is 1e-6 of the mean square of all."""
    noise = np.repeat([1e-6, 100.0], [10, 30])
    values = np.sqrt(noise + 1e-4) * np.random.default_rng(3).standard_normal(40)
    contrasts = contrast(values, np.zeros((40, 0)), np.diag(noise), [np.eye(40)])

    def deviance(theta: float) -> float:
        return float(np.sum(np.log(noise + theta) + values**2 / (noise + theta)))

    least = optimize.minimize_scalar(deviance, bounds=(1e-5, 1e-3), method="bounded", options={"xatol": 1e-10})
    ends = np.array(component_interval(contrasts, maximise(contrasts), 0, 39)) * contrasts.scale**2
    limit = float(least.fun) + deviance_quantile(39)
    for end, bracket in zip(ends, ((1e-6, least.x), (least.x, 1e-2)), strict=True):
        assert end == pytest.approx(optimize.brentq(lambda theta: deviance(theta) - limit, *bracket), rel=2e-3)


@pytest.mark.parametrize(("end", "is_found"), [(9e5, True), (1.1e6, False)])
def test_an_upper_end_beyond_a_million_mean_squares_is_not_found(end: float, is_found: bool) -> None:
    """Values that are far smaller than their noise: the end is where 4 log(1 + θ / noise) is the quantile."""
    noise = end / np.expm1(deviance_quantile(3) / 4)
    contrasts = contrast(np.array([1.0, -1.0, 1.0, 1.0]), np.zeros((4, 0)), noise * np.eye(4), [np.eye(4)])
    low, high = component_interval(contrasts, maximise(contrasts), 0, 3)
    assert low == 0.0
    assert high == pytest.approx(end, rel=2e-3) if is_found else np.isnan(high)


def test_a_variance_that_two_crossed_factors_can_replace_has_a_lower_end_of_zero() -> None:
    """Both factors are at zero beside it. Without it and them the covariance is singular, with them it is not."""
    volunteers, operators = [0, 2, 1, 1], [2, 0, 2, 0]
    values, ones = np.array([4.0, 1.0, 0.0, 4.0]), np.ones((4, 1))
    factors = [Factor("volunteer", volunteers), Factor("operator", operators), Factor("repeat", range(4))]
    volunteer, operator, repeat = fit_components(values, factors, np.zeros((4, 4))).estimated
    assert (volunteer.variance, operator.variance) == (0.0, 0.0)
    squares = [factor.incidence() @ factor.incidence().T for factor in factors[:2]]
    instead = min(
        harville(values, ones, one * squares[0] + other * squares[1])
        for one in np.geomspace(0.1, 100, 20)
        for other in np.geomspace(0.1, 100, 20)
    )
    assert instead - harville(values, ones, repeat.variance * np.eye(4)) < deviance_quantile(3)
    assert repeat.ci95[0] == 0.0


@pytest.mark.parametrize("dof", [1, 4, 60])
def test_the_interval_of_a_mean_square_between_equal_deviances_covers_95_percent(dof: int) -> None:
    ratios = np.linspace(1e-9, 20, 2_000_001)
    inside = ratios[dof * (ratios - 1 - np.log(ratios)) <= deviance_quantile(dof)]
    low, high = stats.chi2.cdf(dof * inside[[0, -1]], dof)
    assert high - low == pytest.approx(0.95, abs=1e-4)


def test_the_quantile_for_many_levels_is_that_of_chi_square() -> None:
    assert deviance_quantile(5000) == pytest.approx(float(stats.chi2.ppf(0.95, 1)), rel=1e-4)
    assert deviance_quantile(1) > deviance_quantile(5) > deviance_quantile(50)


@pytest.mark.parametrize("seed", range(4))
def test_a_small_design_without_known_noise_has_intervals_or_is_refused(seed: int) -> None:
    """A variance of zero makes the covariance singular there: the search for an end passes by it."""
    rng = np.random.default_rng(seed)
    volunteers = rng.integers(0, 3, 7)
    donnings = [f"{v} {rng.integers(0, 2)}" for v in volunteers]
    factors = [Factor("volunteer", volunteers.tolist()), Factor("donning", donnings), Factor("repeat", range(7))]
    model = fit_components(10 + volunteers + 1e-3 * rng.standard_normal(7), factors, np.zeros((7, 7)))
    for component in model.estimated:
        low, high = component.ci95
        assert low <= component.variance * (1 + 1e-6)
        assert not high < component.variance


# Relative spread between donnings: against analysis of variance, in coverage, and where it cannot be estimated.


def measured(
    seed: int, cuffs: int = 3, donnings: int = 4, repeats: int = 3, *, spread: float = SPREAD, noise: float = 0.0
) -> list[Observation]:
    """Values of cuffs of different stiffness, with normal logarithms."""
    generator = np.random.default_rng(seed)
    found = []
    for cuff in range(cuffs):
        for donning in range(donnings):
            centre = np.log(2000.0 * (cuff + 1)) + spread * generator.normal()
            for repeat in range(1, repeats + 1):
                value = float(np.exp(centre + np.hypot(WITHIN, noise) * generator.normal()))
                found.append(
                    Observation(
                        value, noise * value, 0.01 * value, "P01", "A", "monday", str(donning), repeat, f"{cuff}"
                    )
                )
    return found


def test_the_spread_is_that_of_an_analysis_of_variance_of_logarithms() -> None:
    # balanced, without known noise: REML and the method of moments are the same estimator
    found = estimate_donning_spread(measured(1))
    table = np.log([one.value for one in measured(1)]).reshape(3, 4, 3)
    between = 3 * table.mean(axis=2).var(axis=1, ddof=1).mean()
    within = table.var(axis=2, ddof=1).mean()
    assert found.outcome is SpreadOutcome.ESTIMATED
    assert found.spread == pytest.approx(np.sqrt((between - within) / 3), rel=1e-4)
    assert (found.donnings, found.cuffs) == (12, 3)
    assert found.freedom == pytest.approx(9, abs=0.5)
    assert found.ci95[0] < found.spread < found.ci95[1]


def test_scale_errors_of_a_session_values_not_positive_and_cuffs_donned_once_do_not_matter() -> None:
    plain = estimate_donning_spread(measured(2))
    scaled = [replace(one, value=7 * one.value, noise=0.0, shared=2.1 * one.value) for one in measured(2)]
    assert estimate_donning_spread(scaled).spread == pytest.approx(plain.spread, rel=1e-6)
    once = Observation(9000.0, 0.0, 0.0, "P01", "A", "monday", "1", 1, "single")
    negative = Observation(-3.0, 0.1, 0.0, "P01", "A", "monday", "9", 1, "0")
    assert estimate_donning_spread([*measured(1), once, negative]) == estimate_donning_spread(measured(1))


def test_intervals_of_many_studies_contain_the_true_spread() -> None:
    found = [estimate_donning_spread(measured(seed, repeats=2)) for seed in range(80)]
    inside = [one.ci95[0] <= SPREAD <= one.ci95[1] for one in found]
    assert 0.88 <= np.mean(inside) <= 1.0
    assert np.mean([one.spread**2 for one in found]) == pytest.approx(SPREAD**2, rel=0.1)


@pytest.mark.parametrize(("cuffs", "donnings"), [(3, 1), (3, 2), (1, 4), (0, 0)])
def test_few_donnings_give_no_spread(cuffs: int, donnings: int) -> None:
    found = estimate_donning_spread(measured(3, cuffs, donnings))
    assert found.outcome is SpreadOutcome.FEW_DONNINGS
    assert np.isnan(found.spread)


def test_a_spread_below_the_noise_of_the_fits_is_not_resolved() -> None:
    found = estimate_donning_spread(measured(4, spread=0.0, noise=0.3))
    assert found.outcome is SpreadOutcome.UNRESOLVED


def test_the_curvature_by_odds_has_the_differences_of_the_deviance_and_of_the_gradient() -> None:
    contrasts, at, step = one_way(noise=0.3), np.array([0.7, 0.4]), 1e-5

    def by_odds(coordinates: Array) -> Curvature:
        return _evaluate_odds(contrasts, 0, 0.2, coordinates)

    here, sides = by_odds(at), [(by_odds(at + move), by_odds(at - move)) for move in step * np.eye(2)]
    slopes = [(more.deviance - less.deviance) / (2 * step) for more, less in sides]
    np.testing.assert_allclose(here.gradient, slopes, rtol=1e-6)
    bends = [(more.gradient - less.gradient) / (4 * step) for more, less in sides]
    np.testing.assert_allclose(here.observed, bends, rtol=1e-6)
    assert by_odds(at).deviance == evaluate(contrasts, np.array([0.7 * (0.4 + 0.2), 0.4])).deviance


def test_a_share_of_a_component_at_zero_begins_at_zero() -> None:
    contrasts = one_way(np.tile([1.0, -1.0, 2.0, -2.0], 3))
    solution = maximise(contrasts)
    assert solution.theta[0] == 0
    low, high = ratio_interval(contrasts, solution, 0, 0.0, 2)
    assert low == 0 < high < 1


def test_a_minimum_that_is_below_the_limit_down_to_zero_has_its_lower_end_there() -> None:
    flat = Curvature(0.0, np.zeros(1), np.eye(1), np.eye(1))
    best = RemlSolution(np.ones(1), flat, FitOutcome.CONVERGED)
    assert _lower_end(lambda _: flat, best, 0, 0.5, 2, np.ones(1)) == 0
