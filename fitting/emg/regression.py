"""Regression of EMG on a model's activation that is shifted by an unknown lag, with autocorrelated noise.

    e(t) = α + β a(t − τ) + g(t) ε(t),   g = (a(t − τ) + FLOOR)^p

ε is Gaussian with standard deviation σ and autocorrelation φ^|i−j| between samples i and j. The noise of an envelope is
proportional to its level (p = 1), other differences from the model are not (p = 0); p is selected by the record.

The prior is flat in α, β, log σ, √(1 − φ), p and τ. α, β and σ are integrated in closed form, τ, φ and p on a grid:

    p(τ, φ, p | e) ∝ √(1 − φ²) Π 1/g |XᵀX|^(−1/2) S^(−(n−2)/2),   X the whitened [1, a(t − τ)]/g, S the sum of squared
    residuals (Zellner (1971), An Introduction to Bayesian Inference in Econometrics, ch. 4)

The correlation at a lag is estimated as Pearson's r, by ordinary least squares. The estimand is

    ρ = β s / √(β² s² + ω²),   ω² = σ² (mean of the diagonal of R − mean of R)

with s the standard deviation of a in the trial, R the noise's covariance matrix over σ² and ω² the variance that the
noise is expected to have about its own mean in a trial of this length. With the centred a and the matrix M that removes
α and β,

    β̂ ~ N(β, σ² aᵀR a / (aᵀa)²),   Ŝ / (σ² tr MR) ~ χ²_ν / ν,   ν = (tr MR)² / tr (MR)²   (Satterthwaite (1946))

φ and p are drawn from their posterior, σ and β from these, which gives the interval of ρ.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

AUTOCORRELATIONS: Array = 1.0 - np.linspace(1.4**0.5, 0.02**0.5, 19) ** 2
"""From the autocorrelation of sharply low-passed noise (−0.4) to a correlation time of 50 samples (0.98), evenly
spaced in √(1 − φ). Of the priors tried, flat in φ covered too seldom under slow noise, flat in log(1 − φ) too often."""
POWERS, FLOOR = (0.0, 0.5, 1.0), 0.05
"""Powers p of the level to which the noise is proportional, and the level of a muscle at rest over the largest."""
NOISES = tuple(product(POWERS, AUTOCORRELATIONS.tolist()))
DRAWS = 4000


@dataclass(frozen=True, eq=False)
class EmgLagPosterior:
    """lags (k,) [s]; weight (noises, k) over NOISES, of sum 1."""

    lags: Array
    weight: Array

    def quantiles(self, levels: tuple[float, ...]) -> Array:
        """Quantiles of the lag [s]."""
        over_lags = self.weight.sum(axis=0)
        return np.interp(levels, np.cumsum(over_lags) - 0.5 * over_lags, self.lags)


def lag_posterior(measured: Array, shifted: Array, lags: Array) -> EmgLagPosterior:
    """Posterior of the lag for measured EMG (n,) and the activation at every lag, shifted (k, n); lags (k,) [s]."""
    samples = len(measured)
    logs = []
    for power, autocorrelation in NOISES:
        size = _noise_size(shifted, power)
        constant = _whitened(1 / size, autocorrelation)
        response = _without(_whitened(measured / size, autocorrelation), constant)
        regressor = _without(_whitened(shifted / size, autocorrelation), constant)
        design, overlap = (regressor**2).sum(axis=1), (regressor * response).sum(axis=1)
        residual = np.maximum((response**2).sum(axis=1) - overlap**2 / design, np.finfo(float).tiny)
        logs.append(
            0.5 * np.log1p(-(autocorrelation**2))
            - np.log(size).sum(axis=1)
            - 0.5 * np.log((constant**2).sum(axis=1) * design)
            - 0.5 * (samples - 2) * np.log(residual)
        )
    log = np.array(logs)
    weight = np.exp(log - log.max())
    return EmgLagPosterior(lags, weight / weight.sum())


def correlation_interval(measured: Array, activation: Array, weight: Array, seed: int = 0) -> tuple[float, float]:
    """2.5 and 97.5 % quantiles of ρ for measured EMG (n,) and activation (n,); weight (noises,) of NOISES."""
    random = np.random.default_rng(seed)
    centred = activation - activation.mean()
    square = float(centred @ centred)
    slope = float(centred @ measured) / square
    residual = measured - measured.mean() - slope * centred
    moments = np.array([_moments(centred, _noise_size(activation, power), one) for power, one in NOISES])
    trace, freedom, slope_variance, within = moments[random.choice(len(weight), DRAWS, p=weight)].T
    variance = float(residual @ residual) / trace * freedom / random.chisquare(freedom)
    slopes = slope + random.standard_normal(DRAWS) * np.sqrt(variance * slope_variance)
    explained = slopes * np.sqrt(square / len(measured))
    low, high = np.quantile(explained / np.sqrt(explained**2 + within * variance), (0.025, 0.975))
    return float(low), float(high)


def _noise_size(activation: Array, power: float) -> Array:
    """g (…, n) for activations (…, n) scaled from 0 to 1."""
    return np.asarray((np.clip(activation, 0.0, None) + FLOOR) ** power)


def _moments(centred: Array, size: Array, autocorrelation: float) -> tuple[float, float, float, float]:
    """tr MR, ν, aᵀR a / (aᵀa)² and the mean of the diagonal of R less the mean of R.

    R is a Toeplitz matrix between two diagonal ones of g, and never built.
    """
    samples = len(centred)
    column, variances = autocorrelation ** np.arange(samples), size**2
    basis = np.column_stack((np.full(samples, samples**-0.5), centred / np.linalg.norm(centred)))
    product_with_basis = size[:, None] * scipy.linalg.matmul_toeplitz(column, size[:, None] * basis)
    inner = basis.T @ product_with_basis
    trace = float(variances.sum()) - float(np.trace(inner))
    squared = float(variances @ scipy.linalg.matmul_toeplitz(column**2, variances))
    squared += float(np.sum(inner**2)) - 2.0 * float(np.sum(product_with_basis**2))
    within = float(variances.mean()) - float(size @ scipy.linalg.matmul_toeplitz(column, size)) / samples**2
    return trace, trace**2 / squared, float(inner[1, 1]) / float(centred @ centred), within


def _whitened(values: Array, autocorrelation: float) -> Array:
    """Innovations of values (…, n); their standard deviation is √(1 − φ²) times that of the values."""
    first = np.sqrt(1 - autocorrelation**2) * values[..., :1]
    return np.concatenate((first, values[..., 1:] - autocorrelation * values[..., :-1]), axis=-1)


def _without(values: Array, constant: Array) -> Array:
    """Component of values (k, n) orthogonal to the constants (k, n)."""
    along = (values * constant).sum(axis=1, keepdims=True) / (constant**2).sum(axis=1, keepdims=True)
    return np.asarray(values - along * constant)
