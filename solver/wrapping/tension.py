"""Lengthening speed and forces of a muscle path, as in OpenSim 4.6 (GeometryPath); compiled, for all paths.

Tangent points are taken as fixed in their bodies: for exact tangents their sliding changes the length in second order
only. OpenSim's tangents are not exact, so the forces are not quite the derivative of the length.
"""

from __future__ import annotations

from solver.compiled import compiled, compiled_with_private_functions
from solver.vectors import (
    SMALLEST_LENGTH,
    Array,
    Vector,
    add,
    cross,
    dot,
    norm,
    read,
    scale,
    subtract,
    turn,
)
from solver.wrapping.opensim_path import place_in_ground, wrap_path
from solver.wrapping.path_tables import CONVERGED, Indices, PathResults, PathTables, Record, Records
from solver.wrapping.workspace import WrapWorkspace

BETWEEN_BODIES, ALSO_WITHIN_BODIES = 0, 1
"""Within a body the forces cancel, except on a coordinate that moves one of the points. OpenSim leaves that out."""


@compiled_with_private_functions
def evaluate_wrapped_paths(
    tables: PathTables, poses: Records, changes: Records, rates: Array, work: WrapWorkspace, results: PathResults
) -> None:
    """Evaluate every path in every frame.

    poses (frames, bodies) of BODY, changes (frames, points) of CHANGE, rates (frames, coordinates)
    """
    for frame in range(len(poses)):
        _evaluate_frame(tables, poses[frame], changes[frame], rates[frame], work, results, frame)


@compiled
def _evaluate_frame(
    tables: PathTables,
    bodies: Records,
    changes: Records,
    u: Array,
    work: WrapWorkspace,
    results: PathResults,
    frame: int,
) -> None:
    for path in range(results.lengths.shape[1]):
        points = tables.points[tables.first_point[path] : tables.first_point[path + 1]]
        wraps = tables.wraps[tables.first_wrap[path] : tables.first_wrap[path + 1]]
        work.code[0] = CONVERGED
        count, results.lengths[frame, path] = wrap_path(points, wraps, bodies, changes, work)
        results.codes[frame, path] = work.code[0]
        speed = pull(
            bodies, u, work.nodes, work.sequence, count, work.wrench, results.mobilities[frame, path], BETWEEN_BODIES
        )
        results.speeds[frame, path] = speed
        move_wrenches(tables, path, work.wrench, results.wrenches[frame])


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
    bodies: Records,
    rates: Array,
    nodes: Records,
    sequence: Indices,
    count: int,
    wrench: Array,
    mobility: Array,
    segments: int,
) -> float:
    """Add the forces of a tension of 1 N along the straight segments; returns the lengthening speed [m/s].

    segments  BETWEEN_BODIES or ALSO_WITHIN_BODIES: whose forces are added
    """
    speed = 0.0
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
