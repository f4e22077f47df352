"""Chains of quintic Bézier corners, the shapes of OpenSim's SmoothSegmentedFunctionFactory, from knots and slopes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.int8]
Knot = tuple[float, float, float]
"""x, y and slope."""

INTERVALS = 512  # in each corner


@dataclass(frozen=True, eq=False)
class BezierChain:
    """A chain of Bézier corners (X(s), Y(s)), s in [0, 1], with X increasing.

    corners  (corners, 2, 6) control points (x, y)
    nodes    (corners, intervals + 1) s at evenly spaced X of each corner, to start the search from
    """

    corners: Array
    nodes: Array


def chain(*knots: Knot, curviness: tuple[float, ...]) -> BezierChain:
    """The chain of corners between knots (x, y, slope)."""
    corners = np.array([_corner(a, b, c) for a, b, c in zip(knots[:-1], knots[1:], curviness, strict=True)])
    s, shares = np.linspace(0.0, 1.0, 4 * INTERVALS + 1), np.linspace(0.0, 1.0, INTERVALS + 1)
    nodes = [np.interp(x[0] + shares * (x[5] - x[0]), _bezier(x, s), s) for x in corners[:, 0]]
    return BezierChain(corners, np.array(nodes))


def evaluate(chain: BezierChain, x: Array, codes: Codes | None) -> Array:
    """y of the chain at x; beyond its ends a straight line with the end's slope. codes as in bezier.evaluate_chain."""
    from solver.functions.bezier import evaluate_chain  # the compiler behind it takes a third of a second to import

    values = np.array(x, dtype=float, order="C")
    codes = np.zeros(values.shape, np.int8) if codes is None else codes
    evaluate_chain(chain.corners, chain.nodes, values.reshape(-1), codes.reshape(-1))
    return values


def _corner(start: Knot, end: Knot, curviness: float) -> Array:
    """Six control points on the two end tangents; the inner ones are doubled, near where the tangents meet."""
    (x0, y0, slope0), (x1, y1, slope1) = start, end
    is_straight = abs(slope0 - slope1) <= np.sqrt(np.finfo(float).eps)
    x = (x0 + x1) / 2 if is_straight else (y1 - y0 - x1 * slope1 + x0 * slope0) / (slope0 - slope1)
    first, last, meet = np.array([x0, y0]), np.array([x1, y1]), np.array([x, (x - x1) * slope1 + y1])
    reach = 0.1 + 0.8 * curviness
    inner_first, inner_last = first + reach * (meet - first), last + reach * (meet - last)
    return np.column_stack([first, inner_first, inner_first, inner_last, inner_last, last])


def _bezier(p: Array, s: Array) -> Array:
    """Σ (5 over k) sᵏ (1 − s)⁵⁻ᵏ p_k, p (6, …)."""
    t = 1.0 - s
    ss, tt = s * s, t * t
    value: Array = tt * t * (tt * p[0] + 5.0 * s * t * p[1] + 10.0 * ss * p[2])
    value += ss * s * (10.0 * tt * p[3] + 5.0 * s * t * p[4] + ss * p[5])
    return value
