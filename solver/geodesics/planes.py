"""Initial guess of a geodesic on an ellipsoid: the plane through both ends in which the detour is least.

Divided by the semi-axes, the ellipsoid is the unit sphere and its section with a plane a circle: lines, planes and
tangents are preserved, lengths are not. In a half-plane at angle ψ about the line through both ends, with u along the
line and v across it and away from it, the path runs from the start to the circle, over it and on to the end. All these
circles have a chord on the line in common: the higher the arc above it, the longer the path. Where the line is close to
the centre, heights differ too little, and lengths are compared.
"""

from __future__ import annotations

from math import atan2, cos, nan, pi, sin, sqrt

from solver.compiled import compiled
from solver.vectors import (
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
from solver.wrapping.segment import pierces, side

PLANES = 12
STEP = 2.0 * pi / PLANES
COSINES = tuple(cos(k * STEP) for k in range(PLANES))
SINES = tuple(sin(k * STEP) for k in range(PLANES))
NEARLY_AS_SHORT = 2.0  # ratio of two detours below which they do not decide which geodesic is shorter
NEAR_CENTRE = 0.5  # of the unit sphere
REFINEMENTS = 2
FAR, FORBIDDEN = 1e9, 1e6  # above any detour
ROUND_OFF = 1e-6
OFF_MIDDLE = 0.15**0.5  # nodes of Gauss and Legendre's quadrature with three points, from the middle of 0 to 1

Pencil = tuple[Vector, Vector, Vector, float, float, float]
"""Directions to the foot of the origin on the line, across it, and u; distance of the foot; start and end along u."""

Circle = tuple[Vector, Vector, float, float, float, float, float]
"""v; centre of the section; height of the line above it along v; radius of the section; cosine and sine of the angle
from u to v at which the path reaches it; angle of the arc."""


@compiled
def shortest_planes(
    size: Vector, axis: int, allowed: int, start: Vector, end: Vector, detours: Array
) -> tuple[float, float]:
    """Angles ψ of the plane of the shortest path over an ellipsoid with these semi-axes, and of another that may be as
    short; NaN where there is none.

    axis, allowed  a path's middle must lie where coordinate `axis` has the sign `allowed`; 0 allows all sides
    detours        (PLANES,) working memory
    """
    p, q = divide(start, size), divide(end, size)
    if dot(p, p) <= 1.0 or dot(q, q) <= 1.0 or not pierces(subtract(q, p), p, 1.0)[0]:
        return nan, nan
    pencil = _pencil(p, q)
    away, products = pencil[3], _products_across(size, pencil)
    if away < NEAR_CENTRE:
        _set_detours(size, pencil, distance(start, end), detours)
    else:
        _set_square_heights(away, products, detours)
    first, second, least, next_least = 0.0, nan, FAR, FAR  # 0 where all are as long: between the poles of a spheroid
    for k in range(PLANES):
        before, here, behind = detours[k - 1], detours[k], detours[(k + 1) % PLANES]
        if not (here <= before and here < behind):
            continue
        angle = k * STEP + _parabola_minimum(before, here, behind)
        if allowed != 0 and side(_middle(pencil, cos(angle), sin(angle))[axis]) != allowed:
            here += FORBIDDEN
        if here < least:
            first, second, least, next_least = angle, first, here, least
        elif here < next_least:
            second, next_least = angle, here
    if away >= NEAR_CENTRE:
        first = _least_height(away, products, first)
    return first, (second if next_least <= NEARLY_AS_SHORT * least else nan)


@compiled
def contact_in_plane(size: Vector, start: Vector, end: Vector, angle: float) -> tuple[Vector, Vector, float]:
    """Middle, direction there and length on the ellipsoid of the path in the half-plane at an angle."""
    pencil = _pencil(divide(start, size), divide(end, size))
    u = pencil[2]
    v, centre, _, radius, c, s, arc = _circle(pencil, cos(angle), sin(angle))
    x, y = multiply(size, u), multiply(size, v)
    length = radius * _arc(dot(x, x), dot(x, y), dot(y, y), c, s, arc)
    half_c, half_s = cos(0.5 * arc), sin(0.5 * arc)
    c, s = c * half_c + s * half_s, s * half_c - c * half_s
    place = add(centre, scale(radius, add(scale(c, u), scale(s, v))))
    heading = add(scale(s, u), scale(-c, v))
    return multiply(size, place), unit(multiply(size, heading)), length


@compiled
def _pencil(p: Vector, q: Vector) -> Pencil:
    u = unit(subtract(q, p))
    foot = along(p, -dot(p, u), u)
    away = norm(foot)
    towards = scale(1.0 / away, foot) if away > 1e-12 else any_across(u)
    return towards, cross(u, towards), u, away, dot(p, u), dot(q, u)


@compiled
def _products_across(size: Vector, pencil: Pencil) -> Vector:
    """Products xx, xy and yy of the directions towards the foot and across, at right angles to the line [m²]."""
    x, y, u = multiply(size, pencil[0]), multiply(size, pencil[1]), unit(multiply(size, pencil[2]))
    x, y = along(x, -dot(x, u), u), along(y, -dot(y, u), u)
    return dot(x, x), dot(x, y), dot(y, y)


@compiled
def _set_square_heights(away: float, products: Vector, detours: Array) -> None:
    """Squares of the heights of the circles' tops above the line [m²], to which the detours are nearly proportional."""
    xx, xy, yy = products
    for k in range(PLANES):
        height = sqrt(1.0 - away * away * SINES[k] * SINES[k]) - away * COSINES[k]
        detours[k] = (height * _norm(xx, xy, yy, COSINES[k], SINES[k])) ** 2


@compiled
def _least_height(away: float, products: Vector, angle: float) -> float:
    """Improve the angle of a least height, by Newton's method for the derivative of its logarithm."""
    xx, xy, yy = products
    for _ in range(REFINEMENTS):
        c, s = cos(angle), sin(angle)
        radius = sqrt(1.0 - away * away * s * s)
        square = c * c * xx + 2.0 * c * s * xy + s * s * yy
        share = (c * s * (yy - xx) + (c * c - s * s) * xy) / square
        bend = ((c * c - s * s) * (yy - xx) - 4.0 * c * s * xy) / square - 2.0 * share * share
        slope, bend = share + away * s / radius, bend + away * c / radius**3
        step = -slope / bend if bend > 0.0 else 0.0
        angle += min(max(step, -0.5 * STEP), 0.5 * STEP)
    return angle


@compiled
def _set_detours(size: Vector, pencil: Pencil, straight: float, detours: Array) -> None:
    """How much longer [m] than the straight line the path in each half-plane is."""
    u, at_start, at_end = pencil[2], pencil[4], pencil[5]
    for k in range(PLANES):
        v, _, height, radius, c, s, arc = _circle(pencil, COSINES[k], SINES[k])
        x, y = multiply(size, u), multiply(size, v)
        xx, xy, yy = dot(x, x), dot(x, y), dot(y, y)
        turned_c, turned_s = c * cos(arc) + s * sin(arc), s * cos(arc) - c * sin(arc)
        before = _norm(xx, xy, yy, radius * c - at_start, radius * s - height)
        behind = _norm(xx, xy, yy, at_end - radius * turned_c, height - radius * turned_s)
        detours[k] = before + radius * _arc(xx, xy, yy, c, s, arc) + behind - straight


@compiled
def _circle(pencil: Pencil, cosine: float, sine: float) -> Circle:
    """Tangents to a circle of radius r from p, |p| = d, touch it at r/d (p/d turned by ± the angle with cosine r/d)."""
    towards, across, _, away, at_start, at_end = pencil
    v = add(scale(cosine, towards), scale(sine, across))
    height, radius = away * cosine, sqrt(1.0 - away * away * sine * sine)
    centre = along(scale(away, towards), -height, v)
    from_start, from_end = at_start * at_start + height * height, at_end * at_end + height * height
    k, m = sqrt(max(from_start - radius * radius, 0.0)), sqrt(max(from_end - radius * radius, 0.0))
    c, s = (at_start * radius + height * k) / from_start, (height * radius - at_start * k) / from_start
    end_c, end_s = (at_end * radius - height * m) / from_end, (height * radius + at_end * m) / from_end
    arc = atan2(s * end_c - c * end_s, c * end_c + s * end_s)
    return v, centre, height, radius, c, s, (arc if arc > -ROUND_OFF else arc + 2.0 * pi)


@compiled
def _middle(pencil: Pencil, cosine: float, sine: float) -> Vector:
    """Middle of the path on the unit sphere."""
    v, centre, _, radius, c, s, arc = _circle(pencil, cosine, sine)
    half_c, half_s = cos(0.5 * arc), sin(0.5 * arc)
    middle = add(scale(c * half_c + s * half_s, pencil[2]), scale(s * half_c - c * half_s, v))
    return add(centre, scale(radius, middle))


@compiled
def _arc(xx: float, xy: float, yy: float, c: float, s: float, arc: float) -> float:
    """Length of the arc from (c, s) on, of an ellipse x cos φ + y sin φ: by Gauss and Legendre's quadrature."""
    half_c, half_s = cos(0.5 * arc), sin(0.5 * arc)
    off_c, off_s = cos(OFF_MIDDLE * arc), sin(OFF_MIDDLE * arc)
    c, s = c * half_c + s * half_s, s * half_c - c * half_s
    middle = _norm(xx, xy, yy, -s, c)
    before = _norm(xx, xy, yy, -s * off_c - c * off_s, c * off_c - s * off_s)
    behind = _norm(xx, xy, yy, -s * off_c + c * off_s, c * off_c + s * off_s)
    return arc * (5.0 * before + 8.0 * middle + 5.0 * behind) / 18.0


@compiled
def _norm(xx: float, xy: float, yy: float, a: float, b: float) -> float:
    """|a x + b y|, of vectors with these products."""
    return sqrt(a * a * xx + 2.0 * a * b * xy + b * b * yy)


@compiled
def _parabola_minimum(before: float, here: float, behind: float) -> float:
    """Minimum point of the parabola through three equidistant lengths, of which the middle one is the least."""
    bend = before - 2.0 * here + behind
    return 0.5 * STEP * (before - behind) / bend if bend > ROUND_OFF * here else 0.0
