"""The closed forms of the regression against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.emg.regression import FLOOR, NOISES, _moments, correlation_interval, lag_posterior

RANDOM = np.random.default_rng(8)
N = 30
SHIFTED = RANDOM.random((4, N))
MEASURED = SHIFTED[2] + np.cumsum(RANDOM.standard_normal(N))


def _covariance(noise: tuple[float, float], model: np.ndarray) -> np.ndarray:
    power, phi = noise
    size = (model + FLOOR) ** power
    return size[:, None] * phi ** np.abs(np.subtract.outer(np.arange(N), np.arange(N))) * size


def test_the_posterior_is_that_of_generalised_least_squares() -> None:
    """log p = −½ log |R| − ½ log |XᵀR⁻¹X| − (n − 2)/2 log S, up to a constant; R the covariance matrix itself."""
    logs = np.empty((len(NOISES), len(SHIFTED)))
    for i, noise in enumerate(NOISES):
        for j, model in enumerate(SHIFTED):
            matrix = _covariance(noise, model)
            design = np.column_stack((np.ones(N), model))
            inner = design.T @ np.linalg.solve(matrix, design)
            estimate = np.linalg.solve(inner, design.T @ np.linalg.solve(matrix, MEASURED))
            residual = MEASURED - design @ estimate
            squares = residual @ np.linalg.solve(matrix, residual)
            determinants = np.linalg.slogdet(matrix)[1] + np.linalg.slogdet(inner)[1]
            logs[i, j] = -0.5 * determinants - 0.5 * (N - 2) * np.log(squares)
    expected = np.exp(logs - logs.max())
    found = lag_posterior(MEASURED, SHIFTED, np.arange(4.0)).weight
    np.testing.assert_allclose(found, expected / expected.sum(), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("place", [0, 5, 16, 30, 56])
def test_moments_are_those_of_the_dense_matrices(place: int) -> None:
    centred = SHIFTED[0] - SHIFTED[0].mean()
    matrix = _covariance(NOISES[place], SHIFTED[0])
    design = np.column_stack((np.ones(N), centred))
    product = (np.eye(N) - design @ np.linalg.pinv(design)) @ matrix
    trace = np.trace(product)
    expected = (
        trace,
        trace**2 / np.trace(product @ product),
        centred @ matrix @ centred / (centred @ centred) ** 2,
        np.trace(matrix) / N - matrix.mean(),
    )
    power, phi = NOISES[place]
    np.testing.assert_allclose(_moments(centred, (SHIFTED[0] + FLOOR) ** power, phi), expected, rtol=1e-9)


def test_with_white_noise_the_interval_is_that_of_a_fixed_design() -> None:
    """z = atanh r has the variance (1 − r² / 2) / n, with as many samples as here (delta method)."""
    random = np.random.default_rng(9)
    model = np.sin(np.linspace(0, 20, 2000))
    measured = model + random.standard_normal(2000)
    white = np.eye(len(NOISES))[min(range(len(NOISES)), key=lambda i: NOISES[i][0] + abs(NOISES[i][1]))]
    r = float(np.corrcoef(measured, model)[0, 1])
    half = np.diff(np.arctanh(correlation_interval(measured, model, white)))[0] / 2
    assert half == pytest.approx(1.96 * np.sqrt((1 - r**2 / 2) / 2000), rel=0.06)
