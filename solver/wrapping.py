"""A path over its surfaces, as OpenSim 4.6 lays it (GeometryPath): each surface in turn, until the length settles.

OpenSim keeps the place in ground that a tangent point had when it was first used in a posture, although later sweeps
move the point in its body. Lengths and directions of force come from the kept places, points of application and the
wrapping itself from the latest ones: `Lane.ground` and `Lane.location`. The results are OpenSim's only so.
"""

from __future__ import annotations

from math import inf

from solver.course import ELLIPSOID, NO_SURFACE, SPHERE, Array, Course, Lane, Pose
from solver.cylinder import wrap_cylinder
from solver.ellipsoid import wrap_ellipsoid
from solver.segment import FREE, INSIDE, MANDATORY, POSSIBLE, Contact
from solver.sphere import wrap_sphere
from solver.vectors import ORIGIN, Vector, along, compiled, distance

MOST_SWEEPS = 8
SETTLED = 0.0005


@compiled
def lay_path(course: Course, pose: Pose, lane: Lane) -> tuple[int, float]:
    """Lay one path; afterwards `lane` holds it. Returns how many nodes are in the sequence, and the length [m]."""
    count = _lay_points(course, pose, lane)
    surfaces = course.surface.shape[0]
    length = inf
    for sweep in range(MOST_SWEEPS if surfaces > 1 else 1):
        for turn in range(surfaces):
            count = _try_surface(course, pose, lane, turn, count)
        previous, length = length, _length(pose, lane, count)
        if abs(length - previous) < SETTLED:
            break
        if sweep == 0 and surfaces > 1 and lane.answer[0] == FREE and lane.answer[1] == INSIDE:
            lane.order[0], lane.order[1] = 1, 0
            count = _remove_tangent_points(course, lane, 0, count)
    return count, length


@compiled
def place_in_ground(pose: Pose, lane: Lane, node: int) -> Vector:
    """Where a node was in ground when it was first asked for in this posture."""
    if not lane.is_placed[node]:
        place = transform(pose.rotation[lane.body[node]], pose.origin[lane.body[node]], read(lane.location, node))
        write(lane.ground, node, place)
        lane.is_placed[node] = True
    return read(lane.ground, node)


@compiled
def is_over_surface(lane: Lane, start: int, end: int) -> bool:
    """Whether the path runs over a surface, not straight, between two neighbouring nodes."""
    return bool(lane.surface[start] != NO_SURFACE and lane.surface[start] == lane.surface[end])


@compiled
def transform(rotation: Array, translation: Array, point: Vector) -> Vector:
    x, y, z = turn(rotation, point)
    return x + translation[0], y + translation[1], z + translation[2]


@compiled
def turn(rotation: Array, vector: Vector) -> Vector:
    x, y, z = vector
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@compiled
def read(rows: Array, row: int) -> Vector:
    return rows[row, 0], rows[row, 1], rows[row, 2]


@compiled
def write(rows: Array, row: int, value: Vector) -> None:
    rows[row, 0], rows[row, 1], rows[row, 2] = value


@compiled
def _lay_points(course: Course, pose: Pose, lane: Lane) -> int:
    points: int = course.point_body.shape[0]
    for point in range(points):
        location, coordinate = read(course.point_location, point), course.point_coordinate[point]
        if coordinate >= 0:
            lowest, highest = course.point_range[point, 0], course.point_range[point, 1]
            held = min(max(pose.coordinates[coordinate], lowest), highest)
            location = along(location, held, read(course.point_slope, point))
        write(lane.location, point, location)
        lane.sequence[point] = point
        lane.body[point] = course.point_body[point]
        lane.surface[point] = NO_SURFACE
        lane.is_placed[point] = False
    for wrap in range(course.surface.shape[0]):
        lane.order[wrap] = wrap
        for node in (points + 2 * wrap, points + 2 * wrap + 1):
            lane.body[node] = course.body[wrap]
            lane.surface[node] = course.surface[wrap]
            lane.is_placed[node] = False
    return points


@compiled
def _try_surface(course: Course, pose: Pose, lane: Lane, turn: int, count: int) -> int:
    """Take the path off one surface and lay it over it anew, where it must or where the detour is the shortest."""
    wrap = lane.order[turn]
    count = _remove_tangent_points(course, lane, wrap, count)
    lane.answer[turn] = FREE
    behind, r1, r2, on_surface, least_detour = -1, ORIGIN, ORIGIN, 0.0, inf
    for k in range(count - 1):
        start, end = lane.sequence[k], lane.sequence[k + 1]
        if is_over_surface(lane, start, end):
            continue
        answer, s1, s2, length = _lay_segment(course, pose, lane, wrap, start, end)
        lane.answer[turn] = answer
        if answer == MANDATORY:
            behind, r1, r2, on_surface = k, s1, s2, length
            break
        if answer == POSSIBLE:
            detour = _detour(pose, lane, start, end, course.body[wrap], s1, s2, length)
            if detour < least_detour:
                behind, r1, r2, on_surface, least_detour = k, s1, s2, length, detour
    if behind < 0:
        return count
    return _insert_tangent_points(course, lane, wrap, count, behind, r1, r2, on_surface)


@compiled
def _lay_segment(course: Course, pose: Pose, lane: Lane, wrap: int, start: int, end: int) -> Contact:
    """Lay the segment between two nodes over a surface; the tangent points are in the surface's body."""
    p1, p2 = _to_surface(course, pose, lane, wrap, start), _to_surface(course, pose, lane, wrap, end)
    size, axis, allowed = read(course.dimensions, wrap), course.axis[wrap], course.allowed[wrap]
    if course.kind[wrap] == ELLIPSOID:
        answer, r1, r2, length = wrap_ellipsoid(p1, p2, size, course.method[wrap], axis, allowed)
    elif course.kind[wrap] == SPHERE:
        answer, r1, r2, length = wrap_sphere(p1, p2, size[0], axis, allowed)
    else:
        is_alone = course.surface.shape[0] == 1
        answer, r1, r2, length = wrap_cylinder(p1, p2, size[0], size[2], axis, allowed, is_alone)
    rotation, translation = course.rotation[wrap], course.translation[wrap]
    return answer, transform(rotation, translation, r1), transform(rotation, translation, r2), length


@compiled
def _to_surface(course: Course, pose: Pose, lane: Lane, wrap: int, node: int) -> Vector:
    """The latest place of a node, in the frame of a surface."""
    point, body, target = read(lane.location, node), lane.body[node], course.body[wrap]
    if body != target:
        ground = transform(pose.rotation[body], pose.origin[body], point)
        point = _transform_back(pose.rotation[target], pose.origin[target], ground)
    return _transform_back(course.rotation[wrap], course.translation[wrap], point)


@compiled
def _transform_back(rotation: Array, translation: Array, point: Vector) -> Vector:
    x, y, z = point[0] - translation[0], point[1] - translation[1], point[2] - translation[2]
    return (
        rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z,
        rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z,
        rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z,
    )


@compiled
def _detour(
    pose: Pose, lane: Lane, start: int, end: int, body: int, r1: Vector, r2: Vector, on_surface: float
) -> float:
    """How much longer the segment gets. Asking for its ends keeps their places for this posture, as in OpenSim."""
    a, b = place_in_ground(pose, lane, start), place_in_ground(pose, lane, end)
    rotation, origin = pose.rotation[body], pose.origin[body]
    to_surface, from_surface = (
        distance(a, transform(rotation, origin, r1)),
        distance(b, transform(rotation, origin, r2)),
    )
    return to_surface + on_surface + from_surface - distance(a, b)


@compiled
def _insert_tangent_points(
    course: Course, lane: Lane, wrap: int, count: int, behind: int, r1: Vector, r2: Vector, on_surface: float
) -> int:
    node = course.point_body.shape[0] + 2 * wrap
    write(lane.location, node, r1)
    write(lane.location, node + 1, r2)
    lane.on_surface[node + 1] = on_surface
    for k in range(count - 1, behind, -1):
        lane.sequence[k + 2] = lane.sequence[k]
    lane.sequence[behind + 1], lane.sequence[behind + 2] = node, node + 1
    return count + 2


@compiled
def _remove_tangent_points(course: Course, lane: Lane, wrap: int, count: int) -> int:
    node = course.point_body.shape[0] + 2 * wrap
    for k in range(count):
        if lane.sequence[k] == node:
            for later in range(k + 2, count):
                lane.sequence[later - 2] = lane.sequence[later]
            return count - 2
    return count


@compiled
def _length(pose: Pose, lane: Lane, count: int) -> float:
    length = 0.0
    for k in range(count - 1):
        start, end = lane.sequence[k], lane.sequence[k + 1]
        a, b = place_in_ground(pose, lane, start), place_in_ground(pose, lane, end)
        length += lane.on_surface[end] if is_over_surface(lane, start, end) else distance(a, b)
    return length
