"""Restricted likelihood (REML) of a linear mixed model with known error covariance, and its maximum.

    y = X β + Σ_i Z_i u_i + e,   u_i ~ N(0, θ_i I),   e ~ N(0, R), R known
    V(θ) = R + Σ_i θ_i Z_i Z_i'

Error contrasts K'y with K'X = 0 have the restricted likelihood (Patterson and Thompson 1971, Biometrika 58:545)

    −2 ℓ(θ) = log |K'VK| + (K'y)' (K'VK)⁻¹ (K'y)

up to a constant. K is an orthonormal basis, so that no fixed effect appears below.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.results.codes import FitOutcome

Array = NDArray[np.float64]

ROUNDS = 200
SMALLEST_STEP = 1e-5
"""Standard errors by which a component may still change in the last round."""
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
    """θ (components,) that maximises the restricted likelihood over θ ≥ 0, over the square of the scale; or the other
    coordinates of the likelihood.
    """

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
    lower, failed = scipy.linalg.lapack.dpotrf(contrasts.covariance(theta), lower=1)
    if failed:
        raise scipy.linalg.LinAlgError("the covariance is singular")
    whitened, _ = scipy.linalg.lapack.dtrtrs(lower, contrasts.columns, lower=1)
    inner = whitened.T @ whitened
    across, projected = inner[:-1, :-1], inner[:-1, -1]  # Z_i' V⁻¹ Z_j and Z_i' V⁻¹ y
    owners = contrasts.owners
    information = owners.T @ across**2 @ owners / 2
    observed = owners.T @ (projected[:, np.newaxis] * projected * across) @ owners - information
    gradient = (across.diagonal() - projected**2) @ owners
    return Curvature(2 * float(np.log(lower.diagonal()).sum()) + float(inner[-1, -1]), gradient, information, observed)


def maximise(contrasts: ErrorContrasts, start: Array | None = None) -> RemlSolution:
    """Newton's method and Fisher scoring with θ ≥ 0: a component at zero whose likelihood falls with it is held there.

    Raises LinAlgError where V is singular at the start, as for values without any variance.
    """
    return maximise_from(partial(evaluate, contrasts), np.ones(contrasts.count) if start is None else start)


Likelihood = Callable[[Array], Curvature]
"""θ, or other coordinates of it → the curvature there."""


def maximise_from(
    likelihood: Likelihood, theta: Array, smallest_step: float = SMALLEST_STEP, held: int | None = None
) -> RemlSolution:
    """Maximise a restricted likelihood from a start, with one component held if it is given."""
    here = likelihood(theta)
    for _ in range(ROUNDS):
        free = (theta > 0) | (here.gradient < 0)
        if held is not None:
            free[held] = False
        step = np.zeros_like(theta)
        if free.any():
            step[free] = _newton_step(here, free)
        if np.sqrt(step @ here.information @ step) < smallest_step:
            return RemlSolution(theta, here, FitOutcome.CONVERGED)
        moved = _descend(likelihood, theta, here, step)
        if moved is None:
            break
        theta, here = moved
    return RemlSolution(theta, here, FitOutcome.NOT_CONVERGED)


def _newton_step(here: Curvature, free: NDArray[np.bool_]) -> Array:
    """Newton's step, or that of Fisher scoring where the observed information is not positive definite."""
    score, chosen = -here.gradient[free] / 2, np.ix_(free, free)
    _, step, failed = scipy.linalg.lapack.dposv(here.observed[chosen], score)
    return scipy.linalg.lstsq(here.information[chosen], score)[0] if failed else step


def _descend(likelihood: Likelihood, theta: Array, here: Curvature, step: Array) -> tuple[Array, Curvature] | None:
    """The longest of halved steps that lowers the deviance; None if not even the shortest does."""
    for halving in range(HALVINGS):
        tried = np.maximum(0.0, theta + step / 2**halving)
        try:
            there = likelihood(tried)
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
