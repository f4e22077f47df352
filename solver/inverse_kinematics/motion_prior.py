"""How smooth each coordinate moves: the order of its white derivative and the intensity, with their uncertainty.

Third derivative white (jerk) or fourth (snap): whichever makes the record likelier. The intensity is not known exactly
either, so intervals are those of the mixture over the intensities that the record admits. A plug-in estimate alone
gives intervals that are too narrow in short records (Kass, Steffey, J. Am. Stat. Assoc. 84:717, 1989).

smooth_scalar smooths one such coordinate and gives its likelihood: the Kalman filter, and the smoother of Bryson and
Frazier, which inverts no covariance (Durbin, Koopman, Time Series Analysis by State Space Methods, 2012, ch. 4.3 and
4.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python, compiled_with_allocation

Array = NDArray[np.float64]

ORDERS = (3, 4)
START_SD = (0.3, 2.0, 10.0, 60.0)
"""Of q, q̇, q̈ and the third derivative before the first frame [rad or m, s]."""
LEAST_SD = 1e-6
"""rad or m; added to the standard deviation of postures, for coordinates that constraints determine exactly."""
LOWEST, HIGHEST, SPACING = -18.0, 32.0, 0.8
"""Of the logarithm of the intensity [rad² or m², s]."""
WORTHWHILE = 5.0
"""Of the log-likelihood, below the highest; less likely intensities do not count."""
SKIPPED = 6  # observations that the likelihood leaves to the wide start, the same for every order


@dataclass(frozen=True, eq=False)
class MotionPrior:
    """How smooth each coordinate moves.

    order      (coordinates,) of the white derivative;  intensity (coordinates,) [rad² or m² / s^(2 order − 1)]
    standard_deviations   (3, frames, coordinates) of q, q̇, q̈ from the coordinate's own record, over all intensities
                          that it admits; infinite for a coordinate that is never determined
    """

    order: NDArray[np.int64]
    intensity: Array
    standard_deviations: Array


def transition(order: int, interval: float) -> tuple[Array, Array]:
    """Transition and covariance per unit of intensity of a step; both (order, order), of q and its derivatives."""
    step, drive = np.zeros((order, order)), np.zeros((order, order))
    for i in range(order):
        for j in range(order):
            if j >= i:
                step[i, j] = interval ** (j - i) / factorial(j - i)
            a, b = order - 1 - i, order - 1 - j
            drive[i, j] = interval ** (a + b + 1) / (factorial(a) * factorial(b) * (a + b + 1))
    return step, drive


def fit_motion_prior(values: Array, variances: Array, interval: float) -> MotionPrior:
    """Fit each coordinate by itself. values, variances (frames, coordinates) of postures found frame by frame, NaN
    where a coordinate is not determined; one that never is gets the lowest intensity.
    """
    frames, count = values.shape
    order, intensity = np.full(count, ORDERS[0]), np.full(count, np.exp(LOWEST))
    deviations = np.full((3, frames, count), np.inf)
    for k in range(count):
        known = np.isfinite(values[:, k])
        if known.sum() > 2 * max(ORDERS):
            moved = values[:, k] - values[known, k][0]
            candidates = [_Candidate(moved, variances[:, k] + LEAST_SD**2, interval, tried) for tried in ORDERS]
            best = max(candidates, key=lambda candidate: candidate.highest)
            order[k], intensity[k] = best.order, best.intensity
            deviations[:, :, k] = _mixed(candidates, best.highest).T
    return MotionPrior(order, intensity, deviations)


def _mixed(candidates: list[_Candidate], highest: float) -> Array:
    """(frames, 3) standard deviation of the mixture over orders and intensities."""
    states = [state for candidate in candidates for state in candidate.states(highest)]
    weights = np.array([weight for weight, _, _ in states])[:, None, None] / sum(weight for weight, _, _ in states)
    means, spreads = np.array([means for _, means, _ in states]), np.array([spread for _, _, spread in states])
    mean = (weights * means).sum(axis=0)
    deviation: Array = np.sqrt((weights * (spreads + (means - mean) ** 2)).sum(axis=0))
    return deviation


class _Candidate:
    """A coordinate with a white derivative of one order, over a grid of intensities."""

    def __init__(self, values: Array, variances: Array, interval: float, order: int) -> None:
        self.order = order
        self._values, self._variances = np.ascontiguousarray(values), np.ascontiguousarray(variances)
        self._step, self._drive = transition(order, interval)
        self._start = np.diag(np.square(START_SD[:order]))
        self._grid = np.arange(LOWEST, HIGHEST, SPACING)
        self._found: dict[int, float] = {}
        at = max(range(0, len(self._grid), 6), key=self._likelihood)
        while (beside := max(self._around(at), key=self._likelihood)) != at:
            at = beside
        self._at, self.highest = at, self._likelihood(at)
        self.intensity = float(np.exp(self._grid[at]))

    def states(self, highest: float) -> list[tuple[float, Array, Array]]:
        """Weight, means and variances (frames, 3) of q, q̇, q̈ at every intensity whose likelihood counts."""
        found = [at for at in self._worthwhile() if self._likelihood(at) > highest - WORTHWHILE]
        return [(float(np.exp(self._likelihood(at) - highest)), *self._smooth(at)) for at in found]

    def _worthwhile(self) -> list[int]:
        kept = [self._at]
        for direction in (-1, 1):
            at = self._at + direction
            while 0 <= at < len(self._grid) and self._likelihood(at) > self.highest - WORTHWHILE:
                kept.append(at)
                at += direction
        return kept

    def _around(self, at: int) -> list[int]:
        return [at, *(beside for beside in (at - 1, at + 1) if 0 <= beside < len(self._grid))]

    def _likelihood(self, at: int) -> float:

        if at not in self._found:
            none = np.zeros((0, self.order))
            drive = np.exp(self._grid[at]) * self._drive
            found = smooth_scalar(self._values, self._variances, self._step, drive, self._start, none, none)
            self._found[at] = found if np.isfinite(found) else -np.inf
        return self._found[at]

    def _smooth(self, at: int) -> tuple[Array, Array]:

        means, spread = np.zeros((2, len(self._values), self.order))
        drive = np.exp(self._grid[at]) * self._drive
        smooth_scalar(self._values, self._variances, self._step, drive, self._start, means, spread)
        return means[:, :3], np.maximum(spread[:, :3], 0.0)


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
