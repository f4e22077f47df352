"""Trace a geodesic of an ellipsoid by its Taylor series.

With A = diag(1/a²) and g = |A x|², the geodesic x(s) and its Jacobi fields j(s) obey

    x″ = −C p A x,   j″ = −K j,   p = 1/g²,   K = p / (a₁ a₂ a₃)²

where C = g x′·A x′ is constant along it (Joachimsthal). Products of series are convolutions, and p follows from
g p′ = −2 g′ p, so that each coefficient follows from those before it. The series ends where its terms no longer matter.
Where they still do at the highest order, a step goes as far as the last ones allow, and another series follows.
"""

from __future__ import annotations

from math import inf

from solver.compiled import compiled
from solver.vectors import Array, Vector
from solver.wrapping.path_tables import NOT_CONVERGED, Codes

ORDER, JACOBI_ORDER = 30, 12
MOST_STEPS = 1000
EXACT = 1e-16  # accuracy: what the truncated terms may add to a step, in semi-axes
ROW_G, ROW_P, ROW_J, ROWS = 3, 4, 5, 7  # rows of the series: x in three, g, p, and j in two

JacobiScalars = tuple[float, float, float, float]
Trace = tuple[Vector, Vector, JacobiScalars]
"""A point of a geodesic, the direction there, and the Jacobi scalars (trace.py)."""


@compiled
def trace_on_ellipsoid(
    size: Vector, x: Vector, t: Vector, half: float, accuracy: float, series: Array, code: Codes
) -> tuple[Trace, Trace]:
    """Both ends, −half and +half along it, of the geodesic of an ellipsoid with these semi-axes.

    accuracy  of ends and directions, from EXACT on; that of the Jacobi scalars is lower, enough for derivatives
    series    (ROWS, ORDER + 1) working memory
    code      (1,) set to NOT_CONVERGED where MOST_STEPS steps do not reach an end
    """
    order, step = _expand(size, x, t, half, accuracy, series)
    first, last = _evaluate(series, order, -step), _evaluate(series, order, step)
    if step != half:
        first = _continue(size, first, step - half, accuracy, series, code)
        last = _continue(size, last, half - step, accuracy, series, code)
    return first, last


@compiled
def _continue(size: Vector, trace: Trace, left: float, accuracy: float, series: Array, code: Codes) -> Trace:
    """The same geodesic further on."""
    x, t, (a, r, da, dr) = trace
    for _ in range(MOST_STEPS):
        if not abs(left) > 0.0:
            break
        order, step = _expand(size, x, t, left, accuracy, series)
        x, t, (a1, r1, da1, dr1) = _evaluate(series, order, step)
        a, da = a1 * a + r1 * da, da1 * a + dr1 * da
        r, dr = a1 * r + r1 * dr, da1 * r + dr1 * dr
        left -= step
    else:
        code[0] = NOT_CONVERGED
    return x, t, (a, r, da, dr)


@compiled
def _expand(size: Vector, x: Vector, t: Vector, left: float, accuracy: float, series: Array) -> tuple[int, float]:
    """Fill the series at x in direction t; returns the order, and how far towards `left` they are accurate."""
    A = (1.0 / (size[0] * size[0]), 1.0 / (size[1] * size[1]), 1.0 / (size[2] * size[2]))
    B = (A[0] * A[0], A[1] * A[1], A[2] * A[2])
    G, P = series[ROW_G], series[ROW_P]
    for i in range(3):
        series[i, 0], series[i, 1] = x[i], t[i]
    series[ROW_J, 0], series[ROW_J, 1], series[ROW_J + 1, 0], series[ROW_J + 1, 1] = 1.0, 0.0, 0.0, 1.0
    g0 = B[0] * x[0] * x[0] + B[1] * x[1] * x[1] + B[2] * x[2] * x[2]
    C = g0 * (A[0] * t[0] * t[0] + A[1] * t[1] * t[1] + A[2] * t[2] * t[2])
    curvature, power, error, previous = A[0] * A[1] * A[2], left * left, inf, inf
    for k in range(ORDER - 1):
        G[k] = _weighted_square(series, B, k)
        P[k] = _power(G, P, k) * (1.0 / (k * g0)) if k > 0 else 1.0 / (g0 * g0)
        share = 1.0 / ((k + 1) * (k + 2))
        x0, x1, x2 = _products(series, k)
        series[0, k + 2] = -C * share * A[0] * x0
        series[1, k + 2] = -C * share * A[1] * x1
        series[2, k + 2] = -C * share * A[2] * x2
        if k + 2 <= JACOBI_ORDER:
            j0, j1 = _jacobi_products(series, k)
            series[ROW_J, k + 2] = -curvature * share * j0
            series[ROW_J + 1, k + 2] = -curvature * share * j1
        power *= left * left
        previous, error = error, power * _square_term(series, A, k + 2)
        if previous <= accuracy * accuracy and error <= accuracy * accuracy:
            return k + 2, left
    return ORDER, left * (accuracy * accuracy / max(previous, error)) ** (0.5 / (ORDER - 1))


# The processor adds up the following sums while it waits for the latest coefficients, which therefore come last.


@compiled
def _weighted_square(series: Array, weights: Vector, k: int) -> float:
    """The k-th coefficient of Σ w x²; each product counts twice but the middle one."""
    X, Y, Z = series[0], series[1], series[2]
    x = y = z = 0.0
    if k % 2 == 0:
        middle = k // 2
        x, y, z = 0.5 * X[middle] * X[middle], 0.5 * Y[middle] * Y[middle], 0.5 * Z[middle] * Z[middle]
    for j in range((k + 1) // 2 - 1, -1, -1):
        x += X[j] * X[k - j]
        y += Y[j] * Y[k - j]
        z += Z[j] * Z[k - j]
    return 2.0 * (weights[0] * x + weights[1] * y + weights[2] * z)


@compiled
def _power(G: Array, P: Array, k: int) -> float:
    """− Σ (k + j) g_j p_(k − j) over j from 1."""
    total = 0.0
    for j in range(1, k + 1):
        total -= (k + j) * G[j] * P[k - j]
    return total


@compiled
def _products(series: Array, k: int) -> Vector:
    """The k-th coefficients of p x."""
    X, Y, Z, P = series[0], series[1], series[2], series[ROW_P]
    x = y = z = 0.0
    for j in range(k, -1, -1):
        p = P[k - j]
        x += p * X[j]
        y += p * Y[j]
        z += p * Z[j]
    return x, y, z


@compiled
def _jacobi_products(series: Array, k: int) -> tuple[float, float]:
    """The k-th coefficients of p j."""
    from_step, from_turn, P = series[ROW_J], series[ROW_J + 1], series[ROW_P]
    step = turn = 0.0
    for j in range(k, -1, -1):
        p = P[k - j]
        step += p * from_step[j]
        turn += p * from_turn[j]
    return step, turn


@compiled
def _square_term(series: Array, A: Vector, k: int) -> float:
    """Square of the k-th coefficient of x, in semi-axes."""
    x, y, z = series[0, k], series[1, k], series[2, k]
    square: float = A[0] * x * x + A[1] * y * y + A[2] * z * z
    return square


@compiled
def _evaluate(series: Array, order: int, s: float) -> Trace:
    x0 = x1 = x2 = t0 = t1 = t2 = a = r = da = dr = 0.0
    for k in range(order, 0, -1):
        x0, x1, x2 = x0 * s + series[0, k], x1 * s + series[1, k], x2 * s + series[2, k]
        t0, t1, t2 = t0 * s + k * series[0, k], t1 * s + k * series[1, k], t2 * s + k * series[2, k]
    for k in range(min(order, JACOBI_ORDER), 0, -1):
        a, r = a * s + series[ROW_J, k], r * s + series[ROW_J + 1, k]
        da, dr = da * s + k * series[ROW_J, k], dr * s + k * series[ROW_J + 1, k]
    x, t = (x0 * s + series[0, 0], x1 * s + series[1, 0], x2 * s + series[2, 0]), (t0, t1, t2)
    return x, t, (a * s + series[ROW_J, 0], r * s + series[ROW_J + 1, 0], da, dr)
