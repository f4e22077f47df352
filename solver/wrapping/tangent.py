"""Tangent point on an ellipsoid of a line from a point outside, within a plane: OpenSim 4.6's damped least squares.

Unknowns are r and d; with n = 2 r / a² (the surface's normal at r) the residuals are

    e₀ = ν·r + o      r in the plane          e₂ = n·r + d     r in the tangent plane n·x + d = 0
    e₁ = Σ(r/a)² − 1  r on the ellipsoid      e₃ = n·p + d     the outside point p in it too

The search stops at |e|² ≤ 1e-8, far from round-off, so the result depends on the steps themselves: a step that does not
reduce |e|² is kept, and one that does is doubled until it no longer does and the last doubling is undone.
"""

from __future__ import annotations

from solver.compiled import compiled
from solver.vectors import Vector, along, divide, dot, multiply, scale, subtract, unit
from solver.wrapping.path_tables import NOT_CONVERGED, Codes

ON_THE_SURFACE = 1e-4
SMALL_ENOUGH = 1e-8
MOST_ITERATIONS = 50
MOST_TRIALS = 1000
SHORTENING = 16.0

Four = tuple[float, float, float, float]


@compiled
def level(point: Vector, a: Vector) -> float:
    """Σ(point/a)² − 1: negative inside the ellipsoid with semi-axes a, 0 on it."""
    ratio = divide(point, a)
    return dot(ratio, ratio) - 1.0


@compiled
def tangent_point(guess: Vector, p: Vector, a: Vector, normal: Vector, offset: float, code: Codes) -> Vector:
    """The point of the ellipsoid in the plane normal·x + offset = 0 whose tangent passes through p, from `guess`.

    code (1,) is set to NOT_CONVERGED where its residuals stay large.
    """
    if abs(level(p, a)) < ON_THE_SURFACE:
        return p
    weights = (1.0 / (a[0] * a[0]), 1.0 / (a[1] * a[1]), 1.0 / (a[2] * a[2]))
    m = scale(2.0, multiply(weights, p))
    p_direction = unit(p)
    r = guess
    d = -2.0 * dot(multiply(weights, r), r)
    damping = 0.01
    e = _residuals(r, d, m, weights, normal, offset)
    for _ in range(MOST_ITERATIONS):
        now = _square(e)
        if not now > SMALL_ENOUGH:
            break
        n = scale(2.0, multiply(weights, r))
        descent = _descent(normal, n, m, e)
        step_scale = _step_scale(r, p, p_direction) / SHORTENING
        step = (0.0, 0.0, 0.0, 0.0)
        before = now
        for _ in range(MOST_TRIALS):
            step = _damped_step(normal, n, m, descent, damping, step_scale)
            r, d = along(r, 1.0, (step[0], step[1], step[2])), d + step[3]
            e = _residuals(r, d, m, weights, normal, offset)
            before, now = now, _square(e)
            damping *= 4.0
            if not now >= before:
                break
        damping /= 8.0
        factor = _factor_along(r, step, m, weights, normal, e, before, now)
        r, d = along(r, factor, (step[0], step[1], step[2])), d + factor * step[3]
        e = _residuals(r, d, m, weights, normal, offset)
    if not _square(e) <= SMALL_ENOUGH:
        code[0] = NOT_CONVERGED
    return r


@compiled
def _residuals(r: Vector, d: float, m: Vector, weights: Vector, normal: Vector, offset: float) -> Four:
    """e, with the weights 1 / a² and m = 2 p / a²."""
    square = dot(multiply(weights, r), r)
    return dot(normal, r) + offset, square - 1.0, 2.0 * square + d, dot(m, r) + d


@compiled
def _square(e: Four) -> float:
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]


@compiled
def _step_scale(r: Vector, p: Vector, p_direction: Vector) -> float:
    """Below 1 where p, r and the centre are nearly collinear: the tangent point hardly moves there."""
    cosine = dot(unit(subtract(p, r)), p_direction)
    if not cosine > 0.1:
        return 1.0
    fourth = cosine * cosine * cosine * cosine
    sixteenth = fourth * fourth * fourth * fourth
    return 1.0 - fourth * sixteenth * sixteenth * sixteenth * sixteenth * sixteenth * sixteenth


@compiled
def _factor_along(
    r: Vector, step: Four, m: Vector, weights: Vector, normal: Vector, e: Four, before: float, now: float
) -> float:
    """How far to go on along the step: further by 1, 2, 4 … steps while |e|² decreases, then back by the last.

    Along a line e is a polynomial of second order.
    """
    s = (step[0], step[1], step[2])
    weighted = multiply(weights, s)
    plane, surface, curvature, outside = dot(normal, s), 2.0 * dot(weighted, r), dot(weighted, s), dot(m, s) + step[3]
    touching = 2.0 * surface + step[3]
    factor, stretch = 0.0, 0.5
    for _ in range(MOST_TRIALS):
        if not now <= before:
            break
        stretch *= 2.0
        factor += stretch
        bend = factor * factor * curvature
        e0, e1 = e[0] + factor * plane, e[1] + (factor * surface + bend)
        e2, e3 = e[2] + (factor * touching + 2.0 * bend), e[3] + factor * outside
        before, now = now, e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3
    return factor - stretch


@compiled
def _descent(normal: Vector, n: Vector, m: Vector, e: Four) -> Four:
    """−D e, with D the (unknowns, residuals) derivatives: columns (ν, 0), (n, 0), (2n, 1), (m, 1)."""
    on_n = e[1] + 2.0 * e[2]
    return (
        -(normal[0] * e[0] + n[0] * on_n + m[0] * e[3]),
        -(normal[1] * e[0] + n[1] * on_n + m[1] * e[3]),
        -(normal[2] * e[0] + n[2] * on_n + m[2] * e[3]),
        -(e[2] + e[3]),
    )


@compiled
def _damped_step(normal: Vector, n: Vector, m: Vector, descent: Four, damping: float, step_scale: float) -> Four:
    """step_scale · H⁻¹ descent, with H = D Dᵀ and its diagonal times 1 + damping; by Cholesky without square roots."""
    raised = 1.0 + damping
    h00 = (normal[0] * normal[0] + 5.0 * n[0] * n[0] + m[0] * m[0]) * raised
    h11 = (normal[1] * normal[1] + 5.0 * n[1] * n[1] + m[1] * m[1]) * raised
    h22 = (normal[2] * normal[2] + 5.0 * n[2] * n[2] + m[2] * m[2]) * raised
    h33 = 2.0 * raised
    h10 = normal[1] * normal[0] + 5.0 * n[1] * n[0] + m[1] * m[0]
    h20 = normal[2] * normal[0] + 5.0 * n[2] * n[0] + m[2] * m[0]
    h21 = normal[2] * normal[1] + 5.0 * n[2] * n[1] + m[2] * m[1]
    h30, h31, h32 = 2.0 * n[0] + m[0], 2.0 * n[1] + m[1], 2.0 * n[2] + m[2]

    i0 = 1.0 / h00
    l10, l20, l30 = h10 * i0, h20 * i0, h30 * i0
    i1 = 1.0 / (h11 - l10 * h10)
    t21, t31 = h21 - l20 * h10, h31 - l30 * h10
    l21, l31 = t21 * i1, t31 * i1
    i2 = 1.0 / (h22 - l20 * h20 - l21 * t21)
    t32 = h32 - l30 * h20 - l31 * t21
    l32 = t32 * i2
    d3 = h33 - l30 * h30 - l31 * t31 - l32 * t32

    y0 = descent[0]
    y1 = descent[1] - l10 * y0
    y2 = descent[2] - l20 * y0 - l21 * y1
    y3 = descent[3] - l30 * y0 - l31 * y1 - l32 * y2
    x3 = y3 / d3
    x2 = y2 * i2 - l32 * x3
    x1 = y1 * i1 - l21 * x2 - l31 * x3
    x0 = y0 * i0 - l10 * x1 - l20 * x2 - l30 * x3
    return step_scale * x0, step_scale * x1, step_scale * x2, step_scale * x3
