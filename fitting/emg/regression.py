"""Regression of EMG on a model's activation that is shifted by an unknown lag, with autocorrelated noise.

    e(t) = α + β a(t − τ) + ε(t),   Cov ε = σ² V,   V = (1 − λ) G R G + λ D²

R is the correlation of the model error with the time ℓ: Matérn's of order 1/2, exp(−|t − t'| / ℓ), or of order 5/2,
whose power decreases faster above the frequency 1/ℓ. G² = (1 − κ) + κ D² is its size, of which the part κ is
proportional to the level. D is the level, with a mean square of 1: the envelope of a random signal varies about its
mean by white noise that is proportional to its level.

α, β and τ are estimated by least squares, whose weights do not depend on the noise. Generalised least squares is more
precise if the noise is as modelled; in measured EMG it is not, and then a small noise near rest or at high frequencies
lets the onset alone decide the lag. λ, R and κ have a prior on a grid and the restricted likelihood of the residuals
at the least-squares lag. For each of them the likelihood of the lag under white noise is raised to a power so
that its curvature is that of the variance under V (Ribatet, Cooley and Davison (2012), Statistica Sinica 22:813–845):

    p(τ | e, V) ∝ S(τ)^(−m / 2),   m = (n − 2) / r,   r = uᵀV u (n − 3) / tr MV

with S the sum of squared residuals at a lag, M the matrix that removes 1, a and its derivative a', and u the unit
vector along the part of a' that 1 and a leave. m is the effective number of samples. The search bounds the lag.

A gain that drifts is slow noise proportional to the level (the largest κ). Its power at the frequencies of the movement
does not show in the residuals, because the lag takes it up. It is known with DRIFT_FREEDOM degrees of freedom at most:

    p(τ | e, V) ∝ (1 + m (S(τ) / S(τ̂) − 1) / ν)^(−ν / 2),   1/ν = 1/m + 1/DRIFT_FREEDOM

The correlation at a lag is estimated as Pearson's r. The estimand is

    ρ = β s / √(β² s² + ω²),   ω² = σ² (mean of the diagonal of V − mean of V)

with s the standard deviation of a in the trial and ω² the variance that the noise is expected to have about its own
mean in a trial of this length. With the centred a and the matrix M that removes α and β,

    β̂ ~ N(β, σ² aᵀV a / (aᵀa)²),   Ŝ / (σ² tr MV) ~ χ²_ν / ν,   ν = (tr MV)² / tr (MV)²   (Satterthwaite (1946))

Noise and lag are drawn from their posterior, σ and β from these, which gives the interval of ρ. The size of slow noise
may vary between movements, which one movement does not show: 1/ν is larger by 1/DRIFT_FREEDOM under a gain drift, and
by 1/SIZE_FREEDOM under other slow noise (docs/emg.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

WHITE_PARTS = (0.02, 0.1, 0.3, 0.6, 1.0)
"""λ: part of the variance that is the envelope's own."""
ORDERS = (0.5, 2.5)
"""ν of Matérn's correlation: exponential, and smooth."""
CORRELATION_TIMES_S = (0.02, 0.12, 0.24, 0.5, 1.0, 2.0, 4.0)
"""ℓ: from white noise to the duration of a movement."""
PROPORTIONAL_PARTS = (0.0, 0.95)
"""κ: a disagreement that vanishes at rest would make the samples at rest decide the lag."""
NOISES = tuple(product(WHITE_PARTS, ORDERS, CORRELATION_TIMES_S, PROPORTIONAL_PARTS))
"""λ, order, ℓ and κ."""
DISTINCT = np.minimum(np.arange(len(NOISES)), NOISES.index((1.0, *NOISES[0][1:])))
"""Place of the first noise that is the same: with λ = 1 all are."""
PRIOR: Array = np.array(
    [
        (time / CORRELATION_TIMES_S[0]) ** (-0.5 if (order, proportional) == (0.5, 0.0) else -2.0)
        for _, order, time, proportional in NOISES
    ]
)
"""Exponential noise of one size: flat in √(1 − φ) for the autocorrelation φ of slow noise between two samples,
1 − φ ∝ 1/ℓ. Smooth or proportional noise shows in the residuals unless it is small, and its prior decreases faster."""
REST = 0.05
"""Level of a muscle at rest over the range of its level; the offset of EMG is not known."""
DRAWS = 4000
SLOW_S = 0.24
"""Least ℓ of noise whose size may vary between movements; the noise of muscle and amplifier is faster."""
IS_SLOW = np.array([time >= SLOW_S and white < 1.0 for white, _, time, _ in NOISES])
SIZE_FREEDOM = 24.0
"""Degrees of freedom of a size that varies: a coefficient of variation of 29 % of σ²."""
IS_GAIN_DRIFT = IS_SLOW & np.array([proportional == PROPORTIONAL_PARTS[-1] for *_, proportional in NOISES])
TRANSITION: Array = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
"""Of the state of the Kalman filter over an interval, but for the decay."""
DERIVATIVES_COVARIANCE: Array = np.array([[1, 0, -1 / 3], [0, 1 / 3, 0], [-1 / 3, 0, 1]])
"""Of a process of order 5/2 and unit variance, its first derivative over a = √5/ℓ and its second over a²."""
DRIFT_FREEDOM = 6.0
"""Chosen with PRIOR and SIZE_FREEDOM on 200 to 300 simulated pairs of each noise, judged on others (docs/emg.md)."""
FINER = 20
"""Quantiles of the lag are found on a grid finer by this factor: an interval may be as narrow as two of its steps."""


@dataclass(frozen=True, eq=False)
class EmgLagPosterior:
    """lags (k,) [s]; weight (noises, k) over NOISES, of sum 1."""

    lags: Array
    weight: Array

    def quantiles(self, levels: tuple[float, ...]) -> Array:
        """Quantiles of the lag [s]."""
        logs = np.log(np.maximum(self.weight.sum(axis=0), np.finfo(float).tiny))
        lags = np.linspace(self.lags[0], self.lags[-1], FINER * (len(self.lags) - 1) + 1)
        density = np.exp(scipy.interpolate.CubicSpline(self.lags, logs)(lags))
        return np.interp(levels, (np.cumsum(density) - 0.5 * density) / density.sum(), lags)


def lag_posterior(measured: Array, shifted: Array, lags: Array, interval: float) -> EmgLagPosterior:
    """Posterior of the lag for measured EMG (n,) and the activation at every lag, shifted (k, n), scaled from 0 to 1.

    lags (k,) and interval between samples [s].
    """
    samples = len(measured)
    squares = _squares(measured, shifted)
    best = int(squares.argmin())
    before, after = max(best - 1, 0), min(best + 1, len(lags) - 1)
    derivative = (shifted[after] - shifted[before]) / (lags[after] - lags[before])
    design = np.column_stack((np.ones(samples), shifted[best], derivative))
    variances = _variances(shifted[best])
    basis = np.linalg.qr(design)[0].T
    sizes, products = _smooth_products(basis, variances, interval)
    inner = _mixed(basis @ products.mT, basis @ (variances * basis).T)
    trace = _mixed(sizes.sum(axis=1), variances.sum()) - np.trace(inner, axis1=1, axis2=2)
    effective = trace / inner[:, 2, 2] * (samples - 2) / (samples - 3)
    freedom = 1 / (1 / effective + IS_GAIN_DRIFT / DRIFT_FREEDOM)
    log = -0.5 * freedom[:, None] * np.log1p(np.multiply.outer(effective / freedom, squares / squares[best] - 1))
    weight = np.exp(log) / np.exp(log).sum(axis=1, keepdims=True)
    probability = _restricted_likelihood(measured, design, variances, interval) * PRIOR
    return EmgLagPosterior(lags, weight * (probability / probability.sum())[:, None])


def correlation_interval(
    measured: Array, shifted: Array, weight: Array, place: int, interval: float
) -> tuple[float, float]:
    """2.5 and 97.5 % quantiles of ρ for measured EMG (n,) and activation at some lags, shifted (k, n).

    weight (noises, k) over NOISES; place is that of the reported lag, at which the noise is evaluated.
    """
    random = np.random.default_rng(0)
    centred = shifted - shifted.mean(axis=1, keepdims=True)
    square = (centred**2).sum(axis=1)
    noise, lag = np.unravel_index(random.choice(weight.size, DRAWS, p=weight.ravel()), weight.shape)
    variances = _variances(shifted[place])
    trace, freedom, slope_variance, within = _moments(centred[place], variances, interval)[:, noise]
    freedom = 1 / (1 / freedom + np.where(IS_GAIN_DRIFT, 1 / DRIFT_FREEDOM, IS_SLOW / SIZE_FREEDOM)[noise])
    variance = _squares(measured, shifted)[lag] / trace * freedom / random.chisquare(freedom)
    slopes = (centred @ measured / square)[lag] + random.standard_normal(DRAWS) * np.sqrt(variance * slope_variance)
    explained = slopes * np.sqrt(square[lag] / len(measured))
    low, high = np.quantile(explained / np.sqrt(explained**2 + within * variance), (0.025, 0.975))
    return float(low), float(high)


def _squares(measured: Array, shifted: Array) -> Array:
    """Sum of squared residuals (k,) of the regression on the activation (k, n) at every lag, above 0."""
    centred = shifted - shifted.mean(axis=1, keepdims=True)
    response = measured - measured.mean()
    explained = (centred @ response) ** 2 / (centred**2).sum(axis=1)
    return np.asarray(np.maximum(response @ response - explained, np.finfo(float).eps * (response @ response)))


def _variances(activation: Array) -> Array:
    """Diagonal (n,) of D² for an activation scaled from 0 to 1."""
    square = (np.clip(activation, 0.0, None) + REST) ** 2
    return np.asarray(square / square.mean())


def _moments(centred: Array, variances: Array, interval: float) -> Array:
    """tr MV, ν, aᵀV a / (aᵀa)² and the mean of the diagonal of V less the mean of V, (4, noises)."""
    samples = len(centred)
    basis = np.array((np.full(samples, samples**-0.5), centred / np.linalg.norm(centred)))
    own = variances * basis
    sizes, products = _smooth_products(basis, variances, interval)
    inner = _mixed(basis @ products.mT, basis @ own.T)
    diagonal = _mixed(sizes.sum(axis=1), variances.sum())
    trace = diagonal - np.trace(inner, axis1=1, axis2=2)
    # tr V² − 2 Σ (V times the basis)², quadratic in λ
    smooth = np.sum(sizes * _times_correlation(sizes, interval, power=2), axis=2) - 2.0 * np.sum(
        products**2, axis=(2, 3)
    )
    both = sizes @ variances - 2.0 * np.sum(products * own, axis=(2, 3))
    white = np.reshape(WHITE_PARTS, (-1, 1, 1))
    quadratic = (1 - white) ** 2 * smooth + 2 * white * (1 - white) * both
    quadratic += white**2 * (variances @ variances - 2.0 * np.sum(own**2))
    squared = quadratic.ravel() + np.sum(inner**2, axis=(1, 2))
    within = (diagonal - inner[:, 0, 0]) / samples
    return np.array((trace, trace**2 / squared, inner[:, 1, 1] / (centred @ centred), within))


def _smooth_products(vectors: Array, variances: Array, interval: float) -> tuple[Array, Array]:
    """Diagonal (κ, n) of G², and G R G times vectors (k, n), (R, κ, k, n)."""
    sizes = 1.0 + np.multiply.outer(PROPORTIONAL_PARTS, variances - 1.0)
    roots = np.sqrt(sizes)[:, None]
    return sizes, roots * _times_correlation(roots * vectors, interval)


def _times_correlation(vectors: Array, interval: float, power: int = 1) -> Array:
    """R, or its elements to the power, times vectors (…, n) for every R, (R, …, n).

    A Toeplitz matrix as part of a circulant one, by FFT.
    """
    samples = vectors.shape[-1]
    length = scipy.fft.next_fast_len(2 * samples - 1, real=True)
    spectra = _spectra(length, interval, power)
    spectra = spectra.reshape(-1, *(1,) * (vectors.ndim - 1), spectra.shape[1])
    return np.asarray(scipy.fft.irfft(spectra * scipy.fft.rfft(vectors, length), length)[..., :samples])


@lru_cache(maxsize=4)
def _spectra(length: int, interval: float, power: int) -> NDArray[np.complex128]:
    """(R, frequencies) of the circulant matrices."""
    ratio = np.divide.outer(interval * np.minimum(np.arange(length), length - np.arange(length)), CORRELATION_TIMES_S).T
    scaled = np.sqrt(5) * ratio
    rough, smooth = np.exp(-ratio), (1 + scaled + scaled**2 / 3) * np.exp(-scaled)
    return np.asarray(scipy.fft.rfft(np.concatenate((rough, smooth)) ** power))


def _mixed(smooth: Array, own: Array) -> Array:
    """(1 − λ) smooth + λ own over NOISES (noises, …), of smooth (R, κ, …) or (κ, …) and own (…)."""
    white = np.reshape(WHITE_PARTS, (-1, 1, 1, *(1,) * own.ndim))
    correlations = len(ORDERS) * len(CORRELATION_TIMES_S)
    shape = (len(WHITE_PARTS), correlations, len(PROPORTIONAL_PARTS), *own.shape)
    return np.broadcast_to((1 - white) * smooth + white * own, shape).reshape(len(NOISES), *own.shape)


def _restricted_likelihood(measured: Array, design: Array, variances: Array, interval: float) -> Array:
    """|V|^(−1/2) |XᵀV⁻¹X|^(−1/2) S^(−(n−3)/2) over NOISES, of maximum 1; X is the design (n, 3)."""
    samples, terms = design.shape
    innovations, variance = _innovations(np.column_stack((design, measured)), variances, interval)
    whitened = innovations / np.sqrt(variance)[:, None]
    roots = np.linalg.qr(np.moveaxis(whitened, 2, 0), mode="r")
    log_sizes = np.log(np.abs(np.diagonal(roots, axis1=1, axis2=2)))  # the last is √S
    logs = -0.5 * np.log(variance).sum(axis=0) - log_sizes[:, :terms].sum(axis=1)
    logs -= (samples - terms) * log_sizes[:, terms]
    return np.asarray(np.exp(logs - logs.max()))[DISTINCT]


def _innovations(columns: Array, variances: Array, interval: float) -> tuple[Array, Array]:
    """Innovations (n, columns, noises) of columns (n, columns), and their variance (n, noises), whose product is |V|;
    over the distinct noises.

    A Kalman filter (J. Hartikainen and S. Särkkä, IEEE MLSP, 379-384, 2010). With Δ the interval and a the rate at
    which the process f decays, the state (3,) is f, Δ (d/dt + a) f and Δ² (d/dt + a)² f: all noises have the same
    transition but for the factor exp(−aΔ). Rows (3 · (3 + columns), noises): for each element of the state, its
    covariances and its mean for every column; both are corrected by one gain.
    """
    white, *_, proportional = np.array(NOISES[: DISTINCT[-1] + 1]).T
    sizes = np.sqrt((1 - white) * ((1 - proportional) + proportional * variances[:, None]))
    own = white * variances[:, None]
    count = columns.shape[1]
    rows, change, decays, added = _transition(interval, count)
    observed = np.pad(columns, ((0, 0), (3, 0)))[:, :, None]
    innovations, variance = np.empty((len(columns), count, len(white))), np.empty_like(sizes)
    correction = np.empty((3, 3 + count, len(white)))
    for i, size in enumerate(sizes):
        error = observed[i] - size * rows[: 3 + count]
        variance[i] = own[i] - size * error[0]
        innovations[i] = error[3:]
        np.multiply((error[:3] / variance[i])[:, None], error, out=correction)
        rows = change @ (rows - correction.reshape(rows.shape))
        rows *= decays
        rows += added
    return innovations, variance


@lru_cache(maxsize=4)
def _transition(interval: float, columns: int) -> tuple[Array, Array, Array, Array]:
    """Rows without observations; their change over an interval [s] without the decay, the decay, and what is added."""
    x = np.sqrt(5) * interval / np.array(CORRELATION_TIMES_S)
    zero, one = np.zeros_like(x), np.ones_like(x)
    by_derivatives = np.array([[one, zero, zero], [x, x, zero], [x**2, 2 * x**2, x**2]])  # of f, f'/a and f''/a²
    smooth = np.einsum("ikn,kl,jln->ijn", by_derivatives, DERIVATIVES_COVARIANCE, by_derivatives)
    rough = np.zeros_like(smooth)
    rough[0, 0] = 1.0  # with an exponential correlation, f has no derivatives
    covariance, decay = (
        _of_noises(np.concatenate((rough, smooth), axis=2)),
        _of_noises(np.exp(-np.concatenate((x / np.sqrt(5), x)))),
    )
    change = np.kron(TRANSITION, scipy.linalg.block_diag(TRANSITION, np.eye(columns))).astype(np.float64)
    decays: Array = np.tile(np.repeat([decay**2, decay], [3, columns], axis=0), (3, 1))
    rows: Array = np.pad(covariance, ((0, 0), (0, columns), (0, 0))).reshape(decays.shape)
    return rows, change, decays, rows - decays * (change @ rows)


def _of_noises(values: Array) -> Array:
    """Values (…, R) for every distinct noise (…, noises)."""
    places = [
        ORDERS.index(order) * len(CORRELATION_TIMES_S) + CORRELATION_TIMES_S.index(time) for _, order, time, _ in NOISES
    ]
    return values[..., places[: DISTINCT[-1] + 1]]
