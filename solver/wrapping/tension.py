"""Lengthening speed and forces of a muscle path, as in OpenSim 4.6 (GeometryPath); compiled, for all paths.

Tangent points are taken as fixed in their bodies: for exact tangents their sliding changes the length in second order
only. OpenSim's tangents are not exact, so the forces are not quite the derivative of the length.
"""

from __future__ import annotations

from solver.compiled import compiled, compiled_for_python
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


@compiled_for_python
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
        results.speeds[frame, path] = _pull(
            bodies, u, work.nodes, work.sequence, count, results.wrenches[frame, path], results.mobilities[frame, path]
        )


@compiled
def _pull(
    bodies: Records, rates: Array, nodes: Records, sequence: Indices, count: int, wrench: Array, mobility: Array
) -> float:
    """Add the forces of a tension of 1 N, which act between different bodies along the straight segments; returns the
    lengthening speed [m/s] at speeds u.
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
        if start["body"] != end["body"]:
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
