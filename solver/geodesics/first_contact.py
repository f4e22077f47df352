"""First contact of a straight segment with a surface: exact on spheres and cylinders, a guess on ellipsoids.

Points are in the surface's own frame [m].
"""

from __future__ import annotations

from math import atan2, cos, isnan, nan, pi, sin, sqrt

from solver.compiled import compiled
from solver.geodesics.planes import contact_in_plane, shortest_planes
from solver.vectors import ORIGIN, Array, Vector, add, any_across, cross, dot, norm, scale, subtract, unit
from solver.wrapping.path_tables import ELLIPSOID, SPHERE
from solver.wrapping.segment import pierces, side

FirstContact = tuple[bool, Vector, Vector, float, float]
"""Whether there is contact, then the geodesic: its middle, its direction there, its length; and on an ellipsoid
the plane (planes.py) of another geodesic that may be as short, or NaN."""

NO_CONTACT = (False, ORIGIN, ORIGIN, 0.0, nan)


@compiled
def find_first_contact(
    kind: int, size: Vector, axis: int, allowed: int, start: Vector, end: Vector, detours: Array
) -> FirstContact:
    """axis, allowed: the path must pass where coordinate `axis` has the sign `allowed`; 0 allows all sides."""
    if kind == ELLIPSOID:
        return _contact_ellipsoid(size, axis, allowed, start, end, detours)
    if kind == SPHERE:
        return _contact_sphere(size[0], axis, allowed, start, end)
    return _contact_cylinder(size[0], size[2], axis, allowed, start, end)


@compiled
def _contact_ellipsoid(
    size: Vector, axis: int, allowed: int, start: Vector, end: Vector, detours: Array
) -> FirstContact:
    angle, another = shortest_planes(size, axis, allowed, start, end, detours)
    if isnan(angle):
        return NO_CONTACT
    place, heading, length = contact_in_plane(size, start, end, angle)
    return True, place, heading, length, another


@compiled
def _contact_sphere(radius: float, axis: int, allowed: int, start: Vector, end: Vector) -> FirstContact:
    """As in OpenSim, there is contact only if the segment intersects the sphere; the path takes the allowed side."""
    if norm(start) <= radius or norm(end) <= radius or not pierces(subtract(end, start), start, radius * radius)[0]:
        return NO_CONTACT
    x = unit(start)
    normal = cross(start, end)
    # Through the centre, all directions are equally short.
    normal = any_across(x) if norm(normal) < 1e-14 * norm(start) * norm(end) else unit(normal)
    y, opening = cross(normal, x), atan2(norm(cross(start, end)), dot(start, end))
    at_start, at_end = _tangent_angle(norm(start), radius), _tangent_angle(norm(end), radius)
    middle = 0.5 * (at_start + opening - at_end)
    is_free = allowed == 0 or (side(start[axis]) == allowed and side(end[axis]) == allowed)
    if not is_free and side(cos(middle) * x[axis] + sin(middle) * y[axis]) != allowed:
        y, opening = scale(-1.0, y), 2.0 * pi - opening
        middle = 0.5 * (at_start + opening - at_end)
    c, s = cos(middle), sin(middle)
    heading = add(scale(-s, x), scale(c, y))
    return True, scale(radius, add(scale(c, x), scale(s, y))), heading, radius * (opening - at_start - at_end), nan


@compiled
def _contact_cylinder(
    radius: float, length: float, axis: int, allowed: int, start: Vector, end: Vector
) -> FirstContact:
    """On the unrolled cylinder the path is straight. As in OpenSim, there is no contact beyond the cylinder's ends."""
    from_axis, to_axis = sqrt(start[0] ** 2 + start[1] ** 2), sqrt(end[0] ** 2 + end[1] ** 2)
    if from_axis <= radius or to_axis <= radius:
        return NO_CONTACT
    sweep = _sweep(axis, allowed, start, end)
    at_start, at_end = _tangent_angle(from_axis, radius), _tangent_angle(to_axis, radius)
    arc = radius * (abs(sweep) - at_start - at_end)
    if not arc > 0.0:
        return NO_CONTACT
    sense = 1.0 if sweep > 0.0 else -1.0
    before, behind = sqrt(from_axis**2 - radius**2), sqrt(to_axis**2 - radius**2)
    slope = (end[2] - start[2]) / (before + arc + behind)
    low, high = start[2] + slope * before, end[2] - slope * behind
    if abs(low) > length / 2.0 and abs(high) > length / 2.0:
        return NO_CONTACT
    turned = at_start + 0.5 * arc / radius
    c, s = cos(turned), sense * sin(turned)
    x, y = (c * start[0] - s * start[1]) / from_axis, (s * start[0] + c * start[1]) / from_axis
    stretch = sqrt(1.0 + slope * slope)
    heading = (-sense * y / stretch, sense * x / stretch, slope / stretch)
    return True, (radius * x, radius * y, 0.5 * (low + high)), heading, arc * stretch, nan


@compiled
def _sweep(axis: int, allowed: int, start: Vector, end: Vector) -> float:
    """The angle about z from start to end: the smaller one or, where only one side is allowed, the one that does not
    pass the middle of the other side. A side along z does not restrict the direction.
    """
    if allowed == 0 or axis == 2:
        return atan2(start[0] * end[1] - start[1] * end[0], start[0] * end[0] + start[1] * end[1])
    return _angle_from_forbidden_side(axis, allowed, end) - _angle_from_forbidden_side(axis, allowed, start)


@compiled
def _angle_from_forbidden_side(axis: int, allowed: int, point: Vector) -> float:
    """The angle about z, 0 to 2π, from the middle of the forbidden side."""
    angle = atan2(allowed * point[1 - axis] * (-1.0 if axis == 0 else 1.0), -allowed * point[axis])
    return angle if angle >= 0.0 else angle + 2.0 * pi


@compiled
def _tangent_angle(away: float, radius: float) -> float:
    """Angle at the centre between a point and the point where a tangent from it touches the circle."""
    return atan2(sqrt(away * away - radius * radius), radius)
