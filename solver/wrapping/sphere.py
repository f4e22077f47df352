"""A path over a sphere, as in OpenSim 4.6 (WrapSphere): two tangents and the great circle between them."""

from __future__ import annotations

from math import acos, asin, cos, pi, sin

from solver.compiled import compiled
from solver.vectors import ORIGIN, Vector, add, along, cross, dot, norm, scale, subtract, unit
from solver.wrapping.segment import INSIDE_RADIUS, MANDATORY_WRAP, NO_WRAP, WRAPPED, WrapResult, pierces, side

THROUGH_THE_CENTRE = 1e-5


@compiled
def wrap_sphere(start: Vector, end: Vector, radius: float, axis: int, allowed: int) -> WrapResult:
    """Wrap the segment from start to end over a sphere about the origin [m].

    axis, allowed  the path must stay where coordinate `axis` has the sign `allowed`; 0 allows all sides
    """
    if norm(start) < radius or norm(end) < radius:
        return INSIDE_RADIUS, ORIGIN, ORIGIN, 0.0
    backwards = subtract(start, end)
    normal = cross(unit(backwards), unit(end))
    # Through the centre all planes are equal: OpenSim takes its previous result, which is not available here.
    if not pierces(backwards, end, radius * radius)[0] or norm(normal) < THROUGH_THE_CENTRE:
        return NO_WRAP, ORIGIN, ORIGIN, 0.0

    normal = unit(normal)
    start_a, start_b = _tangent_points(start, normal, radius)
    end_a, end_b = _tangent_points(end, normal, radius)
    start_is_allowed, end_is_allowed = side(start[axis]) == allowed, side(end[axis]) == allowed
    if allowed == 0 or (start_is_allowed and end_is_allowed):
        r1, r2 = nearest_pair(start_a, start_b, end_a, end_b)
        length = radius * acos(dot(unit(r1), unit(r2)))
        return (WRAPPED if allowed == 0 else MANDATORY_WRAP), r1, r2, length

    r1, r2, goes_round = _pair_on_the_allowed_side(start, end, start_a, start_b, end_a, end_b, axis, allowed)
    angle = acos(dot(unit(r1), unit(r2)))
    if goes_round:
        angle = -(2.0 * pi - angle)  # the sign is OpenSim's
    return (MANDATORY_WRAP if start_is_allowed or end_is_allowed else WRAPPED), r1, r2, radius * angle


@compiled
def nearest_pair(a1: Vector, b1: Vector, a2: Vector, b2: Vector) -> tuple[Vector, Vector]:
    """Of a1 or b1 with a2 or b2, the pair with the smallest angle seen from the origin."""
    u1, v1, u2, v2 = unit(a1), unit(b1), unit(a2), unit(b2)
    aa, ab, ba, bb = dot(u1, u2), dot(u1, v2), dot(v1, u2), dot(v1, v2)
    if aa > ab and aa > ba and aa > bb:
        return a1, a2
    if ab > ba and ab > bb:
        return a1, b2
    if ba > bb:
        return b1, a2
    return b1, b2


@compiled
def _tangent_points(point: Vector, normal: Vector, radius: float) -> tuple[Vector, Vector]:
    """The two tangent points of lines from `point` in the plane through the origin with this normal."""
    inwards = unit(scale(-1.0, point))
    sideways = cross(normal, inwards)
    distance = norm(point)
    angle = asin(radius / distance)
    reach = distance * cos(angle)
    ahead = scale(cos(angle), inwards)
    return along(point, reach, along(ahead, -sin(angle), sideways)), along(
        point, reach, along(ahead, sin(angle), sideways)
    )


@compiled
def _pair_on_the_allowed_side(
    start: Vector,
    end: Vector,
    start_a: Vector,
    start_b: Vector,
    end_a: Vector,
    end_b: Vector,
    axis: int,
    allowed: int,
) -> tuple[Vector, Vector, bool]:
    """The tangent points of a path on the allowed side, and whether it takes the longer arc."""
    inwards = unit(scale(-1.0, add(start, end)))
    start_takes_a = dot(unit(start_a), inwards) > dot(unit(start_b), inwards)
    end_takes_a = dot(unit(end_a), inwards) > dot(unit(end_b), inwards)
    r1, other_1 = (start_a, start_b) if start_takes_a else (start_b, start_a)
    r2, other_2 = (end_a, end_b) if end_takes_a else (end_b, end_a)
    pull = unit(add(subtract(r1, start), subtract(r2, end)))
    if allowed * pull[axis] < 0.0:
        r1, r2 = other_1, other_2
    pull = add(subtract(r1, start), subtract(r2, end))
    return r1, r2, dot(add(r1, r2), pull) < 0.0
