"""Chains of quintic Bézier corners, y of x; compiled."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

NEWTON_STEPS = 4  # from between two nodes; each squares the error, and two are usually enough
LAST_STEP = 1e-8  # of s: the error after a step of this size is of the order of its square
CONVERGED, NOT_CONVERGED = 0, 1
"""Outcome codes."""


@compiled_for_python
def evaluate_chain(corners: Array, nodes: Array, values: Array, codes: Codes) -> None:
    """Turn values (n,) of x into those of y: corners (corners, 2, 6) and nodes as in BezierChain.

    codes (n,) is set to NOT_CONVERGED where the last step of Newton's method is still large, else left as it is.
    """
    first, last = corners[0], corners[-1]
    for i in range(len(values)):
        x = values[i]
        inside = min(max(x, first[0, 0]), last[0, 5])
        corner, s, is_near = _locate(corners, nodes, inside)
        if not is_near:
            codes[i] = NOT_CONVERGED
        y = _point(corners[corner, 1], s)
        if x < first[0, 0]:
            y += (x - first[0, 0]) * (first[1, 1] - first[1, 0]) / (first[0, 1] - first[0, 0])
        elif x > last[0, 5]:
            y += (x - last[0, 5]) * (last[1, 5] - last[1, 4]) / (last[0, 5] - last[0, 4])
        values[i] = y


@compiled
def value_and_slope(corners: Array, nodes: Array, x: float) -> tuple[float, float]:
    """y of one x and dy/dx; beyond the ends of the chain a straight line."""
    first, last = corners[0], corners[-1]
    if x < first[0, 0]:
        slope = (first[1, 1] - first[1, 0]) / (first[0, 1] - first[0, 0])
        return first[1, 0] + (x - first[0, 0]) * slope, slope
    if x > last[0, 5]:
        slope = (last[1, 5] - last[1, 4]) / (last[0, 5] - last[0, 4])
        return last[1, 5] + (x - last[0, 5]) * slope, slope
    corner, s, _ = _locate(corners, nodes, x)
    return _point(corners[corner, 1], s), _slope(corners[corner, 1], s) / _slope(corners[corner, 0], s)


@compiled
def _locate(corners: Array, nodes: Array, x: float) -> tuple[int, float, bool]:
    """The corner in which x lies, its s there, and whether Newton's method has converged to it."""
    corner, intervals, step = 0, nodes.shape[1] - 1, inf
    while corner < len(corners) - 1 and x >= corners[corner + 1, 0, 0]:
        corner += 1
    X = corners[corner, 0]
    place = (x - X[0]) / (X[5] - X[0]) * intervals
    node = min(int(place), intervals - 1) if place > 0.0 else 0  # 0 if x is not a number
    s = nodes[corner, node] + (place - node) * (nodes[corner, node + 1] - nodes[corner, node])
    for _ in range(NEWTON_STEPS):
        step = (_point(X, s) - x) / _slope(X, s)
        s -= step
        if abs(step) <= LAST_STEP:
            break
    return corner, s, abs(step) <= LAST_STEP


@compiled
def _point(p: Array, s: float) -> float:
    """Σ (5 over k) sᵏ (1 − s)⁵⁻ᵏ p_k."""
    t = 1.0 - s
    ss, tt = s * s, t * t
    start = tt * t * (tt * p[0] + 5.0 * s * t * p[1] + 10.0 * ss * p[2])
    return float(start + ss * s * (10.0 * tt * p[3] + 5.0 * s * t * p[4] + ss * p[5]))


@compiled
def _slope(p: Array, s: float) -> float:
    t = 1.0 - s
    ss, tt = s * s, t * t
    inner = 4.0 * tt * (p[2] - p[1]) + 6.0 * s * t * (p[3] - p[2]) + 4.0 * ss * (p[4] - p[3])
    return float(5.0 * (tt * tt * (p[1] - p[0]) + s * t * inner + ss * ss * (p[5] - p[4])))
