"""A path over an ellipsoid, as in OpenSim 4.6 (WrapEllipsoid): in one plane through both ends.

The plane is found from a point c of the surface near which the path should pass; the tangent points lie in that plane
and the path between them is its section with the ellipsoid. Lengths are scaled so that the semi-axes average 1.
Searches stop early, by OpenSim's rules, so that the lengths are the same.

Tangent point on an ellipsoid of a line from a point outside, within a plane: OpenSim 4.6's damped least squares.

Unknowns are r and d; with n = 2 r / a² (the surface's normal at r) the residuals are

    e₀ = ν·r + o      r in the plane          e₂ = n·r + d     r in the tangent plane n·x + d = 0
    e₁ = Σ(r/a)² − 1  r on the ellipsoid      e₃ = n·p + d     the outside point p in it too

The search stops at |e|² ≤ 1e-8, far from round-off, so the result depends on the steps themselves: a step that does not
reduce |e|² is kept, and one that does is doubled until it no longer does and the last doubling is undone.
"""

from __future__ import annotations

from math import acos, cos, pi, sin, sqrt

from solver.compiled import compiled
from solver.vectors import ORIGIN, Vector, add, along, cross, distance, divide, dot, multiply, scale, subtract, unit
from solver.wrapping.fan import ANY_AXIS, Fan, closest_on_ellipsoid, fan_direction
from solver.wrapping.path_tables import AXIAL, MIDPOINT, NOT_CONVERGED, Codes
from solver.wrapping.segment import INSIDE_RADIUS, MANDATORY_WRAP, NO_WRAP, WrapResult, pierces, side

SAME_DIRECTION = 1e-4
ALL_FAN = 0.7073
ALL_AXIAL = 0.9
FADE = 0.3
CHORD = 0.001
MOST_CHORDS = 499

Plane = tuple[Vector, float]
"""Normal ν and offset o of the points x with ν·x + o = 0."""
ON_THE_SURFACE = 1e-4
SMALL_ENOUGH = 1e-8
MOST_ITERATIONS = 50
MOST_TRIALS = 1000
SHORTENING = 16.0

Four = tuple[float, float, float, float]


@compiled
def wrap_ellipsoid(
    start: Vector, end: Vector, radii: Vector, method: int, axis: int, allowed: int, fan: Fan, code: Codes
) -> WrapResult:
    """Wrap the segment from start to end over an ellipsoid with these semi-axes [m] along the axes of its frame.

    method         HYBRID, MIDPOINT or AXIAL: how c is chosen
    axis, allowed  c must lie where coordinate `axis` has the sign `allowed`; 0 allows all sides
    fan            as of allocate_fan()
    code           (1,) set to NOT_CONVERGED where an iteration reaches its limit of rounds
    """
    inverse = (1.0 / radii[0], 1.0 / radii[1], 1.0 / radii[2])
    on_sphere_1, on_sphere_2 = multiply(inverse, start), multiply(inverse, end)
    if dot(on_sphere_1, on_sphere_1) - 1.0 < -ON_THE_SURFACE or dot(on_sphere_2, on_sphere_2) - 1.0 < -ON_THE_SURFACE:
        return INSIDE_RADIUS, ORIGIN, ORIGIN, 0.0
    is_pierced, l1, l2 = pierces(subtract(on_sphere_1, on_sphere_2), on_sphere_2, 1.0)
    if not is_pierced or abs(dot(unit(start), unit(end)) - 1.0) < SAME_DIRECTION:
        return NO_WRAP, ORIGIN, ORIGIN, 0.0

    factor = 3.0 / (radii[0] + radii[1] + radii[2])
    p1, p2, a = scale(factor, start), scale(factor, end), scale(factor, radii)
    backwards = subtract(p1, p2)
    r1, r2 = along(p2, l1, backwards), along(p2, l2, backwards)
    c, fan_weight, crosses_between = _passing_point(r1, r2, unit(backwards), a, method, fan, code)
    if method != AXIAL or crosses_between:
        r1, r2 = c, c
    if allowed != 0 and side(c[axis]) != allowed:
        c, r1 = _on_the_allowed_side(c, a, axis, fan_weight, code)
        r2 = r1
    normal = unit(cross(backwards, subtract(p1, c)))
    offset = -dot(normal, c)
    r1 = tangent_point(r1, p1, a, normal, offset, code)
    r2 = tangent_point(r2, p2, a, normal, offset, code)
    length = _length_in_plane(r1, r2, p1, p2, a, (normal, offset), factor, allowed)
    return MANDATORY_WRAP, scale(1.0 / factor, r1), scale(1.0 / factor, r2), length / factor


@compiled
def _passing_point(
    r1: Vector, r2: Vector, direction: Vector, a: Vector, method: int, work: Fan, code: Codes
) -> tuple[Vector, float, bool]:
    """c for the segment that pierces the ellipsoid at r1 and r2; the weight of the fan in it; whether the segment
    crosses between r1 and r2 the plane normal to the axis that it is most parallel to.
    """
    inner = subtract(r2, r1)
    best = 0
    for i in range(1, 3):
        if abs(direction[i]) > abs(direction[best]):
            best = i
    crossing = -r1[best] / inner[best]
    if method == MIDPOINT:
        return closest_on_ellipsoid(a, along(r1, 0.5, inner), ANY_AXIS, code), 0.0, True
    axial = closest_on_ellipsoid(a, along(r1, crossing, inner), best, code)
    if method == AXIAL:
        return axial, 0.0, 0.0 < crossing < 1.0

    alignment = abs(direction[best])
    fade = min(crossing, 1.0 - crossing) / FADE
    if alignment > ALL_FAN and fade < 1.0:
        alignment = ALL_FAN + max(fade, 0.0) * (alignment - ALL_FAN)
    if alignment >= ALL_AXIAL:
        return axial, 0.0, True
    fan = closest_on_ellipsoid(a, add(along(r1, 0.5, inner), fan_direction(r1, inner, a, work, code)), ANY_AXIS, code)
    if alignment <= ALL_FAN:
        return fan, 1.0, True
    weight = (alignment - ALL_FAN) / (ALL_AXIAL - ALL_FAN)
    blend = add(scale(weight, axial), scale(1.0 - weight, fan))
    return closest_on_ellipsoid(a, blend, ANY_AXIS, code), 1.0 - weight, True


@compiled
def _on_the_allowed_side(c: Vector, a: Vector, axis: int, fan_weight: float, code: Codes) -> tuple[Vector, Vector]:
    """c mirrored to the other side, and the start of the search for tangents; a fan's c is moved towards the middle."""
    mirrored = (-c[0] if axis == 0 else c[0], -c[1] if axis == 1 else c[1], -c[2] if axis == 2 else c[2])
    if not fan_weight > 0.0:
        return mirrored, mirrored
    drawn = add(scale(1.0 - fan_weight, mirrored), scale(fan_weight, scale(0.5, add(c, mirrored))))
    return closest_on_ellipsoid(a, drawn, ANY_AXIS, code), mirrored


@compiled
def _length_in_plane(
    r1: Vector, r2: Vector, p1: Vector, p2: Vector, a: Vector, plane: Plane, factor: float, allowed: int
) -> float:
    """Length of the chords of about 1 mm that follow the section with the plane from r1 to r2."""
    straight = distance(r1, r2)
    if straight / factor < CHORD:
        return straight
    chords = min(int(straight / factor / CHORD), MOST_CHORDS)
    centre = _plane_on_axis(plane)
    x = unit(subtract(r1, centre))
    towards = unit(subtract(r2, centre))
    angle = acos(dot(x, towards))
    y = cross(unit(cross(x, towards)), x)
    length, first, last = _chords(distance(r1, centre), distance(r2, centre), angle, chords, centre, x, y, a)
    if allowed != 0 and chords > 1:
        leaves = dot(subtract(p1, r1), subtract(first, r1)) > 0.0 or dot(subtract(p2, r2), subtract(last, r2)) > 0.0
        if leaves:
            angle = -(2.0 * pi - angle)
            length, _, _ = _chords(distance(r1, centre), distance(r2, centre), angle, chords, centre, x, y, a)
    return length


@compiled
def _plane_on_axis(plane: Plane) -> Vector:
    """Where the plane meets the coordinate axis that is closest to its normal."""
    normal, offset = plane
    nx, ny, nz = abs(normal[0]), abs(normal[1]), abs(normal[2])
    if nx >= ny and nx >= nz:
        return -offset / normal[0], 0.0, 0.0
    if ny >= nz:
        return 0.0, -offset / normal[1], 0.0
    return 0.0, 0.0, -offset / normal[2]


@compiled
def _chords(
    radius_1: float, radius_2: float, angle: float, chords: int, centre: Vector, x: Vector, y: Vector, a: Vector
) -> tuple[float, Vector, Vector]:
    """Total length, first and last inner point, in the plane centre + ρ (x cos φ + y sin φ), of a polyline with equal
    steps in φ; the ray at φ leaves the ellipsoid at ρ, a root of A ρ² + B ρ + C = 0.
    """
    xa, ya, ca = divide(x, a), divide(y, a), divide(centre, a)
    xx, xy, yy, xc, yc = dot(xa, xa), dot(xa, ya), dot(ya, ya), dot(xa, ca), dot(ya, ca)
    C = dot(ca, ca) - 1.0
    step_cos, step_sin = cos(angle / chords), sin(angle / chords)
    c, s = 1.0, 0.0
    at_x, at_y = radius_1, 0.0
    first_x, first_y = radius_1, 0.0
    length = 0.0
    for i in range(1, chords):
        c, s = c * step_cos - s * step_sin, s * step_cos + c * step_sin
        A = c * c * xx + 2.0 * c * s * xy + s * s * yy
        B = 2.0 * (c * xc + s * yc)
        radius = (sqrt(B * B - 4.0 * A * C) - B) / (2.0 * A)
        dx, dy = radius * c - at_x, radius * s - at_y
        length += sqrt(dx * dx + dy * dy)
        at_x, at_y = radius * c, radius * s
        if i == 1:
            first_x, first_y = at_x, at_y
    dx, dy = radius_2 * cos(angle) - at_x, radius_2 * sin(angle) - at_y
    first = along(along(centre, first_x, x), first_y, y)
    last = along(along(centre, at_x, x), at_y, y)
    return length + sqrt(dx * dx + dy * dy), first, last


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
