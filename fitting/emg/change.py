"""Ratio of a muscle's EMG between two conditions, and correlation and lag between EMG and activation, over trials.

The ratio has its 95 % interval from the repeats. Correlation and lag are pooled over the trials of a condition, with
random effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fitting.emg.shape import ShapeComparison, ShapeOutcome
from fitting.uncertainty import NORMAL_95, Estimate, Repeat, combine, student_half_width


class RepeatUnit(StrEnum):
    """Unit of analysis of a condition. Codes are stable.

    TRIAL  trials, each with the mean of its cycles
    CYCLE  cycles of the only trial, whose spread does not contain the variation between trials
    """

    TRIAL = "trial"
    CYCLE = "cycle"


@dataclass(frozen=True)
class EmgChange:
    """Ratio of the condition to its reference.

    ci95, standard_error  of the ratio; None where a condition has a single repeat
    repeats, units        of the reference and of the condition
    """

    ratio: float
    ci95: tuple[float, float] | None
    standard_error: float | None
    repeats: tuple[int, int]
    units: tuple[RepeatUnit, RepeatUnit]


def emg_change(reference: Sequence[Sequence[float]], condition: Sequence[Sequence[float]]) -> EmgChange:
    """Ratio of geometric means of EMG levels (mean of the envelope, in any unit, positive), by trial and cycle.

    Welch's interval on logarithms: the spread of repeats is proportional to the level and may differ between the
    conditions. Cycles of a trial are not independent of each other (same electrodes, same fatigue), so several trials
    enter by their means (analysis of summary measures: J. N. S. Matthews et al., BMJ 300:230-235, 1990).
    """
    (before, before_unit), (after, after_unit) = _log_levels(reference), _log_levels(condition)
    difference = float(after.mean() - before.mean())
    ratio, counts, units = float(np.exp(difference)), (len(before), len(after)), (before_unit, after_unit)
    if min(counts) < 2:
        return EmgChange(ratio, None, None, counts, units)
    variances = np.array([sample.var(ddof=1) / len(sample) for sample in (before, after)])
    variance = float(variances.sum())
    dof = variance**2 / float(np.sum(variances**2 / (np.array(counts) - 1))) if variance > 0 else 1.0
    half_width = student_half_width(dof) * np.sqrt(variance)
    ci95 = (float(np.exp(difference - half_width)), float(np.exp(difference + half_width)))
    return EmgChange(ratio, ci95, float(ratio * np.sqrt(variance)), counts, units)


def _log_levels(trials: Sequence[Sequence[float]]) -> tuple[NDArray[np.float64], RepeatUnit]:
    """Logarithms (repeats,) of the levels, and the kind of the repeats."""
    logs = [np.log(np.asarray(cycles, dtype=np.float64)) for cycles in trials]
    if len(logs) == 1 and len(logs[0]) > 1:
        return logs[0], RepeatUnit.CYCLE
    return np.array([cycles.mean() for cycles in logs]), RepeatUnit.TRIAL


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
        float(np.tanh(z.value)), (low, high), combine(lags) if len(lags) > 1 else None, len(compared), len(with_lag)
    )


def _repeat(value: float, low: float, high: float) -> Repeat:
    return Repeat(float(value), max(LEAST_ERROR, float(high - low) / (2 * NORMAL_95)))


def _clipped(value: float, ci95: tuple[float, float]) -> NDArray[np.float64]:
    return np.clip([value, *ci95], -LARGEST_CORRELATION, LARGEST_CORRELATION)
