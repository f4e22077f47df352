"""Estimates with intervals and their parts, and the combination of the repeats of one donning."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from documents.interval import between, has_width, with_error
from fitting.results.codes import FitOutcome

NORMAL_95 = 1.959963984540054
LARGEST_RELATIVE_ERROR = 0.5
"""Standard error over value above which a quantity is not identified."""
ROUNDS, TOLERANCE = 60, 1e-12
"""Of the bisection for the variance between repeats; its interval relative to the largest possible variance."""
CHI_SQUARE_LEVEL = 0.999
"""Probability of χ² up to which a line or a curve is accepted."""


@dataclass(frozen=True, repr=False)
class Estimate:
    """A number, its standard error and its 95 % interval, in the unit of the number.

    The interval may be wider than 1.96 standard errors: few repeats make a standard error itself uncertain.
    parts    standard error by cause ("noise", "lag", "gain", "drift", "codes", "settling", "between_repeats",
             "friction", "direction"); their squares add up
    bound    Cramér-Rao bound of the standard error, with the errors common to all trials; None if unknown
    outcome  of the iteration that combines repeats
    """

    value: float
    standard_error: float
    ci95: tuple[float, float]
    parts: Mapping[str, float] = field(default_factory=dict)
    bound: float | None = None
    outcome: FitOutcome = FitOutcome.CONVERGED

    def __repr__(self) -> str:
        return self.text()

    def text(self, unit: str = "") -> str:
        """`8515 ± 30 N/m, 95 %: 8301 to 8741`; without an interval that has no width."""
        value = f"{with_error(self.value, self.standard_error)} {unit}".rstrip()
        return f"{value}, 95 %: {between(self.ci95)}" if has_width(self.ci95) else value

    @property
    def is_too_wide(self) -> bool:
        """Whether the standard error exceeds half of the value. The figure is still given, as not identified.

        If such figures were left out, only those that noise made large would remain.
        """
        return self.standard_error > LARGEST_RELATIVE_ERROR * abs(self.value)

    def scaled(self, factor: float) -> Estimate:
        """The estimate of factor × the number."""
        low, high = sorted(factor * end for end in self.ci95)
        return Estimate(
            factor * self.value,
            abs(factor) * self.standard_error,
            (low, high),
            {cause: abs(factor) * part for cause, part in self.parts.items()},
            None if self.bound is None else abs(factor) * self.bound,
            self.outcome,
        )

    def widened(self, causes: Mapping[str, float]) -> Estimate:
        """The estimate with additional independent normal errors by cause; its own error becomes the part "noise"."""
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
    """A quantity as estimated from one trial.

    value       the trial's own estimate
    noise       its standard error from noise that is known and independent in every trial
    chi_square  of its residuals against that noise, with `dof` degrees of freedom (0: no test)
    common      standard error from causes common to all trials of the donning (lag, gain, ADC codes)
    causes      the parts of common by cause; empty if they are not known separately
    bound       Cramér-Rao bound of the noise, None if it equals the noise
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
        """The estimate from this trial alone."""
        return combine([self])


def student_half_width(dof: float) -> float:
    """Half width of a 95 % interval over its standard error, if that was computed from scatter: Student's t."""
    from scipy.special import stdtrit  # the recorder imports this file, and starts without SciPy

    return float(stdtrit(dof, 0.975))


def chi_square_limit(dof: float, level: float = CHI_SQUARE_LEVEL) -> float:
    """The value that χ² does not exceed with the probability `level`; NaN without degrees of freedom."""
    from scipy.special import gammaincinv

    return float(2 * gammaincinv(dof / 2, level))


def normal_estimate(value: float, error: float) -> Estimate:
    """An estimate whose error is normal and known."""
    return Estimate(value, error, (value - NORMAL_95 * error, value + NORMAL_95 * error))


def student_estimate(value: float, error: float, dof: int) -> Estimate:
    """An estimate whose standard error was computed from scatter with `dof` degrees of freedom."""
    half_width = student_half_width(dof) * error
    return Estimate(value, error, (value - half_width, value + half_width))


def combine(repeats: Sequence[Repeat]) -> Estimate:
    """The mean of the repeats, with within-trial and between-trial spread in its interval.

    Random effects: weights 1/(u² + s²) with the between-trial variance s² of Paule and Mandel, and the interval of
    Hartung and Knapp, t(n − 1) standard errors from the weighted spread. It is never narrower than 1.96 standard errors
    of the known noise, nor than the Student interval of the scatter within the trials. So it covers at least 95 %,
    whether repeats differ by noise alone or by much more; the price is t = 12.7 for two repeats and 4.3 for three.
    Errors common to the trials do not average out and are added in quadrature.
    """
    values = np.array([repeat.value for repeat in repeats])
    noise = np.array([repeat.noise for repeat in repeats])
    dof = sum(repeat.dof for repeat in repeats)
    inflation = math.sqrt(sum(repeat.chi_square for repeat in repeats) / dof) if dof else 1.0
    scatter = noise * max(1.0, inflation)
    variance, outcome = between_variance(values, scatter)
    weights = 1 / (scatter**2 + variance)
    mean = float(np.average(values, weights=weights))
    known = _of_mean(weights, scatter)
    half_widths, errors = [NORMAL_95 * known], [known]
    if dof:
        half_widths.append(student_half_width(dof) * _of_mean(weights, noise) * inflation)
    if len(repeats) > 1:
        spread = float(weights @ (values - mean) ** 2) / (len(repeats) - 1)
        errors.append(math.sqrt(spread / weights.sum()))
        half_widths.append(student_half_width(len(repeats) - 1) * errors[1])
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
        outcome,
    )


def between_variance(values: NDArray[np.float64], noise: NDArray[np.float64]) -> tuple[float, FitOutcome]:
    """s² of Paule and Mandel by bisection, and the outcome.

    It is the s² at which the chi-square of the repeats with weights 1/(u² + s²) equals its degrees of freedom.
    """
    dof = len(values) - 1

    def excess(variance: float) -> float:
        weights = 1 / (noise**2 + variance)
        mean = (weights * values).sum() / weights.sum()  # np.average is slower, and this runs ROUNDS times
        return float(weights @ (values - mean) ** 2) - dof

    if dof < 1 or excess(0.0) <= 0:
        return 0.0, FitOutcome.CONVERGED
    largest = float(np.ptp(values)) ** 2
    low, high = 0.0, largest
    for _ in range(ROUNDS):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    outcome = FitOutcome.CONVERGED if high - low <= TOLERANCE * largest else FitOutcome.NOT_CONVERGED
    return (low + high) / 2, outcome


def as_inverse(estimate: Estimate) -> Estimate:
    """The estimate of 1 / the number. The ends of the interval are inverted; errors are to first order."""
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
