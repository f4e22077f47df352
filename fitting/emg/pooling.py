"""Pool correlation and lag between EMG and activation over the trials of a condition, with random effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.emg.shape import ShapeComparison, ShapeOutcome
from fitting.uncertainty import NORMAL_95, Estimate, Repeat, combine

LARGEST_CORRELATION, LEAST_ERROR = 1 - 1e-9, 1e-6
"""Fisher's transformation is infinite at 1, and the weight of a trial at an error of 0."""


@dataclass(frozen=True)
class PooledShape:
    """Correlation and lag [s] over several trials, with 95 % intervals.

    lag             None where it is identified in fewer than two trials
    trials          that enter the correlation
    trials_of_lag   that enter the lag: those whose lag is identified
    """

    correlation: float
    correlation_ci95: tuple[float, float]
    lag: Estimate | None
    trials: int
    trials_of_lag: int


def pool_shapes(comparisons: Sequence[ShapeComparison]) -> PooledShape | None:
    """Pool the comparisons of one channel in the trials of a condition; None with fewer than two correlations.

    Random effects of Paule and Mandel with the interval of Hartung and Knapp (fitting/uncertainty.py): correlations as
    Fisher's z = artanh r, lags as they are; standard errors are the half-widths of their 95 % intervals over 1.96.
    Trials whose lag is not identified enter with their correlation at lag 0, because to omit them would keep the trials
    with the higher correlations.
    """
    compared = [found for found in comparisons if np.isfinite(found.correlation)]
    if len(compared) < 2:
        return None
    z = combine([_repeat(*np.arctanh(_clipped(found.correlation, found.correlation_ci95))) for found in compared])
    with_lag = [found for found in compared if found.outcome is ShapeOutcome.COMPARED]
    lags = [_repeat(found.lag, *found.lag_ci95) for found in with_lag]
    low, high = np.tanh(z.ci95).tolist()
    return PooledShape(
        float(np.tanh(z.value)),
        (low, high),
        combine(lags) if len(lags) > 1 else None,
        len(compared),
        len(with_lag),
    )


def _repeat(value: float, low: float, high: float) -> Repeat:
    return Repeat(float(value), max(LEAST_ERROR, float(high - low) / (2 * NORMAL_95)))


def _clipped(value: float, ci95: tuple[float, float]) -> NDArray[np.float64]:
    return np.clip([value, *ci95], -LARGEST_CORRELATION, LARGEST_CORRELATION)
