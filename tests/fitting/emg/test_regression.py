"""The closed forms of the regression against dense matrices."""

import numpy as np
import pytest
from scipy import special, stats

from fitting.emg.regression import (
    NOISES,
    REST,
    EmgLagPosterior,
    _moments,
    _restricted_likelihood,
    _variances,
    correlation_interval,
    lag_posterior,
)

RANDOM = np.random.default_rng(8)
N, INTERVAL = 30, 0.1
TIME = INTERVAL * np.arange(N)
LAGS = np.linspace(-0.2, 0.2, 5)
SHIFTED = np.exp(-((TIME - 1.4 - LAGS[:, None]) ** 2))
MEASURED = SHIFTED[3] + 0.05 * np.cumsum(RANDOM.standard_normal(N))
VARIANCES = (SHIFTED[3] + REST) ** 2 / np.mean((SHIFTED[3] + REST) ** 2)


def _matern(order: float, length: float) -> np.ndarray:
    """Matérn's correlation by its general formula with a modified Bessel function."""
    scaled = np.sqrt(2 * order) * np.abs(np.subtract.outer(TIME, TIME)) / length + np.eye(N)
    correlation = 2 ** (1 - order) / special.gamma(order) * scaled**order * special.kv(order, scaled)
    return np.asarray(np.where(np.eye(N), 1.0, correlation))


def _covariance(noise: tuple[float, float, float, float]) -> np.ndarray:
    white, order, time, proportional = noise
    size = np.sqrt((1 - proportional) + proportional * VARIANCES)
    smooth = size[:, None] * _matern(order, time) * size
    return np.asarray((1 - white) * smooth + white * np.diag(VARIANCES))


def _removing(design: np.ndarray) -> np.ndarray:
    return np.asarray(np.eye(N) - design @ np.linalg.pinv(design))


def test_the_noise_has_the_restricted_likelihood_of_the_dense_covariance() -> None:
    """log p = −½ log |V| − ½ log |XᵀV⁻¹X| − (n − 3)/2 log S, up to a constant."""
    design = np.column_stack((np.ones(N), SHIFTED[3], np.gradient(SHIFTED[3])))
    logs = []
    for noise in NOISES:
        matrix = _covariance(noise)
        inner = design.T @ np.linalg.solve(matrix, design)
        residual = MEASURED - design @ np.linalg.solve(inner, design.T @ np.linalg.solve(matrix, MEASURED))
        squares = residual @ np.linalg.solve(matrix, residual)
        determinants = np.linalg.slogdet(matrix)[1] + np.linalg.slogdet(inner)[1]
        logs.append(-0.5 * determinants - 0.5 * (N - 3) * np.log(squares))
    found = _restricted_likelihood(MEASURED, design, VARIANCES, INTERVAL)
    np.testing.assert_allclose(found, np.exp(np.array(logs) - max(logs)), rtol=1e-7)


def test_the_curvature_of_the_posterior_is_the_sandwich_variance_of_the_lag() -> None:
    """(JᵀJ)⁻¹ JᵀVJ (JᵀJ)⁻¹ S / tr MV of least squares, J = [1, a, −β a'], beside the second difference of log p."""
    lags = np.linspace(-0.001, 0.001, 5)
    shifted = np.exp(-((TIME - 1.4 - lags[:, None]) ** 2))
    measured = shifted[2] + 0.01 * _removing(np.column_stack((np.ones(N), *shifted))) @ RANDOM.standard_normal(N)
    weight = lag_posterior(measured, shifted, lags, INTERVAL).weight
    square = (shifted[2] + REST) ** 2
    slope = 2 * (TIME - 1.4) * shifted[2]
    jacobian = np.column_stack((np.ones(N), shifted[2], slope))
    inverse, removing = np.linalg.inv(jacobian.T @ jacobian), _removing(jacobian)
    residual = removing @ measured
    for place in (0, 40, 104, 139):
        white, order, time, proportional = NOISES[place]
        size = np.sqrt((1 - proportional) + proportional * square / square.mean())
        smooth = size[:, None] * _matern(order, time) * size
        matrix = (1 - white) * smooth + white * np.diag(square / square.mean())
        variance = (inverse @ jacobian.T @ matrix @ jacobian @ inverse)[2, 2]
        variance *= residual @ residual / np.trace(removing @ matrix) * (N - 3) / (N - 2)  # σ is integrated
        curvature = np.diff(np.log(weight[place]), 2)[1] / np.diff(lags)[0] ** 2
        assert -1 / curvature == pytest.approx(variance, rel=2e-3)


@pytest.mark.parametrize(
    ("noise", "freedom"),
    [
        ((0.3, 2.5, 1.0, 0.95), 6.0),
        ((0.3, 2.5, 1.0, 0.0), np.inf),
        ((0.3, 0.5, 0.12, 0.95), np.inf),
        ((1.0, 2.5, 1.0, 0.95), np.inf),
    ],
)
def test_the_power_of_a_gain_drift_at_the_movement_has_six_degrees_of_freedom_at_most(
    noise: tuple[float, float, float, float], freedom: float
) -> None:
    """p(τ) ∝ (1 + m (S(τ) / S − 1) / ν)^(−ν / 2), with ν = m but for slow noise proportional to the level."""
    measured = SHIFTED[3] + 0.2 * (MEASURED - SHIFTED[3])
    weight = lag_posterior(measured, SHIFTED, LAGS, INTERVAL).weight[NOISES.index(noise)]
    residuals = [_removing(np.column_stack((np.ones(N), shifted))) @ measured for shifted in SHIFTED]
    squares = np.sum(np.square(residuals), axis=1)
    best, matrix = int(squares.argmin()), _covariance(noise)
    assert best == 3
    derivative = (SHIFTED[best + 1] - SHIFTED[best - 1]) / (LAGS[best + 1] - LAGS[best - 1])
    unit = _removing(np.column_stack((np.ones(N), SHIFTED[best]))) @ derivative
    unit /= np.linalg.norm(unit)
    removing = _removing(np.column_stack((np.ones(N), SHIFTED[best], derivative)))
    m = (N - 2) / (N - 3) * np.trace(removing @ matrix) / (unit @ matrix @ unit)
    nu = 1 / (1 / m + 1 / freedom)
    expected = (1 + m / nu * (squares / squares[best] - 1)) ** (-nu / 2)
    np.testing.assert_allclose(weight / weight[best], expected, rtol=1e-9)


def test_quantiles_of_the_lag_do_not_depend_on_the_steps_of_the_search() -> None:
    """A normal posterior whose standard deviation is 0.7 steps."""
    lags = np.linspace(-0.5, 0.5, 101)
    weight = stats.norm.pdf(lags, 0.123, 0.007)
    levels = (0.025, 0.5, 0.975)
    found = EmgLagPosterior(lags, weight[None] / weight.sum()).quantiles(levels)
    assert found == pytest.approx(stats.norm.ppf(levels, 0.123, 0.007), abs=5e-5)


@pytest.mark.parametrize("place", [0, 5, 16, 30, 56, 104, 139])
def test_moments_are_those_of_the_dense_matrices(place: int) -> None:
    centred = SHIFTED[3] - SHIFTED[3].mean()
    matrix = _covariance(NOISES[place])
    product = _removing(np.column_stack((np.ones(N), centred))) @ matrix
    trace = np.trace(product)
    expected = (
        trace,
        trace**2 / np.trace(product @ product),
        centred @ matrix @ centred / (centred @ centred) ** 2,
        np.trace(matrix) / N - matrix.mean(),
    )
    np.testing.assert_allclose(_moments(centred, VARIANCES, INTERVAL)[:, place], expected, rtol=1e-9)


def test_with_white_noise_the_interval_is_that_of_a_fixed_design() -> None:
    """z = atanh r has the variance (1 − r² / 2) / n, with as many samples as here (delta method)."""
    random = np.random.default_rng(9)
    model = np.sin(np.linspace(0, 20, 2000))
    measured = model + random.standard_normal(2000)
    white = np.array([[float(noise == (0.02, 0.5, 0.02, 0.0))] for noise in NOISES])
    r = float(np.corrcoef(measured, model)[0, 1])
    ends = correlation_interval(measured, model[None], white, 0, interval=1.0)  # longer than any correlation time
    assert np.diff(np.arctanh(ends))[0] / 2 == pytest.approx(1.96 * np.sqrt((1 - r**2 / 2) / 2000), rel=0.06)


@pytest.mark.parametrize("time", [0.12, 2.0])
def test_the_size_of_slow_noise_alone_varies_between_movements(time: float) -> None:
    """The slope of a model far faster than the noise is certain: the ends of ρ are those of the size of the noise."""
    model = np.cos(np.pi * np.arange(200))
    measured = 30 * model + np.convolve(np.random.default_rng(4).standard_normal(219), np.ones(20), mode="valid")
    place = NOISES.index((0.02, 0.5, time, 0.0))
    weight = np.arange(len(NOISES))[:, None] == place
    ends = np.array(correlation_interval(measured, model[None], weight.astype(float), 0, interval=0.1))
    trace, freedom, _, within = _moments(model, _variances(model), 0.1)[:, place]
    slope = model @ measured / 200
    chi_square = ((measured - measured.mean() - slope * model) ** 2).sum() / trace
    chi_square *= within / slope**2 / (1 / ends**2 - 1)  # ν times the estimated size over that at the ends of ρ
    nu = 1 / (1 / freedom + 1 / 24) if time > 1 else freedom
    found = stats.chi2.cdf(nu * chi_square, nu)
    np.testing.assert_allclose(found, (0.025, 0.975), atol=0.0075)  # three standard errors of 4000 draws
