"""A primal-dual interior point for the small problem of newton.py, from nowhere in particular.

Mehrotra's predictor and corrector, with Nesterov and Todd's scaling W of the cone, W λ = W⁻¹ s. z (2, n) are the
multipliers of lower and upper bounds; every step is a system of M's few rows,

    (M D⁻¹ Mᵀ + R + W²) Δv = …,   D = q + z_lower / (a − lower) + z_upper / (upper − a)
"""

from __future__ import annotations

from math import hypot, inf

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled
from solver.dense import Order, columns_times, divide, dot, factor, rows_times_rows
from solver.redundancy.cone import (
    Ray,
    Scaling,
    add_square,
    advance,
    approach,
    centred,
    inner,
    quotient,
    read_ray,
    scaled,
    scaling,
)
from solver.redundancy.workspace import FrameWorkspace

Array = NDArray[np.float64]

GOAL = 1e-8  # of violation and gap: close enough for Newton's method to finish
VIOLATION_LIMIT = 1e-8
MOST_STEPS = 50
FIRST_GAP = 0.1  # of each pair that is complementary
SHARE_OF_STEP = 0.995  # of the way to the boundary
SOLVED, INFEASIBLE, NOT_CONVERGED = 0, 1, 2
"""Outcome: violation and gap are small, a certificate proves that there is no solution, or neither."""
LARGEST_EFFORT = 1e7  # ½ v·R v beyond which no solution is looked for


@compiled
def interior_point(
    q: Array, M: Array, R: Array, t: Array, equalities: int, lower: Array, upper: Array, work: FrameWorkspace, v: Array
) -> int:
    """Set v to multipliers near the solution's; returns the outcome."""
    n, m, p = len(q), len(t), equalities
    a, z, slack, inverse, da, dz, aim = work.a, work.z, work.slack, work.inverse, work.da, work.dz, work.aim
    pull, rest, dv, error, matrix, order = work.pull, work.rest, work.dv, work.error, work.matrix, work.order
    s, W = _start(M, t, p, lower, upper, a, z, v), (1.0, 0.0, 0.0, 0.0)
    for _ in range(MOST_STEPS):
        for i in range(n):
            slack[0, i], slack[1, i] = a[i] - lower[i], upper[i] - a[i]
            inverse[i] = 1.0 / (q[i] + z[0, i] / slack[0, i] + z[1, i] / slack[1, i])
            aim[0, i] = aim[1, i] = 0.0
        columns_times(M, v, pull)
        violation = _row_errors(M, R, t, a, v, s, p, error)
        gap = _gap(slack, z, s, v, p)
        if violation <= GOAL and gap <= GOAL:
            return SOLVED
        if violation > VIOLATION_LIMIT and _is_certificate(R, t, lower, upper, v, pull):
            return INFEASIBLE
        rows_times_rows(M, inverse, R, rest, matrix)
        if p < m:
            W = scaling(s, read_ray(v))
            add_square(matrix, W)
        if not factor(matrix, order):
            break
        ds = _step(q, M, inverse, matrix, order, a, z, slack, pull, error, aim, advance(s, -2.0, s), W, da, dz, dv)
        length = min(1.0, _longest(slack, z, s, v, da, dz, ds, dv, p))
        ahead = _gap_ahead(slack, z, s, v, da, dz, ds, dv, p, length)
        target = (ahead / gap) ** 3 * gap / (2 * n + (1 if p < m else 0))
        for i in range(n):
            aim[0, i], aim[1, i] = target - da[i] * dz[0, i], target + da[i] * dz[1, i]
        offset = centred(s, ds, read_ray(v), read_ray(dv), W, target) if p < m else s
        ds = _step(q, M, inverse, matrix, order, a, z, slack, pull, error, aim, offset, W, da, dz, dv)
        if not dot(dv, dv) < inf:  # at huge efforts nothing is left between a and its bound before the gap is small
            break
        length = min(1.0, SHARE_OF_STEP * _longest(slack, z, s, v, da, dz, ds, dv, p))
        _advance(a, length, da)
        _advance(z[0], length, dz[0])
        _advance(z[1], length, dz[1])
        _advance(v, length, dv)
        s = advance(s, length, ds)
    return NOT_CONVERGED


@compiled
def _start(M: Array, t: Array, p: int, lower: Array, upper: Array, a: Array, z: Array, v: Array) -> Ray:
    """Fill a, z and v with a point inside all bounds; returns a ray inside the cone."""
    for i in range(len(a)):
        a[i] = 0.7 * lower[i] + 0.3 * upper[i]
        z[0, i], z[1, i] = FIRST_GAP / (a[i] - lower[i]), FIRST_GAP / (upper[i] - a[i])
    for i in range(len(v)):
        v[i] = 0.0
    if p == len(t):
        return (0.0, 0.0, 0.0)
    s = _first_ray(M, t, p, a)
    v[p], v[p + 1], v[p + 2] = quotient(s, (FIRST_GAP, 0.0, 0.0))
    return s


@compiled
def _step(
    q: Array,
    M: Array,
    inverse: Array,
    factors: Array,
    order: Order,
    a: Array,
    z: Array,
    slack: Array,
    pull: Array,
    error: Array,
    aim: Array,
    offset: Ray,
    W: Scaling,
    da: Array,
    dz: Array,
    dv: Array,
) -> Ray:
    """The Newton step to slack · z = aim and, for the cone, to ds + W² dλ = offset. Fills da, dz and dv, returns ds."""
    p = len(dv) - 3
    for j in range(len(da)):
        da[j] = inverse[j] * (pull[j] - q[j] * a[j] + aim[0, j] / slack[0, j] - aim[1, j] / slack[1, j])
    for i in range(len(dv)):
        dv[i] = -error[i] - dot(M[i], da)
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
        return advance(offset, -1.0, scaled(W, scaled(W, read_ray(dv))))
    return offset


@compiled
def _advance(x: Array, length: float, dx: Array) -> None:
    for i in range(len(x)):
        x[i] += length * dx[i]


@compiled
def _row_errors(M: Array, R: Array, t: Array, a: Array, v: Array, s: Ray, p: int, error: Array) -> float:
    """M a + R v − t − (0, s), and the largest of it."""
    largest = 0.0
    for i in range(len(t)):
        error[i] = dot(M[i], a) + dot(R[i], v) - t[i]
        if i >= p:
            error[i] -= s[i - p]
        largest = max(largest, abs(error[i]))
    return largest


@compiled
def _is_certificate(R: Array, t: Array, lower: Array, upper: Array, v: Array, pull: Array) -> bool:
    """Farkas: for points that meet the rows, v·t ≤ v·M a + v·R u, with u what the eliminated unknowns do. The first is
    at most what the bounds' best corner gives, the second at most √(v·R v) √(u·R u), too little with a bearable u.
    What is missing, the depth, over Σ |v| is a violation that no point can avoid.
    """
    depth, effort, size = dot(v, t), 0.0, 0.0
    for j in range(len(pull)):
        depth -= max(lower[j] * pull[j], upper[j] * pull[j])
    for i in range(len(v)):
        effort += v[i] * dot(R[i], v)
        size += abs(v[i])
    return depth > VIOLATION_LIMIT * size and depth * depth > 2.0 * LARGEST_EFFORT * effort


@compiled
def _first_ray(M: Array, t: Array, p: int, a: Array) -> Ray:
    """A point well inside the cone, near what a gives."""
    x = dot(M[p], a) - t[p]
    y, z = 0.8 * (dot(M[p + 1], a) - t[p + 1]), 0.8 * (dot(M[p + 2], a) - t[p + 2])
    return (max(x, 0.1, 1.5 * hypot(y, z)), y, z)


@compiled
def _gap(slack: Array, z: Array, s: Ray, v: Array, p: int) -> float:
    gap = dot(slack[0], z[0]) + dot(slack[1], z[1])
    return gap + inner(s, read_ray(v)) if p < len(v) else gap


@compiled
def _gap_ahead(
    slack: Array, z: Array, s: Ray, v: Array, da: Array, dz: Array, ds: Ray, dv: Array, p: int, length: float
) -> float:
    """The gap after a step."""
    gap = 0.0
    for j in range(len(da)):
        gap += (slack[0, j] + length * da[j]) * (z[0, j] + length * dz[0, j])
        gap += (slack[1, j] - length * da[j]) * (z[1, j] + length * dz[1, j])
    if p < len(v):
        gap += inner(advance(s, length, ds), advance(read_ray(v), length, read_ray(dv)))
    return gap


@compiled
def _longest(slack: Array, z: Array, s: Ray, v: Array, da: Array, dz: Array, ds: Ray, dv: Array, p: int) -> float:
    """How far a step can go until something reaches its boundary."""
    fastest = 1e-30
    for j in range(len(da)):
        fastest = max(fastest, -da[j] / slack[0, j], da[j] / slack[1, j], -dz[0, j] / z[0, j], -dz[1, j] / z[1, j])
    if p < len(v):
        fastest = max(fastest, approach(s, ds), approach(read_ray(v), read_ray(dv)))
    return 1.0 / fastest
