"""Ratio of a muscle's EMG between two conditions, with its 95 % interval from the repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fitting.uncertainty import student_half_width


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
    """Logarithms (repeats,) of the levels, and what the repeats are."""
    logs = [np.log(np.asarray(cycles, dtype=np.float64)) for cycles in trials]
    if len(logs) == 1 and len(logs[0]) > 1:
        return logs[0], RepeatUnit.CYCLE
    return np.array([cycles.mean() for cycles in logs]), RepeatUnit.TRIAL
