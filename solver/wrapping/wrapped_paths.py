"""Lengthening speed and forces of a muscle path, as in OpenSim 4.6 (GeometryPath); compiled, for all paths.

Tangent points are taken as fixed in their bodies: for exact tangents their sliding changes the length in second order
only. OpenSim's tangents are not exact, so the forces are not quite the derivative of the length.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
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
    dot,
    norm,
    read,
    scale,
    subtract,
    turn,
    write,
)
from solver.wrapping.opensim_path import WrapWorkspace, place_in_ground, wrap_path
from solver.wrapping.path_tables import CHANGE, CONVERGED, Indices, PathResults, PathTables, Record, Records

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
    _, functions = _movers(paths)
    return len(functions.functions) > 1  # the last row only ends them


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
