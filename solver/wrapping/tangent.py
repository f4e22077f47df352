"""Tangent point on an ellipsoid of a line from a point outside, within a plane: OpenSim 4.6's damped least squares.

Unknowns are r and d; with n = 2 r / a² (the surface's normal at r) the residuals are

    e₀ = ν·r + o      r in the plane          e₂ = n·r + d     r in the tangent plane n·x + d = 0
    e₁ = Σ(r/a)² − 1  r on the ellipsoid      e₃ = n·p + d     the outside point p in it too

The search stops at |e|² ≤ 1e-8, far from round-off, so the result depends on the steps themselves: a step that does not
reduce |e|² is kept, and one that does is doubled until it no longer does and the last doubling is undone.
"""

from __future__ import annotations

from solver.compiled import compiled
from solver.vectors import Vector, along, divide, dot, subtract, unit
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
    aa = (a[0] * a[0], a[1] * a[1], a[2] * a[2])
    r = guess
    d = -dot(_gradient(r, aa), r)
    damping = 0.01
    e = _residuals(r, d, p, a, aa, normal, offset)
    for _ in range(MOST_ITERATIONS):
        now = _square(e)
        if not now > SMALL_ENOUGH:
            break
        n, m = _gradient(r, aa), _gradient(p, aa)
        descent = _descent(normal, n, m, e)
        step_scale = _step_scale(r, p) / SHORTENING
        step = (0.0, 0.0, 0.0, 0.0)
        before = now
        for _ in range(MOST_TRIALS):
            step = _damped_step(normal, n, m, descent, damping, step_scale)
            r, d = _moved(r, d, step, 1.0)
            before, now = now, _square(_residuals(r, d, p, a, aa, normal, offset))
            damping *= 4.0
            if not now >= before:
                break
        damping /= 8.0
        stretch = 0.5
        for _ in range(MOST_TRIALS):
            if not now <= before:
                break
            stretch *= 2.0
            r, d = _moved(r, d, step, stretch)
            before, now = now, _square(_residuals(r, d, p, a, aa, normal, offset))
        r, d = _moved(r, d, step, -stretch)
        e = _residuals(r, d, p, a, aa, normal, offset)
    if not _square(e) <= SMALL_ENOUGH:
        code[0] = NOT_CONVERGED
    return r


@compiled
def _gradient(r: Vector, aa: Vector) -> Vector:
    return (2.0 * r[0] / aa[0], 2.0 * r[1] / aa[1], 2.0 * r[2] / aa[2])


@compiled
def _residuals(r: Vector, d: float, p: Vector, a: Vector, aa: Vector, normal: Vector, offset: float) -> Four:
    n = _gradient(r, aa)
    return dot(normal, r) + offset, level(r, a), dot(n, r) + d, dot(n, p) + d


@compiled
def _square(e: Four) -> float:
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]


@compiled
def _step_scale(r: Vector, p: Vector) -> float:
    """Below 1 where p, r and the centre are nearly collinear: the tangent point hardly moves there."""
    cosine = dot(unit(subtract(p, r)), unit(p))
    return 1.0 - cosine**100.0 if cosine > 0.1 else 1.0


@compiled
def _moved(r: Vector, d: float, step: Four, factor: float) -> tuple[Vector, float]:
    return along(r, factor, (step[0], step[1], step[2])), d + factor * step[3]


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

    l10, l20, l30 = h10 / h00, h20 / h00, h30 / h00
    d1 = h11 - l10 * h10
    t21, t31 = h21 - l20 * h10, h31 - l30 * h10
    l21, l31 = t21 / d1, t31 / d1
    d2 = h22 - l20 * h20 - l21 * t21
    t32 = h32 - l30 * h20 - l31 * t21
    l32 = t32 / d2
    d3 = h33 - l30 * h30 - l31 * t31 - l32 * t32

    y0 = descent[0]
    y1 = descent[1] - l10 * y0
    y2 = descent[2] - l20 * y0 - l21 * y1
    y3 = descent[3] - l30 * y0 - l31 * y1 - l32 * y2
    x3 = y3 / d3
    x2 = y2 / d2 - l32 * x3
    x1 = y1 / d1 - l21 * x2 - l31 * x3
    x0 = y0 / h00 - l10 * x1 - l20 * x2 - l30 * x3
    return step_scale * x0, step_scale * x1, step_scale * x2, step_scale * x3
