"""A path over a sphere or a cylinder, as in OpenSim 4.6.

WrapCylinder: two tangents and the spiral between them. The axis is z of the surface's frame. OpenSim adjusts the
tangent points along the axis until the path is smooth there, by a rule that need not converge. The rule is kept, so
that the lengths are the same.

WrapSphere: two tangents and the great circle between them.

A path over a torus, as in OpenSim 4.6 (WrapTorus): over a cylinder in place of the tube where the path is nearest.

The ring lies in the plane z = 0 of the surface's frame. OpenSim looks for the point of the path's line that is nearest
to the ring, once from either end, and ends that search early; its steps are kept, so that the lengths are the same.

The search is OpenSim's Lmdif for one unknown: Moré, "The Levenberg–Marquardt algorithm", Lecture Notes in Mathematics
630 (1978), MINPACK's LMDIF. OpenSim stops it early, so that its result depends on every step; the rules and their
constants are kept.
"""

from __future__ import annotations

from math import acos, asin, atan2, cos, inf, pi, radians, sin, sqrt, tan

from solver.compiled import compiled
from solver.vectors import (
    ORIGIN,
    SMALLEST_LENGTH,
    Vector,
    add,
    along,
    cross,
    distance,
    dot,
    norm,
    scale,
    subtract,
    unit,
)
from solver.wrapping.path_tables import NOT_CONVERGED, Codes
from solver.wrapping.segment import (
    INSIDE_RADIUS,
    MANDATORY_WRAP,
    NO_WRAP,
    WRAPPED,
    WrapResult,
    nearest_on_lines,
    pierces,
    side,
)

AXIS = (0.0, 0.0, 1.0)
PIECE = 0.002
STEEPEST_KINK = tan(radians(0.1))
MOST_ADJUSTMENTS = 100
OVERSHOOT = 1.5
ALONG_THE_AXIS = 5e-7

Tangents = tuple[Vector, Vector, bool, float]
"""Tangent points, whether the apex between them is the far one, and the signed angle of the spiral between them."""
THROUGH_THE_CENTRE = 1e-5


@compiled
def wrap_cylinder(
    start: Vector, end: Vector, radius: float, length: float, axis: int, allowed: int, surfaces: int, code: Codes
) -> WrapResult:
    """Wrap the segment from start to end over a cylinder [m].

    axis, allowed  the path must stay where coordinate `axis` has the sign `allowed`; 0 allows all sides
    surfaces       number of surfaces of the path: if it is 1, OpenSim does not adjust the tangent points
    code           (1,) set to NOT_CONVERGED where the adjustment does not end
    """
    if _radial_square(start) < radius * radius or _radial_square(end) < radius * radius:
        return INSIDE_RADIUS, ORIGIN, ORIGIN, 0.0
    action = _wrap_action(start, end, radius, length, axis, allowed)
    if action == NO_WRAP:
        return NO_WRAP, ORIGIN, ORIGIN, 0.0
    r1, r2, is_far, angle = _tangents(start, end, radius, axis, allowed)
    near, far = _apexes(start, end, radius)
    r1, r2 = _slide_into_plane(start, end, r1, r2, far if is_far else near)
    if abs(r1[2]) > length / 2.0 and abs(r2[2]) > length / 2.0:
        return NO_WRAP, ORIGIN, ORIGIN, 0.0
    adjustments = 0 if surfaces == 1 else MOST_ADJUSTMENTS
    r1, r2, on_surface = _spiral(start, end, r1, r2, radius, angle, adjustments, code)
    return action, r1, r2, on_surface


@compiled
def _wrap_action(start: Vector, end: Vector, radius: float, length: float, axis: int, allowed: int) -> int:
    top, bottom = (0.0, 0.0, 0.5 * length), (0.0, 0.0, -0.5 * length)
    near, fraction, on_axis = nearest_on_lines(start, end, bottom, top)
    gap = subtract(near, on_axis)
    is_hit = dot(gap, gap) < radius * radius and 0.0 < fraction < 1.0
    if allowed == 0:
        return MANDATORY_WRAP if is_hit else NO_WRAP
    if side(start[axis]) != allowed and side(end[axis]) != allowed:
        return WRAPPED
    if is_hit:
        return MANDATORY_WRAP
    if side(start[axis]) != side(end[axis]) and side(near[axis]) != allowed:
        return WRAPPED
    return NO_WRAP


@compiled
def _tangents(start: Vector, end: Vector, radius: float, axis: int, allowed: int) -> Tangents:
    start_a, start_b = _cylinder_tangents(start, radius)
    end_a, end_b = _cylinder_tangents(end, radius)
    if allowed == 0:
        r1, r2 = nearest_pair(_radial(start_a), _radial(start_b), _radial(end_a), _radial(end_b))
        return (r1[0], r1[1], start[2]), (r2[0], r2[1], end[2]), False, _angle_about_axis(r1, r2)

    angle_ab = _angle(_radial(start_a), _radial(end_b))
    angle_ba = _angle(_radial(start_b), _radial(end_a))
    a_on, b_on = side(start_a[axis]) == allowed, side(start_b[axis]) == allowed
    a_on_end, b_on_end = side(end_a[axis]) == allowed, side(end_b[axis]) == allowed
    ab_is_wider = angle_ab > angle_ba
    nothing_on = not (a_on or b_on or a_on_end or b_on_end)
    if nothing_on:
        takes_ab = ab_is_wider
    elif a_on == b_on:
        takes_ab = not a_on_end
    else:
        takes_ab = a_on
    r1, r2 = (start_a, end_b) if takes_ab else (start_b, end_a)
    is_far = nothing_on or takes_ab == ab_is_wider
    pull, angle = add(subtract(r1, start), subtract(r2, end)), _angle_about_axis(r1, r2)
    is_long = dot(add(_radial(r1), _radial(r2)), pull) < 0.0
    return r1, r2, is_far, angle - 2.0 * pi if is_long else angle


@compiled
def _cylinder_tangents(point: Vector, radius: float) -> tuple[Vector, Vector]:
    """The two tangent points of lines from `point` at its height."""
    foot = (0.0, 0.0, point[2])
    outwards = unit(_radial(point))
    reach = radius * (radius / norm(_radial(point)))
    chord = sqrt(radius * radius - reach * reach)
    middle, sideways = along(foot, reach, outwards), cross(AXIS, outwards)
    return along(middle, chord, sideways), along(middle, -chord, sideways)


@compiled
def _apexes(start: Vector, end: Vector, radius: float) -> tuple[Vector, Vector]:
    """The nearer and the farther of the two points of the surface over which the path may bend."""
    start_distance, end_distance = norm(_radial(start)), norm(_radial(end))
    middle = along(start, start_distance / (start_distance + end_distance), subtract(end, start))
    centre = (0.0, 0.0, middle[2])
    normal = unit(cross(unit(subtract(start, centre)), unit(subtract(end, centre))))
    towards = unit(cross(AXIS, normal))
    one, other = along(centre, radius, towards), along(centre, -radius, towards)
    return (one, other) if distance(middle, one) < distance(middle, other) else (other, one)


@compiled
def _slide_into_plane(start: Vector, end: Vector, r1: Vector, r2: Vector, apex: Vector) -> tuple[Vector, Vector]:
    """Move the tangent points along the axis into the plane of start, end and apex, unless that leads past an end."""
    normal = unit(cross(unit(subtract(start, apex)), unit(subtract(end, apex))))
    if not abs(normal[2]) >= ALONG_THE_AXIS:
        return r1, r2
    offset = dot(normal, start)
    z1 = (offset - normal[0] * r1[0] - normal[1] * r1[1]) / normal[2]
    z2 = (offset - normal[0] * r2[0] - normal[1] * r2[1]) / normal[2]
    # OpenSim takes the foot of `end` on the axis for the direction of the axis. At z = 0 it is zero, and nothing moves.
    has_direction = abs(end[2]) >= SMALLEST_LENGTH
    at_1, at_2 = (z1, z2) if has_direction else (start[2], start[2])
    if abs(at_1 - end[2]) < abs(start[2] - end[2]):
        r1 = (r1[0], r1[1], z1)
    if abs(at_2 - start[2]) < abs(start[2] - end[2]):
        r2 = (r2[0], r2[1], z2)
    return r1, r2


@compiled
def _spiral(
    start: Vector, end: Vector, r1: Vector, r2: Vector, radius: float, angle: float, adjustments: int, code: Codes
) -> tuple[Vector, Vector, float]:
    """The tangent points after at most `adjustments` steps along the axis, which make the tangents continue into the
    spiral, and the length of the spiral.
    """
    arc, z1, z2 = radius * angle, r1[2], r2[2]
    pieces, step, low, high = 0, 0.0, inf, 0.0
    out_1, out_2, share_1, share_2, chord = 0.0, 0.0, 0.0, 0.0, 0.0
    rise = z2 - z1
    for _ in range(adjustments):
        square = arc * arc + rise * rise
        if not low <= square < high:
            pieces = int(sqrt(square) / PIECE)
            if pieces < 2:
                break
            low, high = (pieces * PIECE) ** 2, ((pieces + 1) * PIECE) ** 2
            step = 1.0 / pieces
            out_1, share_1, chord = _seen_from_above(start, r1, _turned(r1, step * angle))
            out_2, share_2, chord = _seen_from_above(end, r2, _turned(r1, (1.0 - step) * angle))
        piece = step * rise
        z1, has_moved_1 = _adjust(start[2], z1, z1 + piece, out_1, chord, share_1)
        # As OpenSim does: the spiral already starts at the moved r1, its rise is still the old one.
        z2, has_moved_2 = _adjust(end[2], z2, z1 + (rise - piece), out_2, chord, share_2)
        if not (has_moved_1 or has_moved_2):
            break
        rise = z2 - z1
    else:
        if adjustments > 0:
            code[0] = NOT_CONVERGED
    return (r1[0], r1[1], z1), (r2[0], r2[1], z2), sqrt(arc * arc + rise * rise)


@compiled
def _seen_from_above(point: Vector, tangent: Vector, spiral: Vector) -> tuple[float, float, float]:
    """Across the axis: the distance from `point` to its tangent point; where the line from `point` to the next point of
    the spiral is nearest to the tangent point (0 at `point`, 1 at the spiral); the length of the spiral's first chord.
    """
    x, y = tangent[0] - point[0], tangent[1] - point[1]
    u, v = spiral[0] - point[0], spiral[1] - point[1]
    chord_x, chord_y = spiral[0] - tangent[0], spiral[1] - tangent[1]
    return sqrt(x * x + y * y), (x * u + y * v) / (u * u + v * v), sqrt(chord_x * chord_x + chord_y * chord_y)


@compiled
def _adjust(point: float, tangent: float, spiral: float, out: float, chord: float, share: float) -> tuple[float, bool]:
    """Slide a tangent point along the axis if the path from `point` over it to `spiral` has a kink there.

    All three are heights on the axis; out, share and chord as of _seen_from_above.
    """
    up, on = tangent - point, spiral - tangent
    across, ahead = up * chord - on * out, up * on + out * chord
    if not abs(across) > STEEPEST_KINK * ahead or spiral == point:
        return tangent, False
    straight = point + share * (spiral - point)
    return tangent + OVERSHOOT * (straight - tangent), True


@compiled
def _turned(point: Vector, angle: float) -> Vector:
    c, s = cos(angle), sin(angle)
    return c * point[0] - s * point[1], s * point[0] + c * point[1], point[2]


@compiled
def _radial(point: Vector) -> Vector:
    return (point[0], point[1], 0.0)


@compiled
def _angle_about_axis(a: Vector, b: Vector) -> float:
    """From a to b, −π to π."""
    return atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])


@compiled
def _radial_square(point: Vector) -> float:
    return point[0] * point[0] + point[1] * point[1]


@compiled
def _angle(a: Vector, b: Vector) -> float:
    return acos(dot(a, b) / (norm(a) * norm(b)))


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
    start_a, start_b = _sphere_tangents(start, normal, radius)
    end_a, end_b = _sphere_tangents(end, normal, radius)
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
def _sphere_tangents(point: Vector, normal: Vector, radius: float) -> tuple[Vector, Vector]:
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
    start: Vector, end: Vector, start_a: Vector, start_b: Vector, end_a: Vector, end_b: Vector, axis: int, allowed: int
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


LENGTH = 10_000.0  # of the cylinder [m]
X_AXIS, POSITIVE = 0, 1
TOLERANCE = 1e-4  # of the sum of squares, and of the unknown
FIRST_STEP = 0.2  # greatest first step, in the scaled unknown
DIFFERENCE = 1e-5  # for the slope
MOST_EVALUATIONS = 500
ACCEPTED, POOR, GOOD = 1e-4, 0.25, 0.75  # ratios of the actual to the predicted reduction
MOST_PARAMETERS = 10  # tried for one step


@compiled
def wrap_torus(
    start: Vector, end: Vector, tube: float, ring: float, axis: int, allowed: int, surfaces: int, code: Codes
) -> WrapResult:
    """Wrap the segment from start to end over a torus with the radii of its tube and of its ring [m].

    axis, allowed, surfaces, code  as in wrap_cylinder
    """
    is_found, center = _nearest_on_ring(start, end, ring, axis, allowed)
    if not is_found:
        return NO_WRAP, ORIGIN, ORIGIN, 0.0
    x = unit(scale(-1.0, center))
    y = (0.0, 0.0, -1.0)
    z = cross(x, y)
    p1, p2 = subtract(start, center), subtract(end, center)
    p1, p2 = (dot(x, p1), dot(y, p1), dot(z, p1)), (dot(x, p2), dot(y, p2), dot(z, p2))
    action, r1, r2, length = wrap_cylinder(p1, p2, tube, LENGTH, X_AXIS, POSITIVE, surfaces, code)
    if action not in (WRAPPED, MANDATORY_WRAP):
        return NO_WRAP, ORIGIN, ORIGIN, 0.0
    return WRAPPED, _from_cylinder(center, x, y, z, r1), _from_cylinder(center, x, y, z, r2), length


@compiled
def _from_cylinder(center: Vector, x: Vector, y: Vector, z: Vector, point: Vector) -> Vector:
    return add(center, along(along(scale(point[0], x), point[1], y), point[2], z))


@compiled
def _nearest_on_ring(start: Vector, end: Vector, ring: float, axis: int, allowed: int) -> tuple[bool, Vector]:
    """The point of the ring nearest to the line, of the two searches from either end, on the allowed side if any."""
    one, other = _search(start, end, ring), _search(end, start, ring)
    takes_one = _distance(one, ring) < _distance(other, ring)
    if allowed != 0:
        one_is_on, other_is_on = side(one[axis]) == allowed, side(other[axis]) == allowed
        if not (one_is_on or other_is_on):
            return False, ORIGIN
        if one_is_on != other_is_on:
            takes_one = one_is_on
    nearest = one if takes_one else other
    size = sqrt(nearest[0] * nearest[0] + nearest[1] * nearest[1])
    return True, (nearest[0] * ring / size, nearest[1] * ring / size, 0.0)


@compiled
def _distance(point: Vector, ring: float) -> float:
    x, y, z = point
    return sqrt(x * x + y * y + z * z + ring * ring - 2.0 * ring * sqrt(x * x + y * y))


@compiled
def _search(start: Vector, end: Vector, ring: float) -> Vector:
    """The point of the line, from `start` on, where the derivative of its squared distance from the ring is least.

    MINPACK's LMDIF for one unknown.
    """
    direction = subtract(end, start)
    direction = scale(1.0 / norm(direction), direction)
    u, extent, parameter, weight, bound, is_first = 0.0, 0.0, 0.0, 0.0, FIRST_STEP, True
    value = _slope(start, direction, ring, u)
    evaluations = 1
    while evaluations < MOST_EVALUATIONS and value != 0.0:
        slope = (_slope(start, direction, ring, u + DIFFERENCE) - value) / DIFFERENCE
        if slope == 0.0:
            break
        weight = max(weight, abs(slope))
        is_accepted = False
        while not is_accepted:
            step, parameter = limited_step(slope, value, weight, bound, parameter)
            size = abs(weight * step)
            if is_first:
                bound = min(bound, size)
            trial = _slope(start, direction, ring, u + step)
            evaluations += 1
            actual = 1.0 - (trial / value) ** 2 if 0.1 * abs(trial) < abs(value) else -1.0
            linear, damped = (slope * step / value) ** 2, parameter * (size / value) ** 2
            predicted = linear + 2.0 * damped
            ratio = actual / predicted if predicted != 0.0 else 0.0
            if ratio <= POOR:
                shrink = _shrinkage(actual, linear + damped, trial / value)
                bound, parameter = shrink * min(bound, 10.0 * size), parameter / shrink
            elif parameter == 0.0 or ratio >= GOOD:
                bound, parameter = 2.0 * size, 0.5 * parameter
            is_accepted = ratio >= ACCEPTED
            if is_accepted:
                u, extent, value, is_first = u + step, abs(weight * (u + step)), trial, False
            has_converged = abs(actual) <= TOLERANCE and predicted <= TOLERANCE and 0.5 * ratio <= 1.0
            if has_converged or bound <= TOLERANCE * extent or evaluations >= MOST_EVALUATIONS:
                return along(start, u, direction)
    return along(start, u, direction)


@compiled
def _shrinkage(actual: float, slope: float, growth: float) -> float:
    """Factor of the step bound after a poor step; growth is the new value over the old one."""
    shrink = 0.5 if actual >= 0.0 else 0.5 * slope / (slope - 0.5 * actual)
    return 0.1 if 0.1 * abs(growth) >= 1.0 or shrink < 0.1 else shrink


@compiled
def _slope(start: Vector, direction: Vector, ring: float, u: float) -> float:
    """Derivative by u of the squared distance between the ring and start + u · direction."""
    x, y, z = start
    nx, ny, nz = direction
    c2 = 2.0 * (x * nx + y * ny + z * nz)
    c3 = x * nx + y * ny
    c4 = nx * nx + ny * ny
    c5 = x * x + y * y
    return c2 + 2.0 * u - 2.0 * ring * (2.0 * c4 * u + 2.0 * c3) / sqrt(u * u * c4 + 2.0 * c3 * u + c5)


@compiled
def limited_step(slope: float, value: float, scale: float, bound: float, parameter: float) -> tuple[float, float]:
    """Step p of the linearised problem with |scale · p| about `bound` at most, and its damping parameter (LMPAR)."""
    step = value / slope if slope != 0.0 else 0.0
    size = abs(scale * step)
    excess = size - bound
    if excess <= 0.1 * bound:
        return -step, 0.0
    lowest = 0.0
    if slope != 0.0:
        change = abs(scale * (scale * step / size) / slope)
        lowest = excess / bound / change / change
    gradient = abs(slope * value / scale)
    highest = gradient / bound
    parameter = min(max(parameter, lowest), highest)
    if parameter == 0.0:
        parameter = gradient / size
    for attempt in range(MOST_PARAMETERS):
        if parameter == 0.0:
            parameter = 0.001 * highest
        damping = sqrt(parameter) * scale
        stiffness = sqrt(slope * slope + damping * damping)
        step = slope * value / (stiffness * stiffness)
        size = abs(scale * step)
        before, excess = excess, size - bound
        if abs(excess) <= 0.1 * bound or (lowest == 0.0 and excess <= before < 0.0) or attempt == MOST_PARAMETERS - 1:
            break
        change = abs(scale * (scale * step / size) / stiffness)
        correction = excess / bound / change / change
        if excess > 0.0:
            lowest = max(lowest, parameter)
        else:
            highest = min(highest, parameter)
        parameter = max(lowest, parameter + correction)
    return -step, parameter
