"""Which way round an ellipsoid is the shortest: among the planes through both ends, as a guess for the geodesic.

Divided by the semi-axes, the ellipsoid is the unit sphere and its cut with a plane a circle: lines, planes and tangents
stay what they are, lengths do not. In a half-plane at angle ψ about the line through both ends, with u along the line,
v across it and away from it, the path runs from the start to the circle, over it and on to the end.
"""

from __future__ import annotations

from math import acos, atan2, cos, nan, pi, sin, sqrt

from solver.compiled import compiled
from solver.wrapping.segment import pierces, side
from solver.wrapping.vectors import (
    Array,
    Vector,
    add,
    along,
    any_across,
    cross,
    distance,
    divide,
    dot,
    multiply,
    norm,
    scale,
    subtract,
    unit,
)

PLANES = 12
STEP = 2.0 * pi / PLANES
NEARLY_AS_SHORT = 1.5  # of two detours; planes do not tell closer
FAR, FORBIDDEN = 1e9, 1e6  # m
NODES = (0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5)  # of Gauss and Legendre's quadrature
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)

Pencil = tuple[Vector, Vector, Vector, float, float, float]
"""Directions to the foot of the origin on the line, across it and u; how far the foot is, and start and end along u."""

Circle = tuple[Vector, Vector, Vector, float, float, float]
"""u, v; the cut's centre and radius; the angles from u to v at which the path reaches and leaves it."""


@compiled
def shortest_ways(
    size: Vector, axis: int, allowed: int, start: Vector, end: Vector, lengths: Array
) -> tuple[float, float]:
    """Angles ψ of the shortest path over an ellipsoid with these semi-axes, and of another that may be as short; NaN
    where there is none.

    axis, allowed  a path's middle must lie where coordinate `axis` has the sign `allowed`; 0 allows all sides
    lengths        (PLANES,) room to work in
    """
    p, q = divide(start, size), divide(end, size)
    if dot(p, p) <= 1.0 or dot(q, q) <= 1.0 or not pierces(subtract(q, p), p, 1.0)[0]:
        return nan, nan
    pencil, straight = _pencil(p, q), distance(start, end)
    for k in range(PLANES):
        lengths[k] = _length(size, pencil, k * STEP)
    first, second, least, next_least = nan, nan, FAR, FAR
    for k in range(PLANES):
        before, behind = lengths[k - 1], lengths[(k + 1) % PLANES]
        if not (lengths[k] <= before and lengths[k] < behind):
            continue
        angle, detour = k * STEP + _lowest(before, lengths[k], behind), lengths[k] - straight
        if allowed != 0 and side(_middle(size, pencil, angle)[axis]) != allowed:
            detour += FORBIDDEN
        if detour < least:
            first, second, least, next_least = angle, first, detour, least
        elif detour < next_least:
            second, next_least = angle, detour
    return first, (second if next_least <= NEARLY_AS_SHORT * least else nan)


@compiled
def touch_in_plane(size: Vector, start: Vector, end: Vector, angle: float) -> tuple[Vector, Vector, float]:
    """Where the path in the half-plane at an angle reaches the ellipsoid, in which direction, and its length there."""
    pencil = _pencil(divide(start, size), divide(end, size))
    u, v, centre, radius, high, low = _circle(pencil, angle)
    place = add(centre, scale(radius, add(scale(cos(high), u), scale(sin(high), v))))
    heading = add(scale(sin(high), u), scale(-cos(high), v))
    return multiply(size, place), unit(multiply(size, heading)), _arc(size, u, v, radius, high, low)


@compiled
def _pencil(p: Vector, q: Vector) -> Pencil:
    u = unit(subtract(q, p))
    foot = along(p, -dot(p, u), u)
    away = norm(foot)
    towards = scale(1.0 / away, foot) if away > 1e-12 else any_across(u)
    return towards, cross(u, towards), u, away, dot(p, u), dot(q, u)


@compiled
def _length(size: Vector, pencil: Pencil, angle: float) -> float:
    u, v, centre, radius, high, low = _circle(pencil, angle)
    towards, _, _, away, at_start, at_end = pencil
    on_start = add(centre, scale(radius, add(scale(cos(high), u), scale(sin(high), v))))
    on_end = add(centre, scale(radius, add(scale(cos(low), u), scale(sin(low), v))))
    start, end = along(scale(away, towards), at_start, u), along(scale(away, towards), at_end, u)
    before, behind = multiply(size, subtract(on_start, start)), multiply(size, subtract(end, on_end))
    return norm(before) + _arc(size, u, v, radius, high, low) + norm(behind)


@compiled
def _circle(pencil: Pencil, angle: float) -> Circle:
    towards, across, u, away, at_start, at_end = pencil
    v = add(scale(cos(angle), towards), scale(sin(angle), across))
    height = away * cos(angle)
    centre = along(scale(away, towards), -height, v)
    radius = sqrt(1.0 - away * away * sin(angle) ** 2)
    high = pi - atan2(height, -at_start) - acos(radius / sqrt(height * height + at_start * at_start))
    low = atan2(height, at_end) + acos(radius / sqrt(height * height + at_end * at_end))
    return u, v, centre, radius, high, low


@compiled
def _middle(size: Vector, pencil: Pencil, angle: float) -> Vector:
    u, v, centre, radius, high, low = _circle(pencil, angle)
    middle = 0.5 * (high + low)
    return multiply(size, add(centre, scale(radius, add(scale(cos(middle), u), scale(sin(middle), v)))))


@compiled
def _arc(size: Vector, u: Vector, v: Vector, radius: float, high: float, low: float) -> float:
    """Length of the arc from angle `high` down to `low` on the ellipsoid."""
    x, y = multiply(size, u), multiply(size, v)
    xx, xy, yy = dot(x, x), dot(x, y), dot(y, y)
    total = 0.0
    for k in range(len(NODES)):
        angle = low + NODES[k] * (high - low)
        c, s = cos(angle), sin(angle)
        total += WEIGHTS[k] * sqrt(s * s * xx - 2.0 * s * c * xy + c * c * yy)
    return total * radius * (high - low)


@compiled
def _lowest(before: float, here: float, behind: float) -> float:
    """Where the parabola through three equidistant lengths, the middle one the least, is the lowest."""
    return 0.5 * STEP * (before - behind) / (before - 2.0 * here + behind)
