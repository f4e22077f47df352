"""A primal-dual interior-point method for the problem of one frame (problem.py), from a cold start.

Mehrotra's predictor and corrector, with the Nesterov-Todd scaling W of the cone, W λ = W⁻¹ s. z (2, n) are the
multipliers of the lower and upper bounds; every step is a system of the few rows of M,

    (M D⁻¹ Mᵀ + R + W²) Δv = …,   D = q + z_lower / (a − lower) + z_upper / (upper − a)

The second-order cone {(x₀, x̄): x₀ ≥ |x̄|} in three dimensions, for compiled code: its rays are tuples.

Its algebra has products x∘y = (x·y, x₀ ȳ + y₀ x̄). A scaling W = (w̄, η) is η times a symmetric hyperbolic rotation
(Vandenberghe, The CVXOPT linear and quadratic cone program solvers, 2010, section 4).
"""

from __future__ import annotations

from math import hypot, inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled
from solver.dense import Order, columns_times, copy, divide, factor, inner_product, rows_times_rows
from solver.redundancy import effort
from solver.redundancy.problem import INFEASIBLE, NOT_CONVERGED, SOLVED, VIOLATION_LIMIT, FrameProblem
from solver.vectors import along, dot

Array = NDArray[np.float64]

GOAL = 1e-8  # of violation and duality gap: close enough for Newton's method to finish
CUBIC_GOAL = 1e-12  # with p = 3, where the last point is the solution; GOAL is enough where rounding stops it
MOST_STEPS = 50
FIRST_GAP = 0.1  # of each complementary pair
SHARE_OF_STEP = 0.995  # of the longest step to the boundary
LARGEST_EFFORT = 1e9  # ½ v·R v above which no solution is sought
slope, curvature = compiled(effort.slope), compiled(effort.curvature)
Ray = tuple[float, float, float]
Scaling = tuple[float, float, float, float]


@compiled
def interior_point(problem: FrameProblem, work: InteriorWorkspace, v: Array) -> int:
    """Set v, and work.point, to multipliers near the solution's; returns the outcome code.

    SOLVED: violation and gap are small. INFEASIBLE: a certificate proves it. NOT_CONVERGED: neither.
    """
    code = _follow_central_path(problem, work)
    copy(work.point.v, v)
    return code


@compiled
def is_certificate(problem: FrameProblem, v: Array, gradient: Array) -> bool:
    """Whether v proves that the problem is infeasible; fills the gradient Mᵀ v (n,).

    Farkas' lemma: points that meet the rows have v·t ≤ v·M a + v·R u, R u being the contribution of the eliminated
    unknowns. The first term is at most that of the best corner of the bounds, the second at most √(v·R v) √(u·R u),
    too small where the effort is bounded. The missing part, the depth, over Σ |v| is a violation that no point avoids.
    """
    _, M, R, t, _, lower, upper, _ = problem
    columns_times(M, v, gradient)
    depth, size = inner_product(v, t), 0.0
    for j in range(len(gradient)):
        depth -= max(lower[j] * gradient[j], upper[j] * gradient[j])
    for i in range(len(v)):
        size += abs(v[i])
    return depth > VIOLATION_LIMIT * size and depth * depth > 4.0 * LARGEST_EFFORT * effort_of_eliminated(R, v)


@compiled
def effort_of_eliminated(R: Array, v: Array) -> float:
    """½ v·R v."""
    effort = 0.0
    for i in range(len(v)):
        effort += 0.5 * v[i] * inner_product(R[i], v)
    return effort


@compiled
def _follow_central_path(problem: FrameProblem, work: InteriorWorkspace) -> int:
    q, M, R, t, p, lower, upper, exponent = problem
    (matrix, order), point, step, error, inverse, gradient, aim = work
    (a, z, v, slack), (da, dz, dv) = point, step
    n, has_cone = len(q), p < len(t)
    s, W = _start(problem, point), (1.0, 0.0, 0.0, 0.0)
    largest, is_near = inf, False
    for _ in range(MOST_STEPS):
        for i in range(n):
            slack[0, i], slack[1, i] = a[i] - lower[i], upper[i] - a[i]
            inverse[i] = 1.0 / (curvature(q[i], a[i], exponent) + z[0, i] / slack[0, i] + z[1, i] / slack[1, i])
            aim[0, i] = aim[1, i] = 0.0
        columns_times(M, v, gradient)
        violation = _row_errors(problem, a, v, s, error)
        gap = _gap(point, s, p)
        before, largest = largest, max(violation, gap, _stationarity_error(problem, point, gradient))
        is_near = largest <= GOAL
        if is_near and (exponent == 2 or largest <= CUBIC_GOAL or largest > 0.5 * before):
            return SOLVED
        if violation > VIOLATION_LIMIT and is_certificate(problem, v, gradient):
            return INFEASIBLE
        rows_times_rows(M, inverse, R, matrix)
        if has_cone:
            W = scaling(s, read_ray(v))
            add_square(matrix, W)
        if not factor(matrix, order):
            break
        ds = _step(problem, work, along(s, -2.0, s), W)
        length = min(1.0, _longest_step(point, step, s, ds, p))
        ahead = _gap_ahead(point, step, s, ds, p, length)
        target = (ahead / gap) ** 3 * gap / (2 * n + (1 if has_cone else 0))
        for i in range(n):
            aim[0, i], aim[1, i] = target - da[i] * dz[0, i], target + da[i] * dz[1, i]
        offset = centred(s, ds, read_ray(v), read_ray(dv), W, target) if has_cone else s
        ds = _step(problem, work, offset, W)
        if not inner_product(dv, dv) < inf:  # at huge efforts a − lower rounds to 0 before the gap is small
            break
        length = min(1.0, SHARE_OF_STEP * _longest_step(point, step, s, ds, p))
        _advance(a, length, da)
        _advance(z[0], length, dz[0])
        _advance(z[1], length, dz[1])
        _advance(v, length, dv)
        s = along(s, length, ds)
    return SOLVED if is_near else NOT_CONVERGED


@compiled
def _start(problem: FrameProblem, point: Iterate) -> Ray:
    """Fill a, z and v with a point strictly inside all bounds; returns a ray inside the cone."""
    _, _, _, t, p, lower, upper, _ = problem
    a, z, v, _ = point
    for i in range(len(a)):
        a[i] = 0.7 * lower[i] + 0.3 * upper[i]
        z[0, i], z[1, i] = FIRST_GAP / (a[i] - lower[i]), FIRST_GAP / (upper[i] - a[i])
    for i in range(len(v)):
        v[i] = 0.0
    if p == len(t):
        return (0.0, 0.0, 0.0)
    s = _first_ray(problem, a)
    v[p], v[p + 1], v[p + 2] = quotient(s, (FIRST_GAP, 0.0, 0.0))
    return s


@compiled
def _first_ray(problem: FrameProblem, a: Array) -> Ray:
    """A point well inside the cone, near that of a."""
    M, t, p = problem.M, problem.t, problem.equalities
    x = inner_product(M[p], a) - t[p]
    y, z = 0.8 * (inner_product(M[p + 1], a) - t[p + 1]), 0.8 * (inner_product(M[p + 2], a) - t[p + 2])
    return (max(x, 0.1, 1.5 * hypot(y, z)), y, z)


@compiled
def _row_errors(problem: FrameProblem, a: Array, v: Array, s: Ray, error: Array) -> float:
    """Fill the errors M a + R v − t − (0, s); returns the largest."""
    _, M, R, t, p, _, _, _ = problem
    largest = 0.0
    for i in range(len(t)):
        error[i] = inner_product(M[i], a) + inner_product(R[i], v) - t[i]
        if i >= p:
            error[i] -= s[i - p]
        largest = max(largest, abs(error[i]))
    return largest


@compiled
def _stationarity_error(problem: FrameProblem, point: Iterate, gradient: Array) -> float:
    """Largest error of slope = gradient + z_lower − z_upper. Of a quadratic effort it falls with the violation: 0."""
    q, exponent = problem.q, problem.exponent
    largest = 0.0
    if exponent > 2:
        for i in range(len(q)):
            pull = gradient[i] + point.z[0, i] - point.z[1, i]
            largest = max(largest, abs(slope(q[i], point.a[i], exponent) - pull))
    return largest


@compiled
def _step(problem: FrameProblem, work: InteriorWorkspace, offset: Ray, W: Scaling) -> Ray:
    """The Newton step to slack · z = aim and, for the cone, to ds + W² dλ = offset. Fills da, dz and dv, returns ds."""
    q, M, exponent = problem.q, problem.M, problem.exponent
    (factors, order), (a, z, _, slack), (da, dz, dv), error, inverse, gradient, aim = work
    p = len(dv) - 3
    for j in range(len(da)):
        pull = gradient[j] + aim[0, j] / slack[0, j] - aim[1, j] / slack[1, j]
        da[j] = inverse[j] * (pull - slope(q[j], a[j], exponent))
    for i in range(len(dv)):
        dv[i] = -error[i] - inner_product(M[i], da)
    if W[3] > 0.0:
        for i in range(3):
            dv[p + i] += offset[i]
    divide(factors, order, dv)
    for i in range(len(dv)):
        for j in range(len(da)):
            da[j] += dv[i] * M[i, j] * inverse[j]
    for j in range(len(da)):
        dz[0, j] = (aim[0, j] - z[0, j] * da[j]) / slack[0, j] - z[0, j]
        dz[1, j] = (aim[1, j] + z[1, j] * da[j]) / slack[1, j] - z[1, j]
    if W[3] > 0.0:
        return along(offset, -1.0, scaled(W, scaled(W, read_ray(dv))))
    return offset


@compiled
def _gap(point: Iterate, s: Ray, p: int) -> float:
    _, z, v, slack = point
    gap = inner_product(slack[0], z[0]) + inner_product(slack[1], z[1])
    return gap + dot(s, read_ray(v)) if p < len(v) else gap


@compiled
def _gap_ahead(point: Iterate, step: SearchDirection, s: Ray, ds: Ray, p: int, length: float) -> float:
    """The gap after a step of this length."""
    (_, z, v, slack), (da, dz, dv) = point, step
    gap = 0.0
    for j in range(len(da)):
        gap += (slack[0, j] + length * da[j]) * (z[0, j] + length * dz[0, j])
        gap += (slack[1, j] - length * da[j]) * (z[1, j] + length * dz[1, j])
    if p < len(v):
        gap += dot(along(s, length, ds), along(read_ray(v), length, read_ray(dv)))
    return gap


@compiled
def _longest_step(point: Iterate, step: SearchDirection, s: Ray, ds: Ray, p: int) -> float:
    """Length of the step at which the first variable reaches its boundary."""
    (_, z, v, slack), (da, dz, dv) = point, step
    fastest = 1e-30
    for j in range(len(da)):
        fastest = max(fastest, -da[j] / slack[0, j], da[j] / slack[1, j], -dz[0, j] / z[0, j], -dz[1, j] / z[1, j])
    if p < len(v):
        fastest = max(fastest, approach(s, ds), approach(read_ray(v), read_ray(dv)))
    return 1.0 / fastest


@compiled
def _advance(x: Array, length: float, dx: Array) -> None:
    for i in range(len(x)):
        x[i] += length * dx[i]


@compiled
def read_ray(v: Array) -> Ray:
    return (v[-3], v[-2], v[-1])


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
    half = sqrt(2.0 + 2.0 * max(dot(s, multiplier) / (size * other), 1.0))
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
    rest = (target - dot(x, y), -(x[0] * y[1] + y[0] * x[1]), -(x[0] * y[2] + y[0] * x[2]))
    return along(scaled(W, quotient(scaled(W, multiplier), rest)), -1.0, s)


@compiled
def _depth(x: Ray) -> float:
    """√(x₀² − |x̄|²), a size of a point inside the cone."""
    off = hypot(x[1], x[2])
    return sqrt(max((x[0] - off) * (x[0] + off), 1e-300))


class RowSystem(NamedTuple):
    """The linear system of a step: matrix (m, m) and its pivot order (m,)."""

    matrix: Array
    order: Order


class Iterate(NamedTuple):
    """A point of the interior-point method: a (n,), multipliers z (2, n) and v (m,), slack (2, n) of the bounds."""

    a: Array
    z: Array
    v: Array
    slack: Array


class SearchDirection(NamedTuple):
    """Changes of a, z and v along a full step from an Iterate."""

    a: Array
    z: Array
    v: Array


class InteriorWorkspace(NamedTuple):
    """error (m,), inverse and gradient (n,), and aim (2, n) of a step."""

    system: RowSystem
    point: Iterate
    step: SearchDirection
    error: Array
    inverse: Array
    gradient: Array
    aim: Array
