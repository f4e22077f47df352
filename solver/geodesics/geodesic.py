"""Trace a geodesic of a sphere, a cylinder or an ellipsoid from its middle to both ends, with their derivatives.

Points are in the surface's own frame [m]; the geodesic passes a point x of the surface, its middle, in the unit
direction t, n is the outward normal and b = n × t. A neighbouring geodesic is j b away: the Jacobi field j″ + K j = 0
with the Gaussian curvature K. The Jacobi scalars (a, r, a′, r′) are those at an end, with a = 1, a′ = 0, r = 0 and
r′ = 1 in the middle (do Carmo, Differential Geometry of Curves and Surfaces, sec. 5.5).

Trace a geodesic of an ellipsoid by its Taylor series.

With A = diag(1/a²) and g = |A x|², the geodesic x(s) and its Jacobi fields j(s) obey

    x″ = −C p A x,   j″ = −K j,   p = 1/g²,   K = p / (a₁ a₂ a₃)²

where C = g x′·A x′ is constant along it (Joachimsthal). Products of series are convolutions, and p follows from
g p′ = −2 g′ p, so that each coefficient follows from those before it. The series ends where its terms no longer matter.
Where they still do at the highest order, a step goes as far as the last ones allow, and another series follows.
"""

from __future__ import annotations

from math import cos, inf, sin

import numpy as np

from solver.compiled import compiled
from solver.vectors import (
    Array,
    Vector,
    add,
    cross,
    divide,
    dot,
    norm,
    read,
    scale,
    subtract,
    turn,
    turn_back,
    unit,
    write,
)
from solver.wrapping.path_tables import ELLIPSOID, NOT_CONVERGED, SPHERE, Codes, Record

ORDER, JACOBI_ORDER = 30, 12
MOST_STEPS = 1000
EXACT = 1e-16  # largest contribution of the truncated terms to a step, in semi-axes
ROW_G, ROW_P, ROW_J, ROWS = 3, 4, 5, 7  # rows of the series: x in three, g, p, and j in two

JacobiScalars = tuple[float, float, float, float]
Trace = tuple[Vector, Vector, JacobiScalars]
"""A point of a geodesic, the direction there, and the Jacobi scalars (trace.py)."""
# One end of a contact in ground: the place, the path's direction t, the outward normal n and b = n × t; the curvatures
# II(t, t), II(t, b), II(b, b) of the surface there [1/m]; and the Jacobi scalars (trace.py).
END = np.dtype(
    [
        ("place", np.float64, (3,)),
        ("t", np.float64, (3,)),
        ("n", np.float64, (3,)),
        ("b", np.float64, (3,)),
        ("curvatures", np.float64, (3,)),
        ("jacobi", np.float64, (4,)),
    ]
)

# The surface: its kind and dimensions as in WRAP, its pose in ground. The geodesic: in the surface's frame it passes
# `middle` in direction `heading`, and is `length` long; both ends follow from these. A surface is left out of a segment
# that it cannot or must not deflect.
CONTACT = np.dtype(
    [
        ("kind", np.int64),
        ("size", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("origin", np.float64, (3,)),
        ("middle", np.float64, (3,)),
        ("heading", np.float64, (3,)),
        ("length", np.float64),
        ("first", END),
        ("last", END),
        ("is_left_out", np.int64),
    ]
)


@compiled
def trace_geodesic(
    kind: int, size: Vector, x: Vector, t: Vector, length: float, accuracy: float, series: Array, code: Codes
) -> tuple[Trace, Trace]:
    """Both ends of the geodesic of this length, which may be negative; accuracy, series and code are those of
    trace_on_ellipsoid.
    """
    half = 0.5 * length
    if kind == ELLIPSOID:
        return trace_on_ellipsoid(size, x, t, half, accuracy, series, code)
    if kind == SPHERE:
        return _trace_on_sphere(size[0], x, t, -half), _trace_on_sphere(size[0], x, t, half)
    return _trace_on_cylinder(size[0], x, t, -half), _trace_on_cylinder(size[0], x, t, half)


@compiled
def normal_at(kind: int, size: Vector, x: Vector) -> Vector:
    if kind == ELLIPSOID:
        return unit(divide(divide(x, size), size))
    if kind == SPHERE:
        return scale(1.0 / size[0], x)
    return x[0] / size[0], x[1] / size[0], 0.0


@compiled
def normal_curvatures(kind: int, size: Vector, x: Vector, t: Vector, b: Vector) -> Vector:
    """The second fundamental form of tangents t and b at x: (t, t), (t, b), (b, b) [1/m]; n changes by (t, b) along b
    for a step along t.
    """
    if kind == ELLIPSOID:
        share, t, b = 1.0 / norm(divide(divide(x, size), size)), divide(t, size), divide(b, size)
        return share * dot(t, t), share * dot(t, b), share * dot(b, b)
    if kind == SPHERE:
        return 1.0 / size[0], 0.0, 1.0 / size[0]
    by_t, by_b = (x[0] * t[1] - x[1] * t[0]) / size[0], (x[0] * b[1] - x[1] * b[0]) / size[0]
    return by_t * by_t / size[0], by_t * by_b / size[0], by_b * by_b / size[0]


@compiled
def project_onto_surface(kind: int, size: Vector, x: Vector) -> Vector:
    """A point near the surface brought onto it."""
    if kind == ELLIPSOID:
        return scale(1.0 / norm(divide(x, size)), x)
    if kind == SPHERE:
        return scale(size[0] / norm(x), x)
    factor = size[0] / norm((x[0], x[1], 0.0))
    return factor * x[0], factor * x[1], x[2]


@compiled
def _trace_on_sphere(radius: float, x: Vector, t: Vector, length: float) -> Trace:
    c, s = cos(length / radius), sin(length / radius)
    end = add(scale(c, x), scale(s * radius, t))
    return end, add(scale(c, t), scale(-s / radius, x)), (c, radius * s, -s / radius, c)


@compiled
def _trace_on_cylinder(radius: float, x: Vector, t: Vector, length: float) -> Trace:
    around = (x[0] * t[1] - x[1] * t[0]) / radius
    c, s = cos(around * length / radius), sin(around * length / radius)
    end = c * x[0] - s * x[1], s * x[0] + c * x[1], x[2] + length * t[2]
    return end, (c * t[0] - s * t[1], s * t[0] + c * t[1], t[2]), (1.0, length, 0.0, 1.0)


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


@compiled
def set_geodesic(
    contact: Record, middle: Vector, heading: Vector, length: float, accuracy: float, series: Array, code: Codes
) -> None:
    """Set the geodesic of the contact and compute both ends; accuracy, series and code as in trace_on_ellipsoid."""
    write(contact["middle"], middle)
    write(contact["heading"], heading)
    contact["length"] = length
    first, last = trace_geodesic(
        contact["kind"], read(contact["size"]), middle, heading, length, accuracy, series, code
    )
    _set_end(contact, contact["first"], first)
    _set_end(contact, contact["last"], last)


@compiled
def to_surface_frame(contact: Record, point: Vector) -> Vector:
    """A point of the ground in the surface's frame."""
    return turn_back(contact["rotation"], subtract(point, read(contact["origin"])))


@compiled
def _set_end(contact: Record, end: Record, trace: Trace) -> None:
    kind, size, rotation = contact["kind"], read(contact["size"]), contact["rotation"]
    x, t, jacobi = trace
    n = normal_at(kind, size, x)
    b = cross(n, t)
    write(end["place"], add(turn(rotation, x), read(contact["origin"])))
    write(end["t"], turn(rotation, t))
    write(end["n"], turn(rotation, n))
    write(end["b"], turn(rotation, b))
    write(end["curvatures"], normal_curvatures(kind, size, x, t, b))
    scalars = end["jacobi"]
    scalars[0], scalars[1], scalars[2], scalars[3] = jacobi
