"""Estimates and intervals of fixed effects in small samples (Kenward and Roger 1997, Biometrics 53:983).

For one linear function l'β their F statistic is t² with ν degrees of freedom, and their scale factor is 1:

    Φ = (X'V⁻¹X)⁻¹,  P_i = −X'V⁻¹V_iV⁻¹X,  Q_ij = X'V⁻¹V_iV⁻¹V_jV⁻¹X,  W = covariance of θ̂
    Φ_A = Φ + 2 Φ {Σ_ij W_ij (Q_ij − P_i Φ P_j)} Φ
    ν = 2 (l'Φl)² / Σ_ij W_ij (l'ΦP_iΦl) (l'ΦP_jΦl)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from fitting.study.reml import Array
from fitting.study.variance_components import MixedModel
from fitting.uncertainty import NORMAL_95

LARGE_DOF = 1e6
"""Above, and where no variance is estimated, the interval is the normal one."""


@dataclass(frozen=True)
class FixedEffect:
    """l'β, its standard error, degrees of freedom and 95 % interval, in the unit of the values."""

    value: float
    standard_error: float
    dof: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class _Adjusted:
    beta: Array
    covariance: Array  # Φ
    adjusted: Array  # Φ_A
    first: Array  # (components, p, p): P_i


def estimate_effect(model: MixedModel, weights: Array, most_dof: float = math.inf) -> FixedEffect:
    """l'β of the model for weights l (p,).

    most_dof limits the degrees of freedom: a variance that is estimated as zero is not known to be zero.
    """
    found = _adjust(model)
    value, error = float(weights @ found.beta), math.sqrt(float(weights @ found.adjusted @ weights))
    slopes = _slopes(found, weights)
    dof = min(most_dof, _dof(float(weights @ found.covariance @ weights), slopes, model))
    reach = quantile(dof) * error
    return FixedEffect(value, error, dof, (value - reach, value + reach))


def predict_observation(model: MixedModel, shares: Array, noise: float, most_dof: float = math.inf) -> FixedEffect:
    """95 % prediction interval of a new measurement about the mean of a model without other fixed effects.

    shares (components,): the part of each variance that it carries, as 1/r of that between r repeats; noise: variance
    of its known error. The degrees of freedom are those of Satterthwaite for the sum of all variances, limited as in
    estimate_effect.
    """
    found, weights = _adjust(model), np.ones(1)
    variance = float(shares @ model.theta) + noise + float(found.adjusted[0, 0])
    dof = min(most_dof, _dof(variance, shares + _slopes(found, weights), model))
    value, error = float(found.beta[0]), math.sqrt(variance)
    reach = quantile(dof) * error
    return FixedEffect(value, error, dof, (value - reach, value + reach))


def quantile(dof: float) -> float:
    """97.5 % quantile of Student's t."""
    return float(scipy.stats.t.ppf(0.975, dof)) if dof < LARGE_DOF else NORMAL_95


def _adjust(model: MixedModel) -> _Adjusted:
    factor = scipy.linalg.cho_factor(model.covariance())
    whitened = scipy.linalg.cho_solve(factor, model.fixed)  # V⁻¹X
    phi: Array = np.linalg.inv(model.fixed.T @ whitened).astype(np.float64)
    beta = phi @ whitened.T @ model.values
    turned = model.matrices @ whitened  # V_iV⁻¹X
    first = -np.einsum("np,inq->ipq", whitened, turned)
    solved = np.array([scipy.linalg.cho_solve(factor, matrix) for matrix in turned]).reshape(turned.shape)
    second = np.einsum("inp,jnq->ijpq", turned, solved)
    weights = model.theta_covariance()
    excess = np.einsum("ij,ijpq->pq", weights, second - np.einsum("ipr,rs,jsq->ijpq", first, phi, first))
    return _Adjusted(beta, phi, phi + 2 * phi @ excess @ phi, first)


def _slopes(found: _Adjusted, weights: Array) -> Array:
    """∂ l'Φl / ∂θ_i (components,)."""
    reached = found.covariance @ weights
    slopes: Array = -np.einsum("p,ipq,q->i", reached, found.first, reached)
    return slopes


def _dof(variance: float, slopes: Array, model: MixedModel) -> float:
    spread = float(slopes @ model.theta_covariance() @ slopes)
    return max(1.0, 2 * variance**2 / spread) if spread > 2 * variance**2 / LARGE_DOF else LARGE_DOF
