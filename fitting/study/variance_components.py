"""Variance components of repeated measurements with known measurement noise, by REML."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import scipy

from fitting.errors import FitError
from fitting.results.outcome import FitOutcome
from fitting.study.profile import component_interval
from fitting.study.reml import Array, ErrorContrasts, RemlSolution, contrast, dependencies, maximise


class TooFewObservations(FitError):
    """No component can be estimated: there are no more observations than fixed effects."""


class ComponentOutcome(StrEnum):
    """How the estimate of a variance component ended.

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
        free = self.theta > 0
        covariance = np.zeros((len(self.theta),) * 2)
        if free.any():
            covariance[np.ix_(free, free)] = np.linalg.pinv(self.information[np.ix_(free, free)])
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
        raise TooFewObservations(f"{len(values)} observations, expected more than {fixed.shape[1]}")
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
        matrices=np.array([incidences[i] @ incidences[i].T for i in kept]).reshape(-1, len(values), len(values)),
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
