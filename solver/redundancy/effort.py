"""The muscle effort, (10) of the source study: exponent, weights, and a user's own convex cost, in one place.

    Σ w φ(a) + Σ w r²,   φ(a) = aᵖ with p = 2 or 3, or an ActivationCost

a are the activations of the muscles, r the controls of the actuators, which keep squares. The compiled solver has the
powers (`slope` and the functions after it, with q = p w); another cost is minimised by quadratic programs of its slope
and curvature (convex_frames.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import ModelError

Array = NDArray[np.float64]
Exponent = Literal[2, 3]
Number = TypeVar("Number", float, Array)
SAMPLES = 21  # activations from 0 to 1 at which a cost is checked
DERIVATIVE_TOLERANCE = 0.1  # of the largest change between samples, for the integral of the derivative
PROXIMAL_SHARE = 0.01  # of the greatest slope: where a cost is straighter, steps are those of a proximal method
ROUND_OFF = 1e-9  # of the greatest slope of all activations


@dataclass(frozen=True)
class ActivationCost:
    """A convex cost φ of an activation in place of its power, as cost of RedundancyOptions.

        ActivationCost(lambda a: a**4, lambda a: 4 * a**3, lambda a: 12 * a**2)

    value, slope and curvature are functions of activations (…, muscles) from 0 to 1, entry by entry, with results of
    the same shape: φ, φ' and φ'' ≥ 0. Muscles may differ: `p * a ** (p - 1)` with p (muscles,) in the model's order.
    The weights of the options multiply φ. Where φ'' is zero, the activations of least effort may not be unique.
    """

    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    curvature: Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Effort:
    """Terms of the effort of x (…, controls), muscles first, or of the muscles alone; their slopes and curvatures.

    weights (controls,);  muscles, the number of controls with φ;  exponent p, without a meaning where there is a cost
    """

    weights: Array
    muscles: int
    exponent: int = 2
    cost: ActivationCost | None = None

    @property
    def has_quadratic_steps(self) -> bool:
        """Whether a quadratic program takes its slope and curvature; the compiled solver has cubes of its own."""
        return self.exponent == 2 or self.cost is not None

    def terms(self, x: Array) -> Array:
        """w φ(a), then w r² of the actuators."""
        terms: Array = self.weights[: x.shape[-1]] * x**2
        if self.cost is not None:
            terms[..., : self.muscles] = self.weights[: self.muscles] * self.cost.value(x[..., : self.muscles])
        elif self.exponent == 3:
            terms[..., : self.muscles] *= x[..., : self.muscles]
        return terms

    def slopes(self, activations: Array) -> Array:
        """Derivatives of the terms of the muscles by their activations (…, muscles)."""
        weights = self.weights[: self.muscles]
        if self.cost is not None:
            return weights * self.cost.slope(activations)
        return slope(self.exponent * weights, activations, self.exponent)

    def curvatures(self, activations: Array) -> Array:
        """Second derivatives of the terms of the muscles by their activations (…, muscles); positive with a cost."""
        weights = self.weights[: self.muscles]
        if self.cost is not None:
            ends = np.repeat([[0.0], [1.0]], self.muscles, axis=1)  # at one of them a convex function is steepest
            here, anywhere = np.abs(self.slopes(activations)).max(), np.abs(self.slopes(ends)).max()
            least = max(PROXIMAL_SHARE * here, ROUND_OFF * anywhere)
            curvatures: Array = np.maximum(weights * self.cost.curvature(activations), least)
            return curvatures
        return curvature(self.exponent * weights, activations, self.exponent)


@lru_cache(maxsize=8)  # a stream builds a problem in every frame
def ensure_convex(cost: ActivationCost, muscles: int) -> None:
    """Raise ModelError for a cost with values that are not finite or of another shape, a negative curvature, or a slope
    that is not the derivative of the value.
    """
    a = np.repeat(np.linspace(0.0, 1.0, SAMPLES)[:, None], muscles, axis=1)
    found = {name: np.asarray(getattr(cost, name)(a.copy())) for name in ("value", "slope", "curvature")}
    for name, values in found.items():
        if values.shape != a.shape or not np.isfinite(values).all():
            raise _wrong_cost(
                f"{name} should return finite numbers of shape {a.shape}, as that of the activations, and returned "
                f"{np.count_nonzero(np.isfinite(values))} finite numbers of shape {values.shape}"
            )
    if (found["curvature"] < 0).any():
        raise _wrong_cost(f"curvature should be at least 0 and is {found['curvature'].min():g}")
    for name, lower in (("slope", "value"), ("curvature", "slope")):
        change, expected = np.diff(found[lower], axis=0), _integrals(getattr(cost, name), a)
        missed = np.abs(change - expected).max()
        if missed > DERIVATIVE_TOLERANCE * np.abs(expected).max():
            raise _wrong_cost(
                f"{name} should be the derivative of {lower}, and its integral differs from the change of {lower} by "
                f"{missed:.2g}"
            )


def _integrals(function: Callable[[Array], Array], a: Array) -> Array:
    """Integrals over the intervals between the rows of a, by Gauss and Legendre's rule with three points."""
    points, weights = np.polynomial.legendre.leggauss(3)
    half = 0.5 * np.diff(a, axis=0)
    rule = zip(points, weights, strict=True)
    inside = [half * weight * function(a[:-1] + half * (1.0 + point)) for point, weight in rule]
    total: Array = np.sum(inside, axis=0)
    return total


def _wrong_cost(found: str) -> ModelError:
    return ModelError(
        f"a cost of activations should be convex and smooth: {found}; correct it", SolverCode.WRONG_OPTION
    )


def slope(q: Number, a: Number, exponent: int) -> Number:
    """q aᵖ⁻¹."""
    return q * a if exponent == 2 else q * a * a


def curvature(q: Number, a: Number, exponent: int) -> Number:
    """(p − 1) q aᵖ⁻²; with p = 3 it vanishes at rest."""
    return q if exponent == 2 else 2.0 * q * a


def activation(q: float, gain: float, exponent: int) -> float:
    """The activation with this slope; with p = 3 there is none below zero, and a muscle rests."""
    return gain / q if exponent == 2 else sqrt(max(gain, 0.0) / q)


def activation_per_slope(q: float, a: float, exponent: int) -> float:
    """Derivative of the activation by its slope, 1 / curvature; 0 for a muscle that rests at p = 3."""
    if exponent == 2:
        return 1.0 / q
    return 0.0 if a == 0.0 else 1.0 / (2.0 * q * a)
