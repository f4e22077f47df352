"""A path over its surfaces as in OpenSim 4.6 (GeometryPath): each surface in turn, until the length converges.

OpenSim caches the place in ground of a tangent point at its first use in a posture, although later sweeps move the
point in its body. Lengths and directions of force use the cached places, points of application and the wrapping itself
the latest ones: `ground` and `location` of a node. Only so are the results those of OpenSim.

For lengthening speed and forces tangent points are taken as fixed in their bodies: for exact tangents their sliding
changes the length in second order only. OpenSim's are not exact, so the forces are not quite the length's derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import inf
from typing import NamedTuple

import numpy as np

from solver.compiled import compiled, compiled_for_python, compiled_with_private_functions
from solver.model import NO_COORDINATE, ConditionalPathPoint, MovingPathPoint, Path, PathPoint
from solver.multibody.body_tables import Functions, pack_functions
from solver.multibody.joints import derivatives
from solver.multibody.postures import Postures
from solver.vectors import (
    ORIGIN,
    SMALLEST_LENGTH,
    Array,
    Vector,
    add,
    cross,
    distance,
    dot,
    norm,
    read,
    scale,
    subtract,
    turn,
    turn_back,
    write,
)
from solver.wrapping.ellipsoid import wrap_ellipsoid
from solver.wrapping.fan import Fan, allocate_fan
from solver.wrapping.path_tables import (
    CHANGE,
    CONVERGED,
    ELLIPSOID,
    FIXED,
    NO_SURFACE,
    NODE,
    NOT_CONVERGED,
    SPHERE,
    TORUS,
    Codes,
    Indices,
    PathResults,
    PathTables,
    Record,
    Records,
)
from solver.wrapping.segment import INSIDE_RADIUS, MANDATORY_WRAP, NO_WRAP, WRAPPED, WrapResult
from solver.wrapping.sphere_and_cylinder import wrap_cylinder, wrap_sphere, wrap_torus

MOST_SWEEPS = 8
CONVERGED_LENGTH = 0.0005  # m


@compiled
def wrap_path(
    tables: PathTables, path: int, bodies: Records, changes: Records, work: WrapWorkspace
) -> tuple[int, float]:
    """Wrap one path in one posture (POSE, CHANGE).

    Afterwards the first `count` entries of work.sequence are the nodes in order along it, and work.code its outcome;
    returns count and the length [m].
    """
    points = tables.points[tables.first_point[path] : tables.first_point[path + 1]]
    wraps = tables.wraps[tables.first_wrap[path] : tables.first_wrap[path + 1]]
    nodes, sequence = work.nodes, work.sequence
    work.code[0] = CONVERGED
    count = place_path_points(points, wraps, changes, nodes, sequence)
    length = inf
    is_swapped, changes_so_far = False, 0
    for sweep in range(MOST_SWEEPS if len(wraps) > 1 else 1):
        first_action, second_action = NO_WRAP, NO_WRAP
        for position in range(len(wraps)):
            k = 1 - position if is_swapped and position < 2 else position
            if sweep > 0 and work.seen[k] == changes_so_far:  # the same segments as in the sweep before
                continue
            node, before = len(points) + 2 * k, count
            count, action, is_wrapped = _wrap_over_surface(wraps[k], node, len(wraps), bodies, work, count)
            if is_wrapped or count != before:
                changes_so_far += 1
            work.seen[k] = changes_so_far
            if position == 0:
                first_action = action
            elif position == 1:
                second_action = action
        previous, length = length, _length(bodies, nodes, sequence, count)
        if abs(length - previous) < CONVERGED_LENGTH:
            break
        if sweep == 0 and len(wraps) > 1 and first_action == NO_WRAP and second_action == INSIDE_RADIUS:
            is_swapped = True
            changes_so_far += 1
            count = _remove_tangent_points(len(points), sequence, count)
    else:
        if len(wraps) > 1:
            work.code[0] = NOT_CONVERGED
    return count, length


@compiled
def place_in_ground(bodies: Records, nodes: Records, k: int) -> Vector:
    """Location of a node in ground at its first use in this posture."""
    node = nodes[k]
    if not node["is_placed"]:
        write(node["ground"], to_ground(bodies, node["body"], read(node["location"])))
        node["is_placed"] = 1
    return read(node["ground"])


@compiled
def to_ground(bodies: Records, body: int, point: Vector) -> Vector:
    return add(turn(bodies[body]["rotation"], point), read(bodies[body]["origin"]))


@compiled
def place_path_points(points: Records, wraps: Records, changes: Records, nodes: Records, sequence: Indices) -> int:
    count = 0
    for k in range(len(points)):
        point, node = points[k], nodes[k]
        node["body"] = point["body"]
        node["surface"] = NO_SURFACE
        node["is_placed"] = 0
        if point["changes"] == FIXED:
            write(node["location"], read(point["location"]))
            node["coordinate"] = NO_COORDINATE
        else:
            change = changes[point["changes"]]
            write(node["location"], read(change["location"]))
            write(node["slope"], read(change["slope"]))
            node["coordinate"] = change["coordinate"]
            if not change["is_there"]:
                continue
        sequence[count] = k
        count += 1
    for k in range(2 * len(wraps)):
        wrap, node = wraps[k // 2], nodes[len(points) + k]
        node["body"] = wrap["body"]
        node["surface"] = wrap["surface"]
        node["is_placed"] = 0
        node["coordinate"] = NO_COORDINATE
    return count


@compiled
def _wrap_over_surface(
    wrap: Record, node: int, surfaces: int, bodies: Records, work: WrapWorkspace, count: int
) -> tuple[int, int, bool]:
    """Wrap the path over one surface again, if the wrap is mandatory or the length increase is the least.

    Returns the number of nodes of the path, the last wrap action of the surface, and whether the path runs over it.
    """
    nodes, sequence = work.nodes, work.sequence
    count = _remove_tangent_points(node, sequence, count)
    last_action = NO_WRAP
    behind, r1, r2, on_surface, least_detour = -1, ORIGIN, ORIGIN, 0.0, inf
    for k in range(*_range_on_path(wrap, nodes, sequence, count)):
        start, end = sequence[k], sequence[k + 1]
        if _is_over_surface(nodes, start, end):
            continue
        action, s1, s2, length = _wrap_segment(wrap, surfaces, bodies, nodes[start], nodes[end], work)
        last_action = action
        if action == MANDATORY_WRAP:
            behind, r1, r2, on_surface = k, s1, s2, length
            break
        if action == WRAPPED:
            # Computing the detour caches the places of both ends for this posture, as in OpenSim.
            a, b = place_in_ground(bodies, nodes, start), place_in_ground(bodies, nodes, end)
            t1, t2 = to_ground(bodies, wrap["body"], s1), to_ground(bodies, wrap["body"], s2)
            detour = distance(a, t1) + length + distance(b, t2) - distance(a, b)
            if detour < least_detour:
                behind, r1, r2, on_surface, least_detour = k, s1, s2, length, detour
    if behind >= 0:
        write(nodes[node]["location"], r1)
        write(nodes[node + 1]["location"], r2)
        nodes[node + 1]["on_surface"] = on_surface
        count = _insert_tangent_points(node, sequence, count, behind)
    return count, last_action, behind >= 0


@compiled
def _range_on_path(wrap: Record, nodes: Records, sequence: Indices, count: int) -> tuple[int, int]:
    """Positions in the sequence of the first and the last path point between which the path may wrap."""
    first, last = count - 1, 0
    for k in range(count):
        is_point = nodes[sequence[k]]["surface"] == NO_SURFACE
        if is_point and sequence[k] >= wrap["first"]:
            first = min(first, k)
        if is_point and sequence[k] <= wrap["last"]:
            last = k
    return first, last


@compiled
def _wrap_segment(
    wrap: Record, surfaces: int, bodies: Records, start: Record, end: Record, work: WrapWorkspace
) -> WrapResult:
    """Wrap the segment between two nodes over a surface; the tangent points are in the surface's body."""
    p1, p2 = _to_surface(wrap, bodies, start), _to_surface(wrap, bodies, end)
    size, axis, allowed = read(wrap["dimensions"]), wrap["axis"], wrap["allowed"]
    if wrap["kind"] == ELLIPSOID:
        action, r1, r2, length = wrap_ellipsoid(p1, p2, size, wrap["method"], axis, allowed, work.fan, work.code)
    elif wrap["kind"] == SPHERE:
        action, r1, r2, length = wrap_sphere(p1, p2, size[0], axis, allowed)
    elif wrap["kind"] == TORUS:
        action, r1, r2, length = wrap_torus(p1, p2, size[0], size[1], axis, allowed, surfaces, work.code)
    else:
        action, r1, r2, length = wrap_cylinder(p1, p2, size[0], size[2], axis, allowed, surfaces, work.code)
    if action <= NO_WRAP:
        return action, ORIGIN, ORIGIN, 0.0
    rotation, translation = wrap["rotation"], read(wrap["translation"])
    return action, add(turn(rotation, r1), translation), add(turn(rotation, r2), translation), length


@compiled
def _to_surface(wrap: Record, bodies: Records, node: Record) -> Vector:
    """The latest place of a node, in the frame of a surface."""
    point = read(node["location"])
    if node["body"] != wrap["body"]:
        base = bodies[wrap["body"]]
        point = turn_back(base["rotation"], subtract(to_ground(bodies, node["body"], point), read(base["origin"])))
    return turn_back(wrap["rotation"], subtract(point, read(wrap["translation"])))


@compiled
def _is_over_surface(nodes: Records, start: int, end: int) -> bool:
    """Whether the path runs over a surface, not straight, between two neighbouring nodes."""
    return bool(nodes[start]["surface"] != NO_SURFACE and nodes[start]["surface"] == nodes[end]["surface"])


@compiled
def _insert_tangent_points(node: int, sequence: Indices, count: int, behind: int) -> int:
    for k in range(count - 1, behind, -1):
        sequence[k + 2] = sequence[k]
    sequence[behind + 1], sequence[behind + 2] = node, node + 1
    return count + 2


@compiled
def _remove_tangent_points(node: int, sequence: Indices, count: int) -> int:
    for k in range(count):
        if sequence[k] == node:
            for later in range(k + 2, count):
                sequence[later - 2] = sequence[later]
            return count - 2
    return count


@compiled
def _length(bodies: Records, nodes: Records, sequence: Indices, count: int) -> float:
    length = 0.0
    for k in range(count - 1):
        start, end = sequence[k], sequence[k + 1]
        a, b = place_in_ground(bodies, nodes, start), place_in_ground(bodies, nodes, end)
        length += nodes[end]["on_surface"] if _is_over_surface(nodes, start, end) else distance(a, b)
    return length


class PathNodes(NamedTuple):
    """Nodes of all paths: places (frames, paths, nodes, 3) [m] in ground, their surfaces (NO_SURFACE at a path point),
    and how many nodes each path has (frames, paths); the rest is unused.
    """

    places: Array
    surfaces: Indices
    counts: Indices


def allocate_nodes(frames: int, paths: int, work: WrapWorkspace) -> PathNodes:
    shape = (frames, paths, len(work.nodes))
    return PathNodes(np.zeros((*shape, 3)), np.zeros(shape, np.int64), np.zeros(shape[:2], np.int64))


@compiled_for_python
def place_path_nodes(
    tables: PathTables, poses: Records, changes: Records, work: WrapWorkspace, results: PathNodes
) -> None:
    """Wrap every path in every frame: poses (frames, bodies) of POSE, changes (frames, points) of CHANGE."""
    for frame in range(len(poses)):
        for path in range(results.counts.shape[1]):
            count, _ = wrap_path(tables, path, poses[frame], changes[frame], work)
            results.counts[frame, path] = count
            for k in range(count):
                node = work.sequence[k]
                write(results.places[frame, path, k], place_in_ground(poses[frame], work.nodes, node))
                results.surfaces[frame, path, k] = work.nodes[node]["surface"]


class WrapWorkspace(NamedTuple):
    """Working memory of one path at a time.

    nodes     (NODE) its path points and tangent points
    sequence  of the nodes along the path
    seen      (wraps,) how often the path had changed when it was last wrapped over a surface
    fan       of an ellipsoid
    wrench    (bodies, 6) on each body, zero between paths
    code      (1,) the path's outcome
    """

    nodes: Records
    sequence: Indices
    seen: Indices
    fan: Fan
    wrench: Array
    code: Codes


def allocate_wrap(tables: PathTables) -> WrapWorkspace:
    wraps = np.diff(tables.first_wrap)
    longest = int((np.diff(tables.first_point) + 2 * wraps).max(initial=0))
    seen = np.zeros(int(wraps.max(initial=0)), np.int64)
    return WrapWorkspace(
        np.zeros(longest, NODE),
        np.zeros(longest, np.int64),
        seen,
        allocate_fan(),
        allocate_wrench(tables),
        np.zeros(1, np.int8),
    )


def allocate_wrench(tables: PathTables) -> Array:
    return np.zeros((int(tables.bodies.max(initial=-1)) + 1, 6))


BETWEEN_BODIES, ALSO_WITHIN_BODIES = 0, 1
"""Within a body the forces cancel, except on a coordinate that moves one of the points. OpenSim leaves that out."""
RANGE_TOLERANCE = 1e-5  # OpenSim keeps a conditional point this far beyond its range
NO_FUNCTION = -1

# As in model.MovingPathPoint and ConditionalPathPoint; the latter stays at its translation and has no function.
MOVER = np.dtype(
    [
        ("rotation", np.float64, (3, 3)),
        ("translation", np.float64, (3,)),
        ("coordinate", np.int64),
        ("lowest", np.float64),
        ("highest", np.float64),
        ("first_function", np.int64),
    ]
)


@compiled_with_private_functions
def evaluate_wrapped_paths(
    tables: PathTables, poses: Records, changes: Records, rates: Array, work: WrapWorkspace, results: PathResults
) -> None:
    """Evaluate every path in every frame.

    poses (frames, bodies) of POSE, changes (frames, points) of CHANGE, rates (frames, coordinates)
    """
    path_nodes = work.nodes, work.sequence, work.wrench
    for frame in range(len(poses)):
        bodies, wrenches = poses[frame], results.wrenches[frame]
        for path in range(results.lengths.shape[1]):
            count, results.lengths[frame, path] = wrap_path(tables, path, bodies, changes[frame], work)
            results.codes[frame, path] = work.code[0]
            mobility = results.mobilities[frame, path]
            results.speeds[frame, path] = pull(bodies, rates[frame], path_nodes, count, mobility, BETWEEN_BODIES)
            move_wrenches(tables, path, work.wrench, wrenches)


@compiled
def move_wrenches(tables: PathTables, path: int, wrench: Array, wrenches: Array) -> None:
    """Move the wrenches (bodies, 6) of a path to those of all paths on the bodies that they touch."""
    for k in range(tables.first_body[path], tables.first_body[path + 1]):
        own = wrench[tables.bodies[k]]
        for i in range(6):
            wrenches[k, i] = own[i]
            own[i] = 0.0


@compiled
def pull(
    bodies: Records, rates: Array, path: tuple[Records, Indices, Array], count: int, mobility: Array, segments: int
) -> float:
    """Add the forces of a tension of 1 N along the straight segments; returns the lengthening speed [m/s].

    path      nodes, their sequence, and wrench (bodies, 6), to which the forces are added, as to mobility
    segments  BETWEEN_BODIES or ALSO_WITHIN_BODIES: whose forces are added
    """
    (nodes, sequence, wrench), speed = path, 0.0
    if count == 0:
        return speed
    start, place = nodes[sequence[0]], place_in_ground(bodies, nodes, sequence[0])
    point, velocity = _point_and_velocity(bodies, rates, start)
    for k in range(1, count):
        end, next_place = nodes[sequence[k]], place_in_ground(bodies, nodes, sequence[k])
        next_point, next_velocity = _point_and_velocity(bodies, rates, end)
        apart, parting = subtract(next_place, place), subtract(next_velocity, velocity)
        length = norm(apart)
        speed += dot(parting, apart) / length if length >= SMALLEST_LENGTH else norm(parting)
        is_moved = segments == ALSO_WITHIN_BODIES and (start["coordinate"] >= 0 or end["coordinate"] >= 0)
        if (start["body"] != end["body"] or is_moved) and not length < SMALLEST_LENGTH:
            force = scale(1.0 / length, apart)
            _apply_force(bodies, start, point, force, wrench, mobility)
            _apply_force(bodies, end, next_point, scale(-1.0, force), wrench, mobility)
        start, place, point, velocity = end, next_place, next_point, next_velocity
    return speed


@compiled
def _point_and_velocity(bodies: Records, rates: Array, node: Record) -> tuple[Vector, Vector]:
    """Latest place and velocity of a node in ground, which a coordinate may move in its body."""
    body = bodies[node["body"]]
    arm = turn(body["rotation"], read(node["location"]))
    velocity = add(read(body["origin_velocity"]), cross(read(body["angular_velocity"]), arm))
    if node["coordinate"] >= 0:
        slide = turn(body["rotation"], read(node["slope"]))
        velocity = add(velocity, scale(rates[node["coordinate"]], slide))
    return add(arm, read(body["origin"])), velocity


@compiled
def _apply_force(bodies: Records, node: Record, point: Vector, force: Vector, wrench: Array, mobility: Array) -> None:
    """Add a force at a node to the wrenches (bodies, 6), and to the force on a coordinate that moves the node."""
    body, moment = node["body"], cross(point, force)
    for i in range(3):
        wrench[body, i] += moment[i]
        wrench[body, 3 + i] += force[i]
    if node["coordinate"] >= 0:
        slide = turn(bodies[body]["rotation"], read(node["slope"]))
        mobility[node["coordinate"]] += dot(slide, force)


class MovingPoints(NamedTuple):
    """The points (MOVER) and their functions.

    stops_at_ends  whether a point that is held at an end of its range does not move either; OpenSim's does
    """

    points: Records
    functions: Functions
    stops_at_ends: bool


def pack_moving_points(paths: Sequence[Path], postures: Postures, *, stops_at_ends: bool = False) -> Records:
    """(frames, points) of CHANGE, for the points of the paths that are not fixed; stops_at_ends as in MovingPoints."""
    movers = MovingPoints(*_movers(tuple(paths)), stops_at_ends)
    changes = np.zeros((len(postures.coordinates), len(movers.points)), CHANGE)
    place_points(movers, postures.coordinates, changes)
    return changes


def has_moving_points(paths: tuple[Path, ...]) -> bool:
    """Whether a coordinate moves any point of the paths in its body; a conditional point stays."""
    return len(_movers(paths)[1].functions) > 1  # the last row only ends them


@compiled_for_python
def place_points(movers: MovingPoints, coordinates: Array, changes: Records) -> None:
    """Fill changes (frames, points) at coordinates (frames, coordinates)."""
    points, functions, stops_at_ends = movers
    for frame in range(len(changes)):
        for k in range(len(points)):
            mover, change = points[k], changes[frame, k]
            rotation, translation = mover["rotation"], read(mover["translation"])
            q, first = coordinates[frame, mover["coordinate"]], mover["first_function"]
            if first == NO_FUNCTION:
                write(change["location"], translation)
                change["coordinate"] = NO_COORDINATE
                change["is_there"] = mover["lowest"] - RANGE_TOLERANCE <= q <= mover["highest"] + RANGE_TOLERANCE
                continue
            held = min(max(q, mover["lowest"]), mover["highest"])
            for i in range(3):
                change["location"][i], _, _ = derivatives(functions, first + i, held)
                _, change["slope"][i], _ = derivatives(functions, first + i, q)
            write(change["location"], add(translation, turn(rotation, read(change["location"]))))
            write(change["slope"], turn(rotation, read(change["slope"])))
            if stops_at_ends and held != q:
                write(change["slope"], ORIGIN)
            change["coordinate"], change["is_there"] = mover["coordinate"], 1


@lru_cache(maxsize=32)
def _movers(paths: tuple[Path, ...]) -> tuple[Records, Functions]:
    changing = [point for path in paths for point in path.points if not isinstance(point, PathPoint)]
    moving = [function for point in changing if isinstance(point, MovingPathPoint) for function in point.functions]
    movers, first = np.zeros(len(changing), MOVER), 0
    for row, point in zip(movers, changing, strict=True):
        row["coordinate"], (row["lowest"], row["highest"]) = point.coordinate, point.range
        if isinstance(point, ConditionalPathPoint):
            row["translation"], row["first_function"] = point.location, NO_FUNCTION
        else:
            row["rotation"], row["translation"] = point.placement.rotation, point.placement.translation
            row["first_function"] = first
            first += len(point.functions)
    return movers, pack_functions(moving)
