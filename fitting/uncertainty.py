"""Estimates with intervals, and how the repeats of one donning are put together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

NORMAL_95 = 1.959963984540054
KNOWN_NOISE_DOF = 2
"""So many repeats beyond one that what is known of the noise counts for, against the spread between the repeats."""
SPREAD_QUANTILE = 0.95
"""Repeats that differ by more than the noise does in so many of all cases differ for a reason of their own."""


@dataclass(frozen=True)
class Estimate:
    """A number, its standard error and its 95 % interval, in the unit of the number.

    The interval may be wider than 1.96 standard errors: few repeats make a standard error itself uncertain.
    """

    value: float
    standard_error: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Repeat:
    """What one trial says about a quantity.

    value       the trial's own estimate
    noise       its standard error from noise that is known and new in every trial
    chi_square  of its residuals against that noise, with `dof` degrees of freedom (0: nothing left to test)
    common      standard error from causes that all trials of the donning share (lag, gain, ADC codes)
    """

    value: float
    noise: float
    common: float = 0.0
    chi_square: float = 0.0
    dof: int = 0

    @property
    def estimate(self) -> Estimate:
        """The trial on its own."""
        return combine([self])


def combine(repeats: Sequence[Repeat]) -> Estimate:
    """The mean of the repeats, weighted by their noise.

    The half-width is the largest of what the known noise, the scatter within the trials (Student, their degrees of
    freedom) and the spread between the trials ask for. The spread of two or three repeats tells little on its own
    (Student: 12.7 and 4.3 standard errors, of a spread that is small by luck or large), so the noise is let in as
    KNOWN_NOISE_DOF further degrees of freedom, unless the spread contradicts it. Coverage is 99 % for two repeats that
    differ by noise alone, 97 % if a cause of the noise's size is added, and 84 % at worst (four times its size); from
    three repeats on 90 % at worst. What the trials share is not averaged away and is added in quadrature.
    """
    values = np.array([repeat.value for repeat in repeats])
    weights = np.array([repeat.noise**-2 for repeat in repeats])
    mean = float(np.average(values, weights=weights))
    known = float(weights.sum() ** -0.5)
    candidates = [(known, NORMAL_95 * known)]
    noise, dof = known, sum(repeat.dof for repeat in repeats)
    if dof:
        scatter = known * math.sqrt(sum(repeat.chi_square for repeat in repeats) / dof)
        candidates.append((scatter, _student(dof) * scatter))
        noise = max(known, scatter)
    if len(repeats) > 1:
        chi_square = float(weights @ (values - mean) ** 2) * (known / noise) ** 2
        candidates.append(_spread(noise, chi_square, len(repeats) - 1))
    common = float(np.average([repeat.common for repeat in repeats], weights=weights))
    error = math.hypot(max(each[0] for each in candidates), common)
    half_width = math.hypot(max(each[1] for each in candidates), NORMAL_95 * common)
    return Estimate(mean, error, (mean - half_width, mean + half_width))


def _spread(noise: float, chi_square: float, dof: int) -> tuple[float, float]:
    """Standard error and half-width from the repeats' chi-square against their noise, `dof` degrees of freedom."""
    if chi_square < stats.chi2.ppf(SPREAD_QUANTILE, dof):
        chi_square, dof = chi_square + KNOWN_NOISE_DOF, dof + KNOWN_NOISE_DOF
    error = noise * math.sqrt(chi_square / dof)
    return error, _student(dof) * error


def _student(dof: int) -> float:
    return float(stats.t.ppf(0.975, dof))
