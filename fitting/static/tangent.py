"""Tangent stiffness over the load: the exponential law.

    F − F_z = (k0/b) (e^(b y) − 1), so dF/dx = k0 + b (F − F_z): the tangent stiffness is linear in F, and the zero F_z
    of the cell need not be known. Integrated from a load F_r with tangent κ, and ρ = b/κ,

    x = ln(1 + ρ (F − F_r)) / (ρ κ) + a,   with one offset a for every stretch without slip

Law: Schiebl et al. 2025, Sensors 25(15) 4605, who found exponentials for the upper arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.results import EqualByFields
from fitting.results.outcome import FitOutcome
from fitting.uncertainty import Estimate, normal_estimate, student_estimate

SOFTEST, STIFFEST = -0.9, 20.0
"""Bounds of ρ × range of loads, which is the tangent at the highest load over that at the lowest, minus 1."""

MAX_ROUNDS = 500
"""Of the search for the growth."""


@dataclass(frozen=True)
class HeldPoints:
    """Held loads of a donning: force [N], displacement and its standard error [m], number of the offset; all (n,).

    The error of the force is included in that of the displacement, through the stiffness.
    """

    force: NDArray[np.float64]
    x: NDArray[np.float64]
    x_sd: NDArray[np.float64]
    group: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class TangentLaw(EqualByFields):
    """Tangent stiffness k(F) = κ (1 + ρ (F − F_r)): slope 1/κ [m/N], growth ρ [1/N], their (2, 2) covariance.

    gain_sd is the relative standard uncertainty of the load cell's scale, common to all tangents; outcome is that of
    the search for the growth.
    """

    reference_force: float
    slope: float
    growth: float
    covariance: NDArray[np.float64]
    chi_square: float
    dof: int
    gain_sd: float
    outcome: FitOutcome = FitOutcome.CONVERGED

    @property
    def significance(self) -> float:
        """Curvature of the law in standard errors; negative if the cuff softens."""
        return self.growth / math.sqrt(self.covariance[1, 1])

    @property
    def stiffening(self) -> Estimate:
        """b [1/m] of the exponential law."""
        gradient = np.array([-self.growth / self.slope**2, 1 / self.slope])
        return normal_estimate(self.growth / self.slope, _error(gradient, self.covariance))

    def tangent(self, force: float) -> Estimate:
        """k [N/m] at a reading of the load cell [N]."""
        k = (1 + self.growth * (force - self.reference_force)) / self.slope
        gradient = np.array([-k / self.slope, (force - self.reference_force) / self.slope])
        noise = _error(gradient, self.covariance)
        alone = student_estimate(k, noise, self.dof) if self.dof < 30 else normal_estimate(k, noise)
        return alone.widened({"gain": self.gain_sd * k})


def fit_law(points: HeldPoints, gain_sd: float = 0.0) -> TangentLaw | None:
    """The exponential law through held loads, None for too few different loads."""
    groups = np.unique(points.group)
    dof = len(points.force) - len(groups) - 2
    span = float(np.ptp(points.force)) if len(points.force) else 0.0
    if dof < 1 or span <= 0 or max(len(points.force[points.group == group]) for group in groups) < 3:
        return None
    weight = points.x_sd**-2.0
    load = points.force - points.force.min()

    def slope_of(growth: float) -> tuple[float, float]:
        bent = within(_bent(load, growth), points.group, weight)
        displacement = within(points.x, points.group, weight)
        slope = float(weight @ (bent * displacement)) / float(weight @ bent**2)
        return slope, float(weight @ (displacement - slope * bent) ** 2)

    found = scipy.optimize.minimize_scalar(
        lambda growth: slope_of(growth)[1],
        bounds=(SOFTEST / span, STIFFEST / span),
        method="bounded",
        options={"xatol": 1e-6 / span, "maxiter": MAX_ROUNDS},
    )
    growth = float(found.x)
    slope, chi_square = slope_of(growth)
    if slope <= 0:
        return None
    step = 1e-4 / span
    bending = slope * (_bent(load, growth + step) - _bent(load, growth - step)) / (2 * step)
    columns = np.column_stack([within(column, points.group, weight) for column in (_bent(load, growth), bending)])
    covariance = np.asarray(np.linalg.inv((columns.T * weight) @ columns) * max(1.0, chi_square / dof), np.float64)
    outcome = FitOutcome.CONVERGED if found.success else FitOutcome.NOT_CONVERGED
    return TangentLaw(float(points.force.min()), slope, growth, covariance, chi_square, dof, gain_sd, outcome)


def within(values: NDArray[np.float64], group: NDArray[np.intp], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (n,) minus their weighted mean in their group."""
    total = np.bincount(group, weight)
    mean = np.bincount(group, weight * values) / np.where(total > 0, total, 1.0)
    return np.asarray(values - mean[group])


def _bent(load: NDArray[np.float64], growth: float) -> NDArray[np.float64]:
    """ln(1 + ρ load)/ρ; its series for small ρ."""
    if abs(growth) * float(load.max()) < 1e-6:
        return np.asarray(load - growth * load**2 / 2)
    return np.asarray(np.log1p(growth * load) / growth)


def _error(gradient: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    return math.sqrt(float(gradient @ covariance @ gradient))
