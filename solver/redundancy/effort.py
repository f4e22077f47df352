"""The effort of one activation, q aᵖ / p with p = 2 or 3: slope, curvature, and what follows from a slope. Compiled."""

from __future__ import annotations

from math import sqrt

from solver.compiled import compiled


@compiled
def slope(q: float, a: float, exponent: int) -> float:
    """q aᵖ⁻¹."""
    return q * a if exponent == 2 else q * a * a


@compiled
def curvature(q: float, a: float, exponent: int) -> float:
    """(p − 1) q aᵖ⁻²; with p = 3 it vanishes at rest."""
    return q if exponent == 2 else 2.0 * q * a


@compiled
def activation(q: float, gain: float, exponent: int) -> float:
    """The activation with this slope; with p = 3 there is none below zero, and a muscle rests."""
    return gain / q if exponent == 2 else sqrt(max(gain, 0.0) / q)


@compiled
def activation_per_slope(q: float, a: float, exponent: int) -> float:
    """Derivative of the activation by its slope, 1 / curvature; 0 for a muscle that rests at p = 3."""
    return 0.0 if exponent == 3 and a == 0.0 else 1.0 / curvature(q, a, exponent)
