"""Variance components of repeated measurements with known measurement noise, by REML.

A component and a ratio of components have profile-likelihood intervals. The interval holds the values whose profile
deviance exceeds the least one by at most q. For few levels q is larger than the quantile of χ²₁: it is the one for
which the interval of a variance estimated by s² ~ σ² χ²_ν / ν covers 95 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache, partial

import numpy as np
import scipy

from documents.interval import counted
from fitting.errors import FitError
from fitting.results.codes import FitOutcome
from fitting.study.restricted_likelihood import (
    Array,
    Curvature,
    ErrorContrasts,
    Likelihood,
    RemlSolution,
    contrast,
    dependencies,
    evaluate,
    maximise,
    maximise_from,
)

LEVEL = 0.95
PRECISION = 1e-3
"""Relative precision of an end, far below its own uncertainty."""
WIDEST = 1e6
"""An upper end beyond so many times the scale of the data is not found."""

PROFILE_STEP = 1e-2
"""Standard errors by which another component of a profile may still change in the last round: the deviance changes by
its square, 1e-4, of the 3.8 and more at which an interval ends."""
INSIDE = 1e-3
"""Component, over the square of the scale of the data, from which a search starts where zero would end it."""


class TooFewObservations(FitError):
    """No component can be estimated: there are no more observations than fixed effects."""


class ComponentOutcome(StrEnum):
    """Outcome of the estimate of a variance component.

    ESTIMATED   above zero
    AT_ZERO     the likelihood is largest at zero, where an analysis of variance gives zero or a negative variance
    ONE_LEVEL   the factor has a single level
    CONFOUNDED  the design does not separate it from other components; their estimate includes it
    """

    ESTIMATED = "estimated"
    AT_ZERO = "at_zero"
    ONE_LEVEL = "one_level"
    CONFOUNDED = "confounded"


@dataclass(frozen=True)
class Factor:
    """A random effect: its name and the level (n,) of every observation."""

    name: str
    labels: Sequence[object]

    @property
    def levels(self) -> int:
        return len(set(self.labels))

    def incidence(self) -> Array:
        """Z (n, levels): 1 where an observation has the level."""
        levels = list(dict.fromkeys(self.labels))
        places = {label: place for place, label in enumerate(levels)}
        return np.eye(len(levels))[[places[label] for label in self.labels]]


@dataclass(frozen=True)
class Component:
    """A variance and its 95 % interval, in the square of the unit of the values; NaN where it is not estimated.

    confounded_with  components whose estimates include it
    """

    name: str
    levels: int
    outcome: ComponentOutcome
    variance: float = math.nan
    ci95: tuple[float, float] = (math.nan, math.nan)
    confounded_with: tuple[str, ...] = ()

    @property
    def is_estimated(self) -> bool:
        return self.outcome in (ComponentOutcome.ESTIMATED, ComponentOutcome.AT_ZERO)


@dataclass(frozen=True)
class MixedModel:
    """y = X β + Σ Z_i u_i + e with known covariance of e, and its REML solution.

    values (n,), fixed (n, p), known (n, n); matrices (estimated components, n, n); theta and information are those of
    the estimated components, in the square of the unit of the values and its inverse square.
    noise  mean variance of e
    """

    values: Array
    fixed: Array
    known: Array
    components: Mapping[str, Component]
    matrices: Array
    theta: Array
    information: Array
    outcome: FitOutcome
    contrasts: ErrorContrasts
    solution: RemlSolution

    @property
    def estimated(self) -> list[Component]:
        """In the order of theta."""
        return [component for component in self.components.values() if component.is_estimated]

    @property
    def noise(self) -> float:
        return float(np.mean(np.diag(self.known)))

    def covariance(self) -> Array:
        """V (n, n) at the solution."""
        return self.known + np.tensordot(self.theta, self.matrices, axes=1)

    def theta_covariance(self) -> Array:
        """Inverse of the information, of the components above zero; zero for the others."""
        covariance = np.zeros_like(self.information)
        free = np.ix_(self.theta > 0, self.theta > 0)
        covariance[free] = np.linalg.pinv(self.information[free])
        return covariance


def fit_components(
    values: Array, factors: Sequence[Factor], known: Array, fixed: Array | None = None, *, with_intervals: bool = True
) -> MixedModel:
    """REML estimate of one variance for each factor, with profile-likelihood intervals.

    values (n,); known (n, n), the covariance of the measurement errors; fixed (n, p), by default a common mean. Of
    factors that the design does not separate, the first keeps the estimate. Raises TooFewObservations.
    """
    fixed = np.ones((len(values), 1)) if fixed is None else fixed
    if len(values) <= fixed.shape[1]:
        raise TooFewObservations(f"{counted(len(values), 'observation')}, expected more than {fixed.shape[1]}")
    incidences = [factor.incidence() for factor in factors]
    contrasts = contrast(values, fixed, known, incidences)
    found = dependencies(contrasts)
    kept = [i for i, others in enumerate(found) if others is None]
    contrasts = replace(contrasts, roots=tuple(contrasts.roots[i] for i in kept))
    solution = _solve(contrasts)
    unit = contrasts.scale**2
    components = {factor.name: _missing(factor, others, factors) for factor, others in zip(factors, found, strict=True)}
    for place, i in enumerate(kept):
        components[factors[i].name] = _component(factors[i], contrasts, solution, place, with_intervals=with_intervals)
    model = MixedModel(
        values=values,
        fixed=fixed,
        known=known,
        components=components,
        matrices=np.array([incidences[i] @ incidences[i].T for i in kept]).reshape(len(kept), *known.shape),
        theta=solution.theta * unit,
        information=solution.curvature.information / unit**2,
        outcome=solution.outcome,
        contrasts=contrasts,
        solution=solution,
    )
    if np.linalg.matrix_rank(model.covariance(), hermitian=True) < len(values):
        raise TooFewObservations("the covariance is singular: no noise is known, and no factor separates the values")
    return model


def _solve(contrasts: ErrorContrasts) -> RemlSolution:
    """Raises TooFewObservations where the values do not vary and no noise is known, so that V is singular."""
    try:
        return maximise(contrasts)
    except scipy.linalg.LinAlgError as error:
        raise TooFewObservations("the covariance is singular: no factor separates the observations") from error


def _missing(factor: Factor, others: tuple[int, ...] | None, factors: Sequence[Factor]) -> Component:
    if not others:
        return Component(factor.name, factor.levels, ComponentOutcome.ONE_LEVEL)
    names = tuple(factors[i].name for i in others)
    return Component(factor.name, factor.levels, ComponentOutcome.CONFOUNDED, confounded_with=names)


def _component(
    factor: Factor, contrasts: ErrorContrasts, solution: RemlSolution, place: int, *, with_intervals: bool
) -> Component:
    unit = contrasts.scale**2
    variance = float(solution.theta[place])
    ends = (math.nan, math.nan)
    if with_intervals:
        ends = component_interval(contrasts, solution, place, factor.levels - 1)
    outcome = ComponentOutcome.ESTIMATED if variance > 0 else ComponentOutcome.AT_ZERO
    return Component(factor.name, factor.levels, outcome, variance * unit, (ends[0] * unit, ends[1] * unit))


def component_interval(contrasts: ErrorContrasts, solution: RemlSolution, index: int, dof: int) -> tuple[float, float]:
    """Ends for θ_index, over the square of the scale; NaN for an end that is not found.

    dof: degrees of freedom of the component if nothing else varied, its levels − 1.
    """
    return _interval(partial(evaluate, contrasts), solution, index, dof)


def ratio_interval(
    contrasts: ErrorContrasts, solution: RemlSolution, index: int, noise: float, dof: int
) -> tuple[float, float]:
    """Ends for ρ = θ_index / (Σ θ + noise), by the odds ρ / (1 − ρ); noise is over the square of the scale."""
    rest = float(np.delete(solution.theta, index).sum()) + noise
    if rest <= 0:
        return (math.nan, 1.0)
    likelihood = partial(_evaluate_odds, contrasts, index, noise)
    with_odds = solution.theta.copy()
    with_odds[index] /= rest
    best = replace(solution, theta=with_odds, curvature=likelihood(with_odds))
    low, high = _interval(likelihood, best, index, dof)
    if low > 0:  # the share is small, too, where a component of few levels is large
        levels = [math.inf if i == index else root.shape[1] for i, root in enumerate(contrasts.roots)]
        start = with_odds.copy()
        start[np.argmin(levels)] += 1.0
        low = _lower_end(likelihood, best, index, low, dof, start)
    return (low / (1 + low), high / (1 + high))


def _evaluate_odds(contrasts: ErrorContrasts, index: int, noise: float, coordinates: Array) -> Curvature:
    """The curvature by the odds θ_index / (Σ others + noise), in the place of θ_index, and the other components."""
    odds, rest = coordinates[index], coordinates.sum() - coordinates[index] + noise
    theta = coordinates.copy()
    theta[index] = odds * rest
    here = evaluate(contrasts, theta)
    by_coordinates = np.eye(len(theta))
    by_coordinates[index] = odds
    by_coordinates[index, index] = rest
    observed = by_coordinates.T @ here.observed @ by_coordinates
    second = here.gradient[index] / 2  # θ_index is the product of the odds and the rest
    observed[index] += second
    observed[:, index] += second
    observed[index, index] -= 2 * second
    information = by_coordinates.T @ here.information @ by_coordinates
    return Curvature(here.deviance, here.gradient @ by_coordinates, information, observed)


@cache
def deviance_quantile(dof: int) -> float:
    """q of a variance with ν degrees of freedom: P(ν (x − 1 − log x) ≤ q) = 0.95 for ν x ~ χ²_ν.

    Lambert's W solves x − log x = 1 + q / ν: x = −W(−exp(−1 − q / ν)), on its two real branches.
    """
    return float(scipy.optimize.brentq(lambda quantile: _coverage(quantile, dof) - LEVEL, 3.0, 8.0))


def _coverage(quantile: float, dof: int) -> float:
    """P(ν (x − 1 − log x) ≤ q) for ν x ~ χ²_ν."""
    low, high = -scipy.special.lambertw(-math.exp(-1 - quantile / dof), [0, -1]).real
    return float(scipy.stats.chi2.cdf(dof * high, dof) - scipy.stats.chi2.cdf(dof * low, dof))


def _interval(likelihood: Likelihood, best: RemlSolution, index: int, dof: int) -> tuple[float, float]:
    """Ends for a coordinate of the likelihood, which is best at the solution."""
    highest, estimate = best.curvature.deviance + deviance_quantile(dof), float(best.theta[index])
    deviance = _profile(likelihood, index, best.theta)
    low = 0.0 if deviance(0.0) <= highest else _crossing(deviance, highest, 0.0, estimate)
    deviance = _profile(likelihood, index, best.theta)
    inner, outer = estimate, max(estimate, INSIDE)
    while deviance(outer) < highest:
        if outer >= WIDEST:
            return (low, math.nan)
        inner, outer = outer, min(4 * outer, WIDEST)
    return (low, _crossing(deviance, highest, inner, outer))


def _lower_end(likelihood: Likelihood, best: RemlSolution, index: int, low: float, dof: int, start: Array) -> float:
    """A lower end than the one found if the profile from another start is below the limit there, else the same."""
    highest, deviance = best.curvature.deviance + deviance_quantile(dof), _profile(likelihood, index, start)
    inner = outer = low
    while deviance(outer) < highest:
        if outer < low / WIDEST:
            return 0.0
        inner, outer = outer, outer / 2  # in steps that do not leave this minimum
    return _crossing(deviance, highest, outer, inner) if outer < low else low


def _profile(likelihood: Likelihood, index: int, start: Array) -> Callable[[float], float]:
    """Value of the coordinate → least deviance, sought near the last one; infinite where V is singular."""
    last = start

    @cache
    def deviance(value: float) -> float:
        nonlocal last
        for begin in (last.copy(), np.maximum(last, INSIDE)):  # at θ = 0, V is singular where no noise is known
            begin[index] = value
            with suppress(scipy.linalg.LinAlgError):
                found = maximise_from(likelihood, begin, PROFILE_STEP, index)
                last = found.theta
                return found.curvature.deviance
        return math.inf

    return deviance


def _crossing(deviance: Callable[[float], float], level: float, low: float, high: float) -> float:
    """Value between low and high at which the deviance crosses the level; NaN where both ends lie on one side of it."""
    try:
        return float(scipy.optimize.brentq(lambda value: deviance(value) - level, low, high, rtol=PRECISION))
    except ValueError:
        return math.nan
