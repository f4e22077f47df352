"""Regression of EMG on a model's activation that is shifted by an unknown lag, with autocorrelated noise.

    e(t) = α + β a(t − τ) + ε(t),   ε Gaussian, standard deviation σ, autocorrelation φ^|i−j| between samples i and j

The prior is flat in α, β, log σ, √(1 − φ) and τ. α, β and σ are integrated in closed form, τ and φ on a grid:

    p(τ, φ | e) ∝ √(1 − φ²) |XᵀX|^(−1/2) S^(−(n−2)/2),   X the whitened [1, a(t − τ)], S the sum of squared residuals

(Zellner (1971), An Introduction to Bayesian Inference in Econometrics, ch. 4).

The correlation at a lag is estimated as Pearson's r, by ordinary least squares. The estimand is

    ρ = β s / √(β² s² + ω²),   ω² = σ² (1 − mean of R)

with s the standard deviation of a in the trial, R the noise's correlation matrix and ω² the variance that the noise is
expected to have about its own mean in a trial of this length. With the centred a and the matrix M that removes α and β,

    β̂ ~ N(β, σ² aᵀR a / (aᵀa)²),   Ŝ / (σ² tr MR) ~ χ²_ν / ν,   ν = (tr MR)² / tr (MR)²   (Satterthwaite (1946))

φ is drawn from its posterior, σ and β from these, which gives the interval of ρ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

AUTOCORRELATIONS: Array = 1.0 - np.linspace(1.4**0.5, 0.02**0.5, 19) ** 2
"""From the autocorrelation of sharply low-passed noise (−0.4) to a correlation time of 50 samples (0.98), evenly
spaced in √(1 − φ). Of the priors tried, flat in φ covered too seldom under slow noise, flat in log(1 − φ) too often."""
DRAWS = 4000


@dataclass(frozen=True, eq=False)
class EmgLagPosterior:
    """lags (k,) [s]; weight (autocorrelations, k), of sum 1."""

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
    for autocorrelation in AUTOCORRELATIONS:
        constant = _whitened(np.ones(samples), autocorrelation)
        response = _without(_whitened(measured, autocorrelation), constant)
        regressor = _without(_whitened(shifted, autocorrelation), constant)
        design = (regressor**2).sum(axis=1)
        residual = np.maximum(response @ response - (regressor @ response) ** 2 / design, np.finfo(float).tiny)
        logs.append(
            0.5 * np.log1p(-(autocorrelation**2))
            - 0.5 * np.log((constant @ constant) * design)
            - 0.5 * (samples - 2) * np.log(residual)
        )
    log = np.array(logs)
    weight = np.exp(log - log.max())
    return EmgLagPosterior(lags, weight / weight.sum())


def correlation_interval(measured: Array, activation: Array, weight: Array, seed: int = 0) -> tuple[float, float]:
    """2.5 and 97.5 % quantiles of ρ for measured EMG (n,) and activation (n,); weight (k,) of AUTOCORRELATIONS."""
    random = np.random.default_rng(seed)
    centred = activation - activation.mean()
    square = float(centred @ centred)
    slope = float(centred @ measured) / square
    residual = measured - measured.mean() - slope * centred
    moments = np.array([_moments(centred, autocorrelation) for autocorrelation in AUTOCORRELATIONS])
    trace, freedom, slope_variance, within = moments[random.choice(len(weight), DRAWS, p=weight)].T
    variance = float(residual @ residual) / trace * freedom / random.chisquare(freedom)
    slopes = slope + random.standard_normal(DRAWS) * np.sqrt(variance * slope_variance)
    explained = slopes * np.sqrt(square / len(measured))
    low, high = np.quantile(explained / np.sqrt(explained**2 + within * variance), (0.025, 0.975))
    return float(low), float(high)


def _moments(centred: Array, autocorrelation: float) -> tuple[float, float, float, float]:
    """tr MR, ν, aᵀR a / (aᵀa)² and 1 − mean of R; R is Toeplitz and never built."""
    samples = len(centred)
    column = autocorrelation ** np.arange(samples)
    pairs = np.concatenate(([samples], 2.0 * np.arange(samples - 1, 0, -1)))
    basis = np.column_stack((np.full(samples, samples**-0.5), centred / np.linalg.norm(centred)))
    product = scipy.linalg.matmul_toeplitz(column, basis)
    inner = basis.T @ product
    trace = samples - float(np.trace(inner))
    squared = float(pairs @ column**2) - 2.0 * float(np.sum(product**2)) + float(np.sum(inner**2))
    within = 1.0 - float(pairs @ column) / samples**2
    return trace, trace**2 / squared, float(inner[1, 1]) / float(centred @ centred), within


def _whitened(values: Array, autocorrelation: float) -> Array:
    """Innovations of values (…, n); their standard deviation is √(1 − φ²) times that of the values."""
    first = np.sqrt(1 - autocorrelation**2) * values[..., :1]
    return np.concatenate((first, values[..., 1:] - autocorrelation * values[..., :-1]), axis=-1)


def _without(values: Array, constant: Array) -> Array:
    """Component of values (…, n) orthogonal to the constant (n,)."""
    return values - (values @ constant)[..., None] / (constant @ constant) * constant
