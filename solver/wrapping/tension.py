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
from solver.wrapping.opensim_path import place_in_ground, to_ground, wrap_path
from solver.wrapping.path_tables import CONVERGED, Indices, PathResults, PathTables, Records
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
def path_speed(bodies: Records, rates: Array, nodes: Records, sequence: Indices, count: int) -> float:
    """Lengthening speed [m/s] of the path through the first `count` nodes of the sequence, at speeds u."""
    speed = 0.0
    if count == 0:
        return speed
    first = sequence[0]
    place, velocity = place_in_ground(bodies, nodes, first), _velocity(bodies, rates, nodes, first)
    for k in range(1, count):
        node = sequence[k]
        next_place, next_velocity = place_in_ground(bodies, nodes, node), _velocity(bodies, rates, nodes, node)
        apart, parting = subtract(next_place, place), subtract(next_velocity, velocity)
        length = norm(apart)
        speed += dot(parting, apart) / length if length >= SMALLEST_LENGTH else norm(parting)
        place, velocity = next_place, next_velocity
    return speed


@compiled
def apply_tension(bodies: Records, nodes: Records, k: int, force: Vector, wrench: Array, mobility: Array) -> None:
    """Add a force at a node to the wrenches (bodies, 6), and to the force on a coordinate that moves the node."""
    body = nodes[k]["body"]
    moment = cross(to_ground(bodies, body, read(nodes[k]["location"])), force)
    for i in range(3):
        wrench[body, i] += moment[i]
        wrench[body, 3 + i] += force[i]
    if nodes[k]["coordinate"] >= 0:
        slide = turn(bodies[body]["rotation"], read(nodes[k]["slope"]))
        mobility[nodes[k]["coordinate"]] += dot(slide, force)


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
        results.speeds[frame, path] = path_speed(bodies, u, work.nodes, work.sequence, count)
        _apply_tensions(
            bodies, work.nodes, work.sequence, count, results.wrenches[frame, path], results.mobilities[frame, path]
        )


@compiled
def _velocity(bodies: Records, rates: Array, nodes: Records, k: int) -> Vector:
    """Velocity of a node in ground, which a coordinate may move in its body."""
    body = bodies[nodes[k]["body"]]
    arm = turn(body["rotation"], read(nodes[k]["location"]))
    velocity = add(read(body["origin_velocity"]), cross(read(body["angular_velocity"]), arm))
    if nodes[k]["coordinate"] >= 0:
        slide = turn(body["rotation"], read(nodes[k]["slope"]))
        velocity = add(velocity, scale(rates[nodes[k]["coordinate"]], slide))
    return velocity


@compiled
def _apply_tensions(
    bodies: Records, nodes: Records, sequence: Indices, count: int, wrench: Array, mobility: Array
) -> None:
    """Add the forces of a tension of 1 N: only between different bodies, along the straight segments."""
    for k in range(count - 1):
        start, end = sequence[k], sequence[k + 1]
        if nodes[start]["body"] == nodes[end]["body"]:
            continue
        apart = subtract(place_in_ground(bodies, nodes, end), place_in_ground(bodies, nodes, start))
        force = scale(1.0 / norm(apart), apart)
        apply_tension(bodies, nodes, start, force, wrench, mobility)
        apply_tension(bodies, nodes, end, scale(-1.0, force), wrench, mobility)
