"""Estimates with intervals and their parts, and how the repeats of one donning are put together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

NORMAL_95 = 1.959963984540054
OPEN = 0.5
"""Part of its value that a standard error may reach before a quantity is called not identified."""


@dataclass(frozen=True)
class Estimate:
    """A number, its standard error and its 95 % interval, in the unit of the number.

    The interval may be wider than 1.96 standard errors: few repeats make a standard error itself uncertain.
    parts  standard error by cause ("noise", "lag", "gain", "drift", "codes", "between_repeats"); their squares add up
    bound  Cramér-Rao bound of the standard error for the noise found and what the trials share, None if not known
    """

    value: float
    standard_error: float
    ci95: tuple[float, float]
    parts: Mapping[str, float] = field(default_factory=dict)
    bound: float | None = None

    @property
    def is_open(self) -> bool:
        """Whether what is not known of it is a large part of it: it is given all the same, and called not identified.

        Were it left out, those would stay that noise made large.
        """
        return self.standard_error > OPEN * abs(self.value)

    def scaled(self, factor: float) -> Estimate:
        """The estimate of factor × the number."""
        low, high = sorted(factor * end for end in self.ci95)
        return Estimate(
            factor * self.value,
            abs(factor) * self.standard_error,
            (low, high),
            {cause: abs(factor) * part for cause, part in self.parts.items()},
            None if self.bound is None else abs(factor) * self.bound,
        )

    def widened(self, causes: Mapping[str, float]) -> Estimate:
        """With independent normal errors by cause that the estimate did not hold; what it held is its "noise"."""
        more = math.hypot(*causes.values())
        low, high = (
            math.copysign(math.hypot(end - self.value, NORMAL_95 * more), end - self.value) for end in self.ci95
        )
        return replace(
            self,
            standard_error=math.hypot(self.standard_error, more),
            ci95=(self.value + low, self.value + high),
            parts={"noise": self.standard_error, **causes},
        )


@dataclass(frozen=True)
class Repeat:
    """What one trial says about a quantity.

    value       the trial's own estimate
    noise       its standard error from noise that is known and new in every trial
    chi_square  of its residuals against that noise, with `dof` degrees of freedom (0: nothing left to test)
    common      standard error from causes that all trials of the donning share (lag, gain, ADC codes)
    causes      the parts of common by cause; empty if nobody tells them apart
    bound       Cramér-Rao bound of the noise, None if it is the noise itself
    """

    value: float
    noise: float
    common: float = 0.0
    chi_square: float = 0.0
    dof: int = 0
    causes: Mapping[str, float] = field(default_factory=dict)
    bound: float | None = None

    @property
    def estimate(self) -> Estimate:
        """The trial on its own."""
        return combine([self])


def normal_estimate(value: float, error: float) -> Estimate:
    """An estimate whose error is normal and known."""
    return Estimate(value, error, (value - NORMAL_95 * error, value + NORMAL_95 * error))


def student_estimate(value: float, error: float, dof: int) -> Estimate:
    """An estimate whose error was found from a scatter with so many degrees of freedom."""
    half_width = _student(dof) * error
    return Estimate(value, error, (value - half_width, value + half_width))


def combine(repeats: Sequence[Repeat]) -> Estimate:
    """The mean of the repeats, with within-trial and between-trial spread in its interval.

    Random effects: weights 1/(u² + s²) with the between-trial variance s² of Paule and Mandel, and the interval of
    Hartung and Knapp, t(n − 1) standard errors from the weighted spread. It is never narrower than the known noise
    asks for (1.96), nor than the scatter within the trials (Student, their degrees of freedom). So it covers 95 % or
    more whether repeats differ by noise alone or by many times as much; the price is t = 12.7 for two repeats and 4.3
    for three. What the trials share is not averaged away and is added in quadrature.
    """
    values = np.array([repeat.value for repeat in repeats])
    noise = np.array([repeat.noise for repeat in repeats])
    dof = sum(repeat.dof for repeat in repeats)
    inflation = math.sqrt(sum(repeat.chi_square for repeat in repeats) / dof) if dof else 1.0
    scatter = noise * max(1.0, inflation)
    weights = 1 / (scatter**2 + between_variance(values, scatter))
    mean = float(np.average(values, weights=weights))
    known = _of_mean(weights, scatter)
    half_widths, errors = [NORMAL_95 * known], [known]
    if dof:
        half_widths.append(_student(dof) * _of_mean(weights, noise) * inflation)
    if len(repeats) > 1:
        spread = float(weights @ (values - mean) ** 2) / (len(repeats) - 1)
        errors.append(math.sqrt(spread / weights.sum()))
        half_widths.append(_student(len(repeats) - 1) * errors[-1])
    error = max(errors)
    common = _average([repeat.common for repeat in repeats], weights)
    half_width = math.hypot(max(half_widths), NORMAL_95 * common)
    bound = _of_mean(noise**-2, [repeat.noise if repeat.bound is None else repeat.bound for repeat in repeats])
    return Estimate(
        mean,
        math.hypot(error, common),
        (mean - half_width, mean + half_width),
        {"noise": known, "between_repeats": math.sqrt(max(0.0, error**2 - known**2)), **_causes(repeats, weights)},
        math.hypot(bound, common),
    )


def between_variance(values: NDArray[np.float64], noise: NDArray[np.float64]) -> float:
    """s² of Paule and Mandel: with weights 1/(u² + s²) the repeats' chi-square is its degrees of freedom."""
    dof = len(values) - 1

    def excess(variance: float) -> float:
        weights = 1 / (noise**2 + variance)
        mean = (weights * values).sum() / weights.sum()  # np.average, without its checks: this is called 60 times
        return float(weights @ (values - mean) ** 2) - dof

    if dof < 1 or excess(0.0) <= 0:
        return 0.0
    low, high = 0.0, float(np.ptp(values)) ** 2
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return (low + high) / 2


def as_inverse(estimate: Estimate) -> Estimate:
    """The estimate of 1 / the number: the interval's ends are inverted, errors are to first order."""
    low, high = estimate.ci95
    inverse = 1 / estimate.value
    turned = estimate.scaled(inverse**2)
    return replace(turned, value=inverse, ci95=(1 / high, 1 / low if low > 0 else math.inf))


def _causes(repeats: Sequence[Repeat], weights: NDArray[np.float64]) -> dict[str, float]:
    names = dict.fromkeys(cause for repeat in repeats for cause in repeat.causes)
    return {name: _average([repeat.causes.get(name, 0.0) for repeat in repeats], weights) for name in names}


def _average(values: Sequence[float], weights: NDArray[np.float64]) -> float:
    return float(np.average(values, weights=weights))


def _of_mean(weights: NDArray[np.float64], errors: NDArray[np.float64] | Sequence[float]) -> float:
    """Standard error of the weighted mean of independent values."""
    return float(np.linalg.norm(weights * np.asarray(errors)) / weights.sum())


def _student(dof: int) -> float:
    return float(stats.t.ppf(0.975, dof))
