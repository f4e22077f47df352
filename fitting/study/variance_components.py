"""Variance components of repeated measurements with known measurement noise, by REML.

A component and a ratio of components have profile-likelihood intervals. The interval holds the values whose profile
deviance exceeds the least one by at most q. For few levels q is larger than the quantile of χ²₁: it is the one for
which the interval of a variance estimated by s² ~ σ² χ²_ν / ν covers 95 %.

Restricted likelihood of a linear mixed model with known error covariance:

    y = X β + Σ_i Z_i u_i + e,   u_i ~ N(0, θ_i I),   e ~ N(0, R), R known
    V(θ) = R + Σ_i θ_i Z_i Z_i'

Error contrasts K'y with K'X = 0 have the restricted likelihood (Patterson and Thompson 1971, Biometrika 58:545)

    −2 ℓ(θ) = log |K'VK| + (K'y)' (K'VK)⁻¹ (K'y)

up to a constant. K is an orthonormal basis, so that no fixed effect appears below.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache, cached_property

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.linalg import lapack

from documents.interval import counted
from fitting.errors import FitError
from fitting.results.codes import FitOutcome

Array = NDArray[np.float64]

ROUNDS = 200
SMALLEST_STEP = 1e-5
"""Standard errors by which a component may still change in the last round."""
PROFILE_STEP = 1e-2
"""The same for a profile: the deviance changes by its square, 1e-4, of the 3.8 and more at which an interval ends."""
HALVINGS = 40
ROUNDING = 1e-9
"""A step may raise the deviance by so much, else rounding would end the search before it converges."""
SEPARATE = 1e-8
"""Part of a matrix that has to be independent of the others, for its component to be separated from theirs."""


@dataclass(frozen=True)
class ErrorContrasts:
    """K'y (m,) over `scale`, the unit of y; K'RK (m, m) over its square; roots K'Z_i (m, levels)."""

    values: Array
    known: Array
    roots: tuple[Array, ...]
    scale: float

    @property
    def count(self) -> int:
        """Number of variance components."""
        return len(self.roots)

    @cached_property
    def products(self) -> Array:
        """K'Z_i Z_i'K (components, m, m)."""
        return np.array([root @ root.T for root in self.roots]).reshape(self.count, *self.known.shape)

    @cached_property
    def columns(self) -> Array:
        """All roots, then the values (m, all levels + 1)."""
        return np.asfortranarray(np.column_stack((*self.roots, self.values)))

    @cached_property
    def owners(self) -> Array:
        """1 where a column is one of the component (all levels, components)."""
        return np.repeat(np.eye(self.count), [root.shape[1] for root in self.roots], axis=0)

    def covariance(self, theta: Array) -> Array:
        """K'V(θ)K (m, m)."""
        return self.known + (theta @ self.products.reshape(self.count, self.known.size)).reshape(self.known.shape)


@dataclass(frozen=True)
class Curvature:
    """−2 ℓ at θ and its gradient (components,); expected and observed information of ℓ (components, components)."""

    deviance: float
    gradient: Array
    information: Array
    observed: Array


@dataclass(frozen=True)
class RemlSolution:
    """θ (components,) that maximises the restricted likelihood over θ ≥ 0, over the square of the scale."""

    theta: Array
    curvature: Curvature
    outcome: FitOutcome


def contrast(values: Array, fixed: Array, known: Array, incidences: Sequence[Array]) -> ErrorContrasts:
    """Error contrasts of y (n,), X (n, p), R (n, n) and Z_i (n, levels). X has full column rank."""
    basis = scipy.linalg.null_space(fixed.T)
    contrasts = basis.T @ values
    scale = float(np.linalg.norm(contrasts) / np.sqrt(max(1, contrasts.size)))
    scale = scale or float(np.sqrt(np.trace(known) / len(known))) or 1.0
    roots = tuple(_root(basis, incidence) for incidence in incidences)
    return ErrorContrasts(contrasts / scale, basis.T @ known @ basis / scale**2, roots, scale)


def dependencies(contrasts: ErrorContrasts) -> list[tuple[int, ...] | None]:
    """For each matrix None if it is independent of those before it, else the indices of those that it is a sum of.

    The tuple is empty for a matrix of zeros: the component has no influence on the contrasts.
    """
    found: list[tuple[int, ...] | None] = []
    kept: list[int] = []
    columns = contrasts.products.reshape(contrasts.count, contrasts.values.size**2).T
    for index in range(contrasts.count):
        column, before = columns[:, index], columns[:, kept]
        weights = np.linalg.lstsq(before, column)[0] if kept else np.empty(0)
        rest = float(np.linalg.norm(column - before @ weights))
        if rest > SEPARATE * float(np.linalg.norm(column)):
            found.append(None)
            kept.append(index)
        else:
            found.append(tuple(kept[i] for i in np.flatnonzero(np.abs(weights) > SEPARATE)))
    return found


def evaluate(contrasts: ErrorContrasts, theta: Array) -> Curvature:
    """Raises LinAlgError where V(θ) is singular."""
    # LAPACK itself: what SciPy's functions do around it takes longer than these small matrices.
    lower, failed = lapack.dpotrf(contrasts.covariance(theta), lower=1)
    if failed:
        raise scipy.linalg.LinAlgError("the covariance is singular")
    whitened, _ = lapack.dtrtrs(lower, contrasts.columns, lower=1)
    inner = whitened.T @ whitened
    across, projected = inner[:-1, :-1], inner[:-1, -1]  # Z_i' V⁻¹ Z_j and Z_i' V⁻¹ y
    owners = contrasts.owners
    information = owners.T @ across**2 @ owners / 2
    observed = owners.T @ (projected[:, np.newaxis] * projected * across) @ owners - information
    gradient = (across.diagonal() - projected**2) @ owners
    return Curvature(2 * float(np.log(lower.diagonal()).sum()) + float(inner[-1, -1]), gradient, information, observed)


def maximise(
    contrasts: ErrorContrasts, start: Array | None = None, smallest_step: float = SMALLEST_STEP
) -> RemlSolution:
    """Newton's method and Fisher scoring with θ ≥ 0: a component at zero whose likelihood falls with it is held there.

    Raises LinAlgError where V is singular at the start, as for values without any variance.
    """
    theta = np.ones(contrasts.count) if start is None else start
    here = evaluate(contrasts, theta)
    for _ in range(ROUNDS):
        free = (theta > 0) | (here.gradient < 0)
        step = np.zeros_like(theta)
        if free.any():
            step[free] = _newton_step(here, free)
        if np.sqrt(step @ here.information @ step) < smallest_step:
            return RemlSolution(theta, here, FitOutcome.CONVERGED)
        moved = _descend(contrasts, theta, here, step)
        if moved is None:
            break
        theta, here = moved
    return RemlSolution(theta, here, FitOutcome.NOT_CONVERGED)


def _newton_step(here: Curvature, free: NDArray[np.bool_]) -> Array:
    """Newton's step, or that of Fisher scoring where the observed information is not positive definite."""
    score, chosen = -here.gradient[free] / 2, np.ix_(free, free)
    _, step, failed = lapack.dposv(here.observed[chosen], score)
    return scipy.linalg.lstsq(here.information[chosen], score)[0] if failed else step


def _descend(contrasts: ErrorContrasts, theta: Array, here: Curvature, step: Array) -> tuple[Array, Curvature] | None:
    """The longest of halved steps that lowers the deviance; None if not even the shortest does."""
    for halving in range(HALVINGS):
        tried = np.maximum(0.0, theta + step / 2**halving)
        try:
            there = evaluate(contrasts, tried)
        except scipy.linalg.LinAlgError:
            continue
        if there.deviance <= here.deviance + ROUNDING and not np.array_equal(tried, theta):
            return tried, there
    return None


def _root(basis: Array, incidence: Array) -> Array:
    """K'Z; of a factor with a level for every observation the identity, as K'ZZ'K = K'K."""
    if incidence.shape[0] == incidence.shape[1]:
        return np.eye(basis.shape[1])
    root: Array = basis.T @ incidence
    if np.linalg.norm(root) < SEPARATE * np.linalg.norm(incidence):
        root[:] = 0.0  # a factor of one level is in the fixed effects
    return root


LEVEL = 0.95
PRECISION = 1e-3
"""Relative precision of an end, far below its own uncertainty."""
WIDEST = 1e6
"""An upper end beyond so many times the scale of the data is not found."""

INSIDE = 1e-3
"""Component, over the square of the scale of the data, from which a search starts where zero would end it."""

Profile = Callable[[float, Array], RemlSolution]
"""Value, start → the solution under the constraint that the function has this value."""


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
    found = dependencies(contrast(values, fixed, known, incidences))
    kept = [i for i, others in enumerate(found) if others is None]
    contrasts = contrast(values, fixed, known, [incidences[i] for i in kept])
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
    others, fixed = _split(contrasts, index)

    def fix(value: float, start: Array) -> RemlSolution:
        known = contrasts.known + value * fixed
        return maximise(replace(contrasts, known=known, roots=others), start, PROFILE_STEP)

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
        return maximise(replace(contrasts, known=known, roots=roots), start, PROFILE_STEP)

    rest = float(np.delete(solution.theta, index).sum()) + noise
    if rest <= 0:
        return (math.nan, 1.0)
    odds = float(solution.theta[index]) / rest
    ends = _interval(fix, odds, np.delete(solution.theta, index), solution, deviance_quantile(dof))
    return (ends[0] / (1 + ends[0]), ends[1] / (1 + ends[1]))


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
    def deviance(value: float) -> float:
        nonlocal last
        for begin in (last, np.maximum(last, INSIDE)):
            try:
                found = fix(value, begin)
                break
            except scipy.linalg.LinAlgError:  # on the border of θ ≥ 0, where no noise is known
                continue
        else:
            return math.inf
        last = found.theta
        return found.curvature.deviance

    low = 0.0 if deviance(0.0) <= highest else _crossing(deviance, highest, 0.0, estimate)
    last, inner = start, estimate
    outer = max(estimate, INSIDE)
    while deviance(outer) < highest:
        if outer >= WIDEST:
            return (low, math.nan)
        inner, outer = outer, min(4 * outer, WIDEST)
    return (low, _crossing(deviance, highest, inner, outer))


def _crossing(deviance: Callable[[float], float], level: float, low: float, high: float) -> float:
    """Value between low and high at which the deviance crosses the level; NaN where both ends lie on one side of it."""
    try:
        return float(scipy.optimize.brentq(lambda value: deviance(value) - level, low, high, rtol=PRECISION))
    except ValueError:
        return math.nan
