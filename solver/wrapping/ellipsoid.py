"""A path over an ellipsoid, as in OpenSim 4.6 (WrapEllipsoid): in one plane through both ends.

The plane is found from a point c of the surface near which the path should pass; the tangent points lie in that plane
and the path between them is its section with the ellipsoid. Lengths are scaled so that the semi-axes average 1.
Searches stop early, by OpenSim's rules, so that the lengths are the same.
"""

from __future__ import annotations

from math import acos, cos, pi, sin, sqrt

from solver.compiled import compiled
from solver.vectors import (
    ORIGIN,
    Vector,
    add,
    along,
    cross,
    distance,
    divide,
    dot,
    multiply,
    scale,
    subtract,
    unit,
)
from solver.wrapping.closest import ANY_AXIS, closest_on_ellipsoid
from solver.wrapping.fan import Fan, fan_direction
from solver.wrapping.path_tables import AXIAL, MIDPOINT, Codes
from solver.wrapping.segment import INSIDE_RADIUS, MANDATORY_WRAP, NO_WRAP, WrapResult, pierces, side
from solver.wrapping.tangent import ON_THE_SURFACE, tangent_point

SAME_DIRECTION = 1e-4
ALL_FAN = 0.7073
ALL_AXIAL = 0.9
FADE = 0.3
CHORD = 0.001
MOST_CHORDS = 499

Plane = tuple[Vector, float]
"""Normal ν and offset o of the points x with ν·x + o = 0."""


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
    mirrored = (
        -c[0] if axis == 0 else c[0],
        -c[1] if axis == 1 else c[1],
        -c[2] if axis == 2 else c[2],
    )
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
