"""Output error: the measured force drives m ẍ + c ẋ + k x = F − F0 − F1 u, and x is fitted to the markers.

The method needs no spline and no weights between the instruments, and its covariance allows coloured residuals, by an
autoregressive model. So it is used if the marker noise is correlated in time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.dynamic.swing import Swing
from fitting.results.outcome import FitOutcome
from fitting.uncertainty import Estimate, normal_estimate

SETTLING = 0.5
"""Seconds left out at the start, because the simulation starts at rest under the first force."""
STEP = 0.01
ORDER = 8
"""Order of the autoregressive model of the residuals."""
OUTLIER = 5.0
ROUNDS = 20
HIGHEST = 10.0
SWING_POWER, CUTOFF_FACTOR = 0.95, 3.0
"""The force is low-pass filtered at three times the frequency below which 95 % of its power lie, at most 10 Hz, because
noise at the resonance of the model would bias the damping."""


@dataclass(frozen=True)
class OutputErrorFit:
    """k [N/m] and c [N s/m] of a record for a known lag; both None unless the outcome is CONVERGED.

    The outcome is NO_SOLUTION if no k, c > 0 describe the swing.
    """

    outcome: FitOutcome
    stiffness: Estimate | None = None
    damping: Estimate | None = None

    @property
    def estimates(self) -> tuple[Estimate, Estimate] | None:
        """k and c, or None."""
        return None if self.stiffness is None or self.damping is None else (self.stiffness, self.damping)


NO_SOLUTION = OutputErrorFit(FitOutcome.NO_SOLUTION)


def output_error(swing: Swing, stiffness: float, damping: float) -> OutputErrorFit:
    """Fit k and c by Gauss-Newton, starting at a stiffness [N/m] and a damping [N s/m]."""
    if stiffness <= 0:
        return NO_SOLUTION  # the simulation would diverge
    time = np.arange(swing.force_time[0], swing.force_time[-1], STEP)
    force = _without_noise(scipy.interpolate.CubicSpline(swing.force_time, swing.force)(time))
    u = (2 * time - time[0] - time[-1]) / (time[-1] - time[0])
    compared = (swing.marker_time >= time[0] + SETTLING) & (swing.marker_time <= time[-1])
    at, seen = swing.marker_time[compared], swing.displacement[compared]
    k, c = stiffness, max(damping, 0.01 * stiffness / (2 * math.pi))
    kept = np.ones(len(at), bool)
    for _ in range(ROUNDS):
        model = _motion(time, force, k, c, swing.mass)
        by_k = (_motion(time, force, 1.001 * k, c, swing.mass) - model) / (0.001 * k)
        by_c = (_motion(time, force, k, 1.001 * c, swing.mass) - model) / (0.001 * c)
        design = np.column_stack([np.interp(at, time, column) for column in (by_k, by_c, np.ones(len(time)), u)])
        error = seen - np.interp(at, time, model)
        change = np.linalg.lstsq(design[kept], error[kept], rcond=None)[0]
        residual = error - design @ change
        kept = np.abs(residual) < OUTLIER * 1.4826 * float(np.median(np.abs(residual))) + 1e-12
        k, c = k + float(change[0]), c + float(change[1])
        if not (k > 0 and c > 0):
            return NO_SOLUTION
        if abs(change[0]) < 1e-5 * k and abs(change[1]) < 1e-5 * c:
            break
    else:
        return OutputErrorFit(FitOutcome.NOT_CONVERGED)
    try:
        covariance = _covariance(design, np.where(kept, residual, 0.0))
    except np.linalg.LinAlgError:
        return NO_SOLUTION  # the frames that are not outliers do not determine k and c
    k_error, c_error = (math.sqrt(max(0.0, float(covariance[i, i]))) for i in range(2))
    if k_error > k:
        return NO_SOLUTION
    return OutputErrorFit(FitOutcome.CONVERGED, normal_estimate(k, k_error), normal_estimate(c, c_error))


def _without_noise(force: NDArray[np.float64]) -> NDArray[np.float64]:
    """The force (n,) at STEP, low-pass filtered above its swing."""
    power = np.abs(np.fft.rfft((force - force.mean()) * np.hanning(len(force)))) ** 2
    swing = float(np.fft.rfftfreq(len(force), STEP)[np.searchsorted(np.cumsum(power), SWING_POWER * power.sum())])
    low_pass = scipy.signal.butter(4, min(HIGHEST, max(CUTOFF_FACTOR * swing, 1.0)), fs=1 / STEP, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(low_pass, force))


def _motion(
    time: NDArray[np.float64], force: NDArray[np.float64], k: float, c: float, mass: float
) -> NDArray[np.float64]:
    """x (n,) [m] under a force (n,) [N] that is linear between the samples."""
    continuous = np.array([mass, c, k] if mass > 0 else [c, k])
    numerator, denominator, _ = scipy.signal.cont2discrete((np.ones(1), continuous), float(time[1] - time[0]), "foh")
    start = force[0]
    return np.asarray(start / k + scipy.signal.lfilter(np.ravel(numerator), denominator, force - start))


def _covariance(design: NDArray[np.float64], residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """(JᵀJ)⁻¹ Jᵀ R J (JᵀJ)⁻¹ with R from an autoregressive model of the residuals."""
    inverse = np.linalg.inv(design.T @ design)
    correlation = _autocovariance(residual, design.shape[1])
    both = np.concatenate((correlation[:0:-1], correlation))
    coloured = np.column_stack(
        [scipy.signal.fftconvolve(column, both, "valid") for column in _padded(design, len(correlation) - 1)]
    )
    return np.asarray(inverse @ (design.T @ coloured) @ inverse)


def _padded(design: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    return np.pad(design, ((side, side), (0, 0))).T


def _autocovariance(residual: NDArray[np.float64], parameters: int) -> NDArray[np.float64]:
    """(n,) autocovariance of the autoregressive model that has the residuals' first ORDER ones (Yule-Walker)."""
    n = len(residual)
    first = np.array([residual[lag:] @ residual[: n - lag] for lag in range(ORDER + 1)]) / (n - parameters)
    weights = scipy.linalg.solve_toeplitz(first[:-1], first[1:])
    # Further autocovariances follow from the recursion of the model.
    rest = scipy.signal.lfilter(
        [1.0], np.concatenate(([1.0], -weights)), np.zeros(n - ORDER - 1), zi=_memory(first, weights)
    )[0]
    return np.concatenate((first, rest))


def _memory(first: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """State of the recursive filter after the values `first`."""
    last = first[::-1]
    return np.array([weights[i:] @ last[: len(weights) - i] for i in range(len(weights))])
