"""The second-order cone {(x₀, x̄): x₀ ≥ |x̄|} in three dimensions, for compiled code: its rays are tuples.

Its algebra has products x∘y = (x·y, x₀ ȳ + y₀ x̄). A scaling W = (w̄, η) is η times a symmetric hyperbolic rotation
(Vandenberghe, The CVXOPT linear and quadratic cone program solvers, 2010, section 4).
"""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled

Array = NDArray[np.float64]
Ray = tuple[float, float, float]
Scaling = tuple[float, float, float, float]


@compiled
def read_ray(v: Array) -> Ray:
    return (v[-3], v[-2], v[-1])


@compiled
def advance(x: Ray, length: float, y: Ray) -> Ray:
    return (x[0] + length * y[0], x[1] + length * y[1], x[2] + length * y[2])


@compiled
def inner(x: Ray, y: Ray) -> float:
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@compiled
def quotient(x: Ray, y: Ray) -> Ray:
    """The point whose product with x is y."""
    first = (x[0] * y[0] - x[1] * y[1] - x[2] * y[2]) / _depth(x) ** 2
    return (first, (y[1] - x[1] * first) / x[0], (y[2] - x[2] * first) / x[0])


@compiled
def approach(x: Ray, dx: Ray) -> float:
    """The inverse of the longest step from x along dx that stays in the cone; not positive where any does."""
    size = _depth(x)
    x0, x1, x2 = x[0] / size, x[1] / size, x[2] / size
    first = x0 * dx[0] - x1 * dx[1] - x2 * dx[2]
    share = (first + dx[0]) / (x0 + 1.0)
    return (hypot(dx[1] - share * x1, dx[2] - share * x2) - first) / size


@compiled
def project(ray: Ray) -> Ray:
    """The nearest point of the cone."""
    off = hypot(ray[1], ray[2])
    if ray[0] >= off:
        return ray
    if ray[0] <= -off:
        return (0.0, 0.0, 0.0)
    half = 0.5 * (ray[0] + off)
    return (half, half * ray[1] / off, half * ray[2] / off)


@compiled
def project_rows(matrix: Array, first: int, ray: Ray) -> None:
    """Rows of the cone's errors in place of those of s: with Π the projection's derivative, I − Π (I − rows)."""
    off = hypot(ray[1], ray[2])
    if ray[0] >= off:  # λ − s in the cone: s must vanish, and its rows stand as they are
        return
    if ray[0] <= -off:
        matrix[first:] = 0.0
        for i in range(3):
            matrix[first + i, first + i] = 1.0
        return
    x, y, ratio = ray[1] / off, ray[2] / off, ray[0] / off
    for j in range(len(matrix)):
        for i in range(3):
            matrix[first + i, j] = (1.0 if j == first + i else 0.0) - matrix[first + i, j]
        p, q, r = matrix[first, j], matrix[first + 1, j], matrix[first + 2, j]
        advance = x * q + y * r
        matrix[first, j] = 0.5 * (p + advance)
        matrix[first + 1, j] = 0.5 * (x * p + (1.0 + ratio) * q - ratio * x * advance)
        matrix[first + 2, j] = 0.5 * (y * p + (1.0 + ratio) * r - ratio * y * advance)
        for i in range(3):
            matrix[first + i, j] = (1.0 if j == first + i else 0.0) - matrix[first + i, j]


@compiled
def scaling(s: Ray, multiplier: Ray) -> Scaling:
    """(w̄, η) with W² λ = s."""
    size, other = _depth(s), _depth(multiplier)
    half = sqrt(2.0 + 2.0 * max(inner(s, multiplier) / (size * other), 1.0))
    return (
        (s[0] / size + multiplier[0] / other) / half,
        (s[1] / size - multiplier[1] / other) / half,
        (s[2] / size - multiplier[2] / other) / half,
        sqrt(size / other),
    )


@compiled
def scaled(W: Scaling, x: Ray) -> Ray:
    """W x."""
    advance = W[1] * x[1] + W[2] * x[2]
    more = advance / (1.0 + W[0]) + x[0]
    return (W[3] * (W[0] * x[0] + advance), W[3] * (x[1] + more * W[1]), W[3] * (x[2] + more * W[2]))


@compiled
def add_square(matrix: Array, W: Scaling) -> None:
    """W² added to the last rows and columns."""
    p, square = len(matrix) - 3, W[3] * W[3]
    for i in range(3):
        for j in range(3):
            matrix[p + i, p + j] += 2.0 * square * W[i] * W[j]
        matrix[p + i, p + i] += square if i else -square


@compiled
def centred(s: Ray, ds: Ray, multiplier: Ray, change: Ray, W: Scaling, target: float) -> Ray:
    """−s + W x with Wλ ∘ x = target − W⁻¹ ds ∘ W dλ: the aim of the corrector after a predictor."""
    x, y = scaled((W[0], -W[1], -W[2], 1.0 / W[3]), ds), scaled(W, change)
    rest = (target - inner(x, y), -(x[0] * y[1] + y[0] * x[1]), -(x[0] * y[2] + y[0] * x[2]))
    return advance(scaled(W, quotient(scaled(W, multiplier), rest)), -1.0, s)


@compiled
def _depth(x: Ray) -> float:
    """√(x₀² − |x̄|²), a size of a point inside the cone."""
    off = hypot(x[1], x[2])
    return sqrt(max((x[0] - off) * (x[0] + off), 1e-300))
