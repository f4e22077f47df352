"""One coordinate whose p-th derivative is white noise, seen with noise: likelihood and smoothing; compiled.

The Kalman filter, and the smoother of Bryson and Frazier, which inverts no covariance (Durbin, Koopman, Time Series
Analysis by State Space Methods, 2012, ch. 4.3 and 4.4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python, compiled_with_allocation

Array = NDArray[np.float64]

SKIPPED = 6  # observations that the likelihood leaves to the wide start, the same for every order


@compiled_for_python
def smooth_scalar(
    values: Array, variances: Array, step: Array, drive: Array, start: Array, means: Array, spread: Array
) -> float:
    """Fill means and spread (frames, order) with the smoothed state and its variances; return the log-likelihood.

    values, variances (frames,) of the observations, NaN where there is none; step, drive, start (order, order): the
    transition, the covariance that a step adds, and that before the first frame. means may have no rows: then only the
    likelihood is computed.
    """
    frames, order = len(values), len(step)
    mean, cov, work, other = np.zeros(order), start.copy(), np.zeros((order, order)), np.zeros((order, order))
    kept = frames if len(means) else 0
    ahead, covs, gains = np.zeros((kept, order)), np.zeros((kept, order, order)), np.zeros((kept, order))
    errors = np.zeros((kept, 2))
    likelihood, seen = 0.0, 0
    for k in range(frames):
        if k:
            _advance(step, drive, mean, cov, work, other)
        if kept:
            ahead[k] = mean
            covs[k] = cov
        if np.isfinite(values[k]):
            total, error = cov[0, 0] + variances[k], values[k] - mean[0]
            if seen >= SKIPPED:
                likelihood -= 0.5 * (np.log(total) + error * error / total)
            seen += 1
            _update(error, total, mean, cov, work[0], other)
            if kept:
                gains[k] = work[0]
                errors[k, 0], errors[k, 1] = error, total
    if kept:
        _return(step, ahead, covs, gains, errors, means, spread)
    return likelihood


@compiled
def _update(error: float, total: float, mean: Array, cov: Array, gain: Array, other: Array) -> None:
    """Fill gain; mean and covariance after an observation of the first entry."""
    order = len(mean)
    for i in range(order):
        gain[i] = cov[i, 0] / total
        mean[i] += gain[i] * error
    for i in range(order):
        for j in range(order):
            other[i, j] = cov[i, j] - gain[i] * cov[0, j]
    for i in range(order):
        for j in range(order):
            cov[i, j] = 0.5 * (other[i, j] + other[j, i])


@compiled
def _advance(step: Array, drive: Array, mean: Array, cov: Array, work: Array, other: Array) -> None:
    """Mean and covariance one frame ahead."""
    order = len(step)
    for i in range(order):
        work[0, i] = 0.0
        for j in range(i, order):
            work[0, i] += step[i, j] * mean[j]
    for i in range(order):
        mean[i] = work[0, i]
    for i in range(order):
        for j in range(order):
            other[i, j] = 0.0
            for k in range(i, order):
                other[i, j] += step[i, k] * cov[k, j]
    for i in range(order):
        for j in range(order):
            cov[i, j] = drive[i, j]
            for k in range(j, order):
                cov[i, j] += other[i, k] * step[j, k]


@compiled_with_allocation
def _return(step: Array, ahead: Array, covs: Array, gains: Array, errors: Array, means: Array, spread: Array) -> None:
    """Backwards: r and N gather what later observations add."""
    frames, order = ahead.shape
    r, N = np.zeros(order), np.zeros((order, order))
    work, other = np.zeros(order), np.zeros((order, order))
    for k in range(frames - 1, -1, -1):
        if errors[k, 1] > 0.0:
            _observe(gains[k], errors[k, 0], errors[k, 1], r, N, other)
        for i in range(order):
            means[k, i], spread[k, i] = ahead[k, i], covs[k, i, i]
            for j in range(order):
                means[k, i] += covs[k, i, j] * r[j]
                for m in range(order):
                    spread[k, i] -= covs[k, i, j] * N[j, m] * covs[k, m, i]
        for i in range(order):
            work[i] = 0.0
            for j in range(i + 1):
                work[i] += step[j, i] * r[j]
            for j in range(order):
                other[i, j] = 0.0
                for m in range(i + 1):
                    other[i, j] += step[m, i] * N[m, j]
        for i in range(order):
            r[i] = work[i]
            for j in range(order):
                N[i, j] = 0.0
                for m in range(j + 1):
                    N[i, j] += other[i, m] * step[m, j]


@compiled
def _observe(gain: Array, error: float, total: float, r: Array, N: Array, other: Array) -> None:
    """r becomes Lᵀ r + e/S and N becomes Lᵀ N L + 1/S in the first entry, L = I − K (1 0 …)."""
    order = len(r)
    along = 0.0
    for i in range(order):
        along += gain[i] * r[i]
    r[0] += error / total - along
    for i in range(order):
        other[0, i] = 0.0
        for j in range(order):
            other[0, i] += gain[j] * N[j, i]
    inner = 0.0
    for i in range(order):
        inner += other[0, i] * gain[i]
    for i in range(order):
        N[0, i] -= other[0, i]
        N[i, 0] -= other[0, i]
    N[0, 0] += inner + 1.0 / total
