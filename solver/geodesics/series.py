"""Trace a geodesic of an ellipsoid by its Taylor series.

With A = diag(1/a²) and g = |A x|², the geodesic x(s) and its Jacobi fields j(s) obey

    x″ = −C p A x,   j″ = −K j,   p = 1/g²,   K = p / (a₁ a₂ a₃)²

where C = g x′·A x′ is constant along it (Joachimsthal). Products of series are convolutions, and p follows from
g p′ = −2 g′ p, so that each coefficient follows from those before it; the steps are as long as the last ones allow.
"""

from __future__ import annotations

from math import exp, inf, log

from solver.compiled import compiled
from solver.vectors import Array, Vector, divide, dot
from solver.wrapping.path_tables import NOT_CONVERGED, Codes

ORDER, ROUGH_ORDER, JACOBI_ORDER = 18, 8, 10
MOST_STEPS = 1000
EXACT, ROUGH = 1e-16, 1e-8  # accuracy: what the truncated terms may add to a step, in semi-axes
X, G, P, J, ROWS = 0, 3, 4, 5, 7  # rows of the series: x in three, g, p, and j in two

JacobiScalars = tuple[float, float, float, float]
Five = tuple[float, float, float, float, float]


@compiled
def trace_on_ellipsoid(
    size: Vector, x: Vector, t: Vector, length: float, accuracy: float, series: Array, code: Codes
) -> tuple[Vector, Vector, JacobiScalars]:
    """End, direction there and Jacobi scalars (trace.py) of the geodesic of an ellipsoid with these semi-axes.

    accuracy  of end and direction, from EXACT on; that of the Jacobi scalars is lower, enough for derivatives
    series    (ROWS, ORDER + 1) working memory
    code      (1,) set to NOT_CONVERGED where MOST_STEPS steps do not reach the end
    """
    a, r, da, dr = 1.0, 0.0, 0.0, 1.0
    order, left = ORDER if accuracy < ROUGH else ROUGH_ORDER, length
    for _ in range(MOST_STEPS):
        if not abs(left) > 0.0:
            break
        longest = _expand(size, x, t, order, accuracy, series)
        step = left if abs(left) <= longest else (longest if left > 0.0 else -longest)
        x, t = _point_and_direction(series, order, step)
        a1, r1, da1, dr1 = _jacobi_scalars(series, min(order, JACOBI_ORDER), step)
        a, da = a1 * a + r1 * da, da1 * a + dr1 * da
        r, dr = a1 * r + r1 * dr, da1 * r + dr1 * dr
        left -= step
    else:
        code[0] = NOT_CONVERGED
    return x, t, (a, r, da, dr)


@compiled
def _expand(size: Vector, x: Vector, t: Vector, order: int, accuracy: float, series: Array) -> float:
    """Fill the series at x in direction t; returns the length of step for which they are accurate."""
    A = (1.0 / (size[0] * size[0]), 1.0 / (size[1] * size[1]), 1.0 / (size[2] * size[2]))
    B = (A[0] * A[0], A[1] * A[1], A[2] * A[2])
    for i in range(3):
        series[X + i, 0], series[X + i, 1] = x[i], t[i]
    series[J, 0], series[J, 1], series[J + 1, 0], series[J + 1, 1] = 1.0, 0.0, 0.0, 1.0
    g0 = B[0] * x[0] * x[0] + B[1] * x[1] * x[1] + B[2] * x[2] * x[2]
    C = g0 * (A[0] * t[0] * t[0] + A[1] * t[1] * t[1] + A[2] * t[2] * t[2])
    curvature = A[0] * A[1] * A[2]
    for k in range(order - 1):
        series[G, k] = _weighted_square(series, B, k)
        series[P, k] = _power(series, k) / (k * g0) if k > 0 else 1.0 / (g0 * g0)
        share = 1.0 / ((k + 1) * (k + 2))
        x0, x1, x2, j0, j1 = _products(series, k) if k + 2 <= JACOBI_ORDER else _products_without_jacobi(series, k)
        series[X, k + 2] = -C * A[0] * x0 * share
        series[X + 1, k + 2] = -C * A[1] * x1 * share
        series[X + 2, k + 2] = -C * A[2] * x2 * share
        series[J, k + 2] = -curvature * j0 * share
        series[J + 1, k + 2] = -curvature * j1 * share
    return min(_step_length(size, series, order, accuracy), _step_length(size, series, order - 1, accuracy))


@compiled
def _weighted_square(series: Array, weights: Vector, k: int) -> float:
    """The k-th coefficient of Σ w x²; each product counts twice but the middle one."""
    x0 = x1 = x2 = 0.0
    for j in range((k + 1) // 2):
        x0 += series[0, j] * series[0, k - j]
        x1 += series[1, j] * series[1, k - j]
        x2 += series[2, j] * series[2, k - j]
    if k % 2 == 0:
        x0 += 0.5 * series[0, k // 2] * series[0, k // 2]
        x1 += 0.5 * series[1, k // 2] * series[1, k // 2]
        x2 += 0.5 * series[2, k // 2] * series[2, k // 2]
    return 2.0 * (weights[0] * x0 + weights[1] * x1 + weights[2] * x2)


@compiled
def _power(series: Array, k: int) -> float:
    """− Σ (k + j) g_j p_(k − j) over j from 1; in two sums, which the processor adds up at the same time."""
    odd = even = 0.0
    for j in range(1, k, 2):
        odd -= (k + j) * series[G, j] * series[P, k - j]
        even -= (k + j + 1) * series[G, j + 1] * series[P, k - j - 1]
    if k % 2 == 1:
        odd -= 2 * k * series[G, k] * series[P, 0]
    return odd + even


@compiled
def _products(series: Array, k: int) -> Five:
    """The k-th coefficients of p times x and j."""
    x0 = x1 = x2 = j0 = j1 = 0.0
    for j in range(k + 1):
        p = series[P, k - j]
        x0 += p * series[0, j]
        x1 += p * series[1, j]
        x2 += p * series[2, j]
        j0 += p * series[J, j]
        j1 += p * series[J + 1, j]
    return x0, x1, x2, j0, j1


@compiled
def _products_without_jacobi(series: Array, k: int) -> Five:
    """The same without j."""
    x0 = x1 = x2 = 0.0
    for j in range(k + 1):
        p = series[P, k - j]
        x0 += p * series[0, j]
        x1 += p * series[1, j]
        x2 += p * series[2, j]
    return x0, x1, x2, 0.0, 0.0


@compiled
def _step_length(size: Vector, series: Array, k: int, accuracy: float) -> float:
    """Length of step at which the k-th term is as small as the accuracy asks for."""
    term = divide((series[X, k], series[X + 1, k], series[X + 2, k]), size)
    square = dot(term, term)
    return exp((log(accuracy) - 0.5 * log(square)) / k) if square > 0.0 else inf


@compiled
def _point_and_direction(series: Array, order: int, s: float) -> tuple[Vector, Vector]:
    x0 = x1 = x2 = t0 = t1 = t2 = 0.0
    for k in range(order, 0, -1):
        x0, x1, x2 = x0 * s + series[0, k], x1 * s + series[1, k], x2 * s + series[2, k]
        t0, t1, t2 = t0 * s + k * series[0, k], t1 * s + k * series[1, k], t2 * s + k * series[2, k]
    return (x0 * s + series[0, 0], x1 * s + series[1, 0], x2 * s + series[2, 0]), (t0, t1, t2)


@compiled
def _jacobi_scalars(series: Array, order: int, s: float) -> JacobiScalars:
    a = r = da = dr = 0.0
    for k in range(order, 0, -1):
        a, r = a * s + series[J, k], r * s + series[J + 1, k]
        da, dr = da * s + k * series[J, k], dr * s + k * series[J + 1, k]
    return a * s + series[J, 0], r * s + series[J + 1, 0], da, dr
