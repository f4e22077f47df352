"""How fast a laid path lengthens and how it pulls, as OpenSim 4.6 has it (GeometryPath); compiled, for all paths.

The tangent points count as fixed in their bodies: for exact tangents their sliding changes the length in second order
only. OpenSim's tangents are not exact, so the forces are not quite the derivative of the length.
"""

from __future__ import annotations

from solver.course import Array, Course, Courses, Lane, Pose
from solver.vectors import SMALLEST_LENGTH, Vector, add, compiled, cross, dot, norm, scale, subtract
from solver.wrapping import lay_path, place_in_ground, read, turn


@compiled
def lay_all(
    courses: Courses, poses: Pose, lane: Lane, lengths: Array, speeds: Array, wrenches: Array, mobilities: Array
) -> None:
    """Lay every path in every frame (`poses` with frames first) and fill lengths and speeds (frames, paths), wrenches
    (frames, paths, bodies, 6) and mobilities (frames, paths, coordinates), the last two zero on entry.
    """
    for frame in range(lengths.shape[0]):
        pose = Pose(
            poses.rotation[frame],
            poses.origin[frame],
            poses.angular_velocity[frame],
            poses.origin_velocity[frame],
            poses.coordinates[frame],
            poses.speeds[frame],
        )
        for path in range(lengths.shape[1]):
            course = _course(courses, path)
            count, lengths[frame, path] = lay_path(course, pose, lane)
            speeds[frame, path] = _speed(course, pose, lane, count)
            _pull(course, pose, lane, count, wrenches[frame, path], mobilities[frame, path])


@compiled
def _course(courses: Courses, path: int) -> Course:
    all_ = courses.course
    p, q = courses.first_point[path], courses.first_point[path + 1]
    v, w = courses.first_wrap[path], courses.first_wrap[path + 1]
    return Course(
        all_.point_body[p:q],
        all_.point_location[p:q],
        all_.point_slope[p:q],
        all_.point_coordinate[p:q],
        all_.point_range[p:q],
        all_.surface[v:w],
        all_.kind[v:w],
        all_.method[v:w],
        all_.body[v:w],
        all_.rotation[v:w],
        all_.translation[v:w],
        all_.dimensions[v:w],
        all_.axis[v:w],
        all_.allowed[v:w],
    )


@compiled
def _speed(course: Course, pose: Pose, lane: Lane, count: int) -> float:
    speed = 0.0
    for k in range(count - 1):
        start, end = lane.sequence[k], lane.sequence[k + 1]
        apart = subtract(place_in_ground(pose, lane, end), place_in_ground(pose, lane, start))
        parting = subtract(_velocity(course, pose, lane, end), _velocity(course, pose, lane, start))
        length = norm(apart)
        speed += dot(parting, apart) / length if length >= SMALLEST_LENGTH else norm(parting)
    return speed


@compiled
def _velocity(course: Course, pose: Pose, lane: Lane, node: int) -> Vector:
    """Velocity of a node in ground, which a coordinate may move in its body."""
    body = lane.body[node]
    arm = turn(pose.rotation[body], read(lane.location, node))
    velocity = add(read(pose.origin_velocity, body), cross(read(pose.angular_velocity, body), arm))
    coordinate = _coordinate(course, node)
    if coordinate < 0:
        return velocity
    slide = turn(pose.rotation[body], read(course.point_slope, node))
    return add(velocity, scale(pose.speeds[coordinate], slide))


@compiled
def _coordinate(course: Course, node: int) -> int:
    return int(course.point_coordinate[node]) if node < course.point_body.shape[0] else -1


@compiled
def _pull(course: Course, pose: Pose, lane: Lane, count: int, wrench: Array, mobility: Array) -> None:
    """Add what a tension of 1 does: force only between different bodies, on the straight pieces."""
    for k in range(count - 1):
        start, end = lane.sequence[k], lane.sequence[k + 1]
        if lane.body[start] == lane.body[end]:
            continue
        apart = subtract(place_in_ground(pose, lane, end), place_in_ground(pose, lane, start))
        force = scale(1.0 / norm(apart), apart)
        _apply(course, pose, lane, start, force, wrench, mobility)
        _apply(course, pose, lane, end, scale(-1.0, force), wrench, mobility)


@compiled
def _apply(course: Course, pose: Pose, lane: Lane, node: int, force: Vector, wrench: Array, mobility: Array) -> None:
    body = lane.body[node]
    place = add(turn(pose.rotation[body], read(lane.location, node)), read(pose.origin, body))
    moment = cross(place, force)
    for i in range(3):
        wrench[body, i] += moment[i]
        wrench[body, 3 + i] += force[i]
    coordinate = _coordinate(course, node)
    if coordinate >= 0:
        mobility[coordinate] += dot(turn(pose.rotation[body], read(course.point_slope, node)), force)
