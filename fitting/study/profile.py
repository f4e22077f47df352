"""Profile-likelihood intervals of a variance component and of a ratio of components.

The interval holds the values whose profile deviance exceeds the least one by at most q. For few levels q is larger than
the quantile of χ²₁: it is the one for which the interval of a variance estimated by s² ~ σ² χ²_ν / ν covers 95 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import scipy

from fitting.study.reml import Array, ErrorContrasts, RemlSolution, maximise

LEVEL = 0.95
MOST_DOF = 200
"""Degrees of freedom beyond which q is that of χ²₁ within 0.2 %."""
PRECISION = 1e-3
"""Relative precision of an end, far below its own uncertainty."""
WIDEST = 1e6
"""An upper end beyond so many times the scale of the data is not found."""

SINGULAR = 1e9
"""Stands for the infinite deviance of a singular covariance: the search for an end needs its sign only."""

INSIDE = 1e-3
"""Start of a component for which the one before is singular, over the square of the scale of the data."""

Profile = Callable[[float, Array], RemlSolution]
"""Value, start → the solution under the constraint that the function has this value."""


def component_interval(contrasts: ErrorContrasts, solution: RemlSolution, index: int, dof: int) -> tuple[float, float]:
    """Ends for θ_index, over the square of the scale; NaN for an end that is not found.

    dof: degrees of freedom of the component if nothing else varied, its levels − 1.
    """
    others, fixed = _split(contrasts, index)

    def fix(value: float, start: Array) -> RemlSolution:
        known = contrasts.known + value * fixed
        return maximise(replace(contrasts, known=known, roots=others), start)

    estimate = float(solution.theta[index])
    return _interval(fix, estimate, np.delete(solution.theta, index), solution, deviance_quantile(dof))


def ratio_interval(
    contrasts: ErrorContrasts, solution: RemlSolution, index: int, noise: float, dof: int
) -> tuple[float, float]:
    """Ends for ρ = θ_index / (Σ θ + noise), by the odds ρ / (1 − ρ); noise is over the square of the scale."""
    others, fixed = _split(contrasts, index)

    def fix(odds: float, start: Array) -> RemlSolution:
        known = contrasts.known + odds * noise * fixed
        roots = tuple(np.hstack([root, math.sqrt(odds) * contrasts.roots[index]]) for root in others)
        return maximise(replace(contrasts, known=known, roots=roots), start)

    rest = float(np.delete(solution.theta, index).sum()) + noise
    if rest <= 0:
        return (math.nan, 1.0)
    odds = float(solution.theta[index]) / rest
    ends = _interval(fix, odds, np.delete(solution.theta, index), solution, deviance_quantile(dof))
    return (ends[0] / (1 + ends[0]), ends[1] / (1 + ends[1]))


@cache
def deviance_quantile(dof: int) -> float:
    """q of a variance with ν degrees of freedom: P(ν (x − 1 − log x) ≤ q) = 0.95 for ν x ~ χ²_ν."""
    freedom = min(max(dof, 1), MOST_DOF)
    law = scipy.stats.chi2(freedom)

    def excess(quantile: float) -> float:
        height = 1 + quantile / freedom
        low = scipy.optimize.brentq(lambda x: x - math.log(x) - height, math.exp(-height), 1.0)
        high = scipy.optimize.brentq(lambda x: x - math.log(x) - height, 1.0, 4 + 4 * height)
        return float(law.cdf(freedom * high) - law.cdf(freedom * low)) - LEVEL

    return float(scipy.optimize.brentq(excess, 3.0, 8.0))


def _split(contrasts: ErrorContrasts, index: int) -> tuple[tuple[Array, ...], Array]:
    """The roots of the other components, and Z Z' (m, m) of this one."""
    root = contrasts.roots[index]
    return contrasts.roots[:index] + contrasts.roots[index + 1 :], root @ root.T


def _interval(
    fix: Profile, estimate: float, start: Array, solution: RemlSolution, quantile: float
) -> tuple[float, float]:
    highest = solution.curvature.deviance + quantile
    last = start

    @cache
    def excess(value: float) -> float:
        nonlocal last
        for begin in (last, np.maximum(last, INSIDE)):
            try:
                found = fix(value, begin)
                break
            except scipy.linalg.LinAlgError:  # on the border of θ ≥ 0, where no noise is known
                continue
        else:
            return SINGULAR
        last = found.theta
        return found.curvature.deviance - highest

    low = 0.0 if excess(0.0) <= 0 else _root(excess, 0.0, estimate)
    last, inner = start, estimate
    outer = max(2 * estimate, 1e-3)
    while excess(outer) < 0:
        inner, outer = outer, 4 * outer
        if outer > WIDEST:
            return (low, math.nan)
    return (low, _root(excess, inner, outer))


def _root(excess: Callable[[float], float], low: float, high: float) -> float:
    """NaN where the deviance does not cross q between both."""
    if excess(low) * excess(high) > 0:
        return math.nan
    return float(scipy.optimize.brentq(excess, low, high, xtol=PRECISION * high, rtol=PRECISION))
