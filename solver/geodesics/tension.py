"""Lengths, lengthening speeds and forces of shortest paths over geodesics; compiled, for all paths.

Tangents are exact, so the tangent points can be taken as fixed in their bodies: sliding changes the length in second
order only, and the forces are the derivative of the length.
"""

from __future__ import annotations

from solver.compiled import compiled, compiled_for_python
from solver.geodesics.contact_order import find_contacts
from solver.geodesics.workspace import GeodesicWorkspace
from solver.model import NO_COORDINATE
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
    write,
)
from solver.wrapping.opensim_path import place_in_ground, place_path_points, to_ground
from solver.wrapping.path_tables import CONVERGED, Indices, PathResults, PathTables, Record, Records


@compiled_for_python
def evaluate_geodesic_paths(
    tables: PathTables, poses: Records, changes: Records, rates: Array, work: GeodesicWorkspace, results: PathResults
) -> None:
    """As wrapping.tension.evaluate_wrapped_paths, with geodesics."""
    for frame in range(len(poses)):
        _evaluate_frame(tables, poses[frame], changes[frame], rates[frame], work, results, frame)


@compiled
def _evaluate_frame(
    tables: PathTables,
    bodies: Records,
    changes: Records,
    rates: Array,
    work: GeodesicWorkspace,
    results: PathResults,
    frame: int,
) -> None:
    for path in range(results.lengths.shape[1]):
        points = tables.points[tables.first_point[path] : tables.first_point[path + 1]]
        wraps = tables.wraps[tables.first_wrap[path] : tables.first_wrap[path + 1]]
        work.code[0] = CONVERGED
        count, results.lengths[frame, path] = _wrap_path(points, wraps, bodies, changes, work)
        results.codes[frame, path] = work.code[0]
        results.speeds[frame, path] = _pull(
            bodies,
            rates,
            work.nodes,
            work.sequence,
            count,
            results.wrenches[frame, path],
            results.mobilities[frame, path],
        )


@compiled
def _wrap_path(
    points: Records, wraps: Records, bodies: Records, changes: Records, work: GeodesicWorkspace
) -> tuple[int, float]:
    """Wrap one path (POINT, WRAP) in one posture (BODY, CHANGE), each segment between two of its points by itself;
    returns as wrapping.opensim_path.wrap_path.
    """
    nodes, sequence, stops = work.nodes, work.sequence, work.stops
    present = place_path_points(points, wraps, changes, nodes, stops)
    for k in range(len(wraps)):
        _place_surface(wraps[k], bodies, work.contacts[k])
    sequence[0] = stops[0]
    length, count, node = 0.0, 1, len(points)
    for stop in range(1, present):
        first, last = stops[stop - 1], stops[stop]
        start, end = place_in_ground(bodies, nodes, first), place_in_ground(bodies, nodes, last)
        contacts, segment = find_contacts(start, end, first, last, wraps, work)
        length += segment
        for k in range(contacts):
            wrap, contact = wraps[work.order[k]], work.contacts[work.order[k]]
            _set_node(nodes[node], wrap, contact["first"])
            _set_node(nodes[node + 1], wrap, contact["last"])
            sequence[count], sequence[count + 1] = node, node + 1
            count, node = count + 2, node + 2
        sequence[count] = last
        count += 1
    return count if present > 0 else 0, length


@compiled
def _place_surface(wrap: Record, bodies: Records, contact: Record) -> None:
    body, rotation = bodies[wrap["body"]]["rotation"], wrap["rotation"]
    for i in range(3):
        for j in range(3):
            contact["rotation"][i, j] = (
                body[i, 0] * rotation[0, j] + body[i, 1] * rotation[1, j] + body[i, 2] * rotation[2, j]
            )
    write(contact["origin"], to_ground(bodies, wrap["body"], read(wrap["translation"])))
    write(contact["size"], read(wrap["dimensions"]))
    contact["kind"] = wrap["kind"]


@compiled
def _set_node(node: Record, wrap: Record, end: Record) -> None:
    """A tangent point: an end (END) of a contact."""
    node["body"], node["surface"], node["coordinate"] = wrap["body"], wrap["surface"], NO_COORDINATE
    write(node["ground"], read(end["place"]))


@compiled
def _pull(
    bodies: Records, rates: Array, nodes: Records, sequence: Indices, count: int, wrench: Array, mobility: Array
) -> float:
    """Add the forces of a tension of 1 N along the straight segments; returns the lengthening speed [m/s].

    Between two points of one body the forces cancel, except on a coordinate that moves one of them.
    """
    speed = 0.0
    for k in range(count - 1):
        start, end = nodes[sequence[k]], nodes[sequence[k + 1]]
        is_within_body = start["body"] == end["body"]
        if is_within_body and start["coordinate"] == end["coordinate"] == NO_COORDINATE:
            continue
        apart = subtract(read(end["ground"]), read(start["ground"]))
        length = norm(apart)
        parting = subtract(_velocity(bodies, rates, end), _velocity(bodies, rates, start))
        if not length >= SMALLEST_LENGTH:
            speed += norm(parting)
            continue
        force = scale(1.0 / length, apart)
        speed += dot(parting, force)
        if not is_within_body:
            _add_to_wrench(wrench[start["body"]], read(start["ground"]), force)
            _add_to_wrench(wrench[end["body"]], read(end["ground"]), scale(-1.0, force))
        _add_to_mobility(mobility, bodies, start, force)
        _add_to_mobility(mobility, bodies, end, scale(-1.0, force))
    return speed


@compiled
def _velocity(bodies: Records, rates: Array, node: Record) -> Vector:
    """Velocity of a node in ground, which a coordinate may move in its body."""
    body = bodies[node["body"]]
    arm = subtract(read(node["ground"]), read(body["origin"]))
    velocity = add(read(body["origin_velocity"]), cross(read(body["angular_velocity"]), arm))
    if node["coordinate"] != NO_COORDINATE:
        velocity = add(velocity, scale(rates[node["coordinate"]], turn(body["rotation"], read(node["slope"]))))
    return velocity


@compiled
def _add_to_wrench(wrench: Array, place: Vector, force: Vector) -> None:
    moment = cross(place, force)
    for i in range(3):
        wrench[i] += moment[i]
        wrench[3 + i] += force[i]


@compiled
def _add_to_mobility(mobility: Array, bodies: Records, node: Record, force: Vector) -> None:
    if node["coordinate"] != NO_COORDINATE:
        slide = turn(bodies[node["body"]]["rotation"], read(node["slope"]))
        mobility[node["coordinate"]] += dot(slide, force)
