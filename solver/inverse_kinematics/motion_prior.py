"""How smooth each coordinate moves: the order of its white derivative and the intensity, with their uncertainty.

Third derivative white (jerk) or fourth (snap): whichever makes the record likelier. The intensity is not known exactly
either, so intervals are those of the mixture over the intensities that the record admits. A plug-in estimate alone
gives intervals that are too narrow in short records (Kass, Steffey, J. Am. Stat. Assoc. 84:717, 1989).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

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
        from solver.inverse_kinematics.scalar_smoother import smooth_scalar  # the compiler takes a while to import

        if at not in self._found:
            none = np.zeros((0, self.order))
            drive = np.exp(self._grid[at]) * self._drive
            found = smooth_scalar(self._values, self._variances, self._step, drive, self._start, none, none)
            self._found[at] = found if np.isfinite(found) else -np.inf
        return self._found[at]

    def _smooth(self, at: int) -> tuple[Array, Array]:
        from solver.inverse_kinematics.scalar_smoother import smooth_scalar

        means, spread = np.zeros((2, len(self._values), self.order))
        drive = np.exp(self._grid[at]) * self._drive
        smooth_scalar(self._values, self._variances, self._step, drive, self._start, means, spread)
        return means[:, :3], np.maximum(spread[:, :3], 0.0)
