"""Lengths, lengthening speeds and forces of shortest paths over geodesics; compiled, for all paths.

Tangents are exact, so the tangent points can be taken as fixed in their bodies: sliding changes the length in second
order only, and the forces are the derivative of the length.
"""

from __future__ import annotations

from solver.compiled import compiled, compiled_with_private_functions
from solver.geodesics.contact_order import find_contacts
from solver.geodesics.shortest_path import GeodesicWorkspace
from solver.model import NO_COORDINATE
from solver.vectors import Array, read, subtract, turn_back, write
from solver.wrapping.opensim_path import place_in_ground, place_path_points, to_ground
from solver.wrapping.path_tables import CONVERGED, PathResults, PathTables, Record, Records
from solver.wrapping.wrapped_paths import ALSO_WITHIN_BODIES, move_wrenches, pull


@compiled_with_private_functions
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
        mobility = results.mobilities[frame, path]
        speed = pull(bodies, rates, work.nodes, work.sequence, count, work.wrench, mobility, ALSO_WITHIN_BODIES)
        results.speeds[frame, path] = speed
        move_wrenches(tables, path, work.wrench, results.wrenches[frame])


@compiled
def _wrap_path(
    points: Records, wraps: Records, bodies: Records, changes: Records, work: GeodesicWorkspace
) -> tuple[int, float]:
    """Wrap one path (POINT, WRAP) in one posture (POSE, CHANGE), each segment between two of its points by itself;
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
            _set_node(nodes[node], wrap, contact["first"], bodies)
            _set_node(nodes[node + 1], wrap, contact["last"], bodies)
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
def _set_node(node: Record, wrap: Record, end: Record, bodies: Records) -> None:
    """A tangent point: an end (END) of a contact."""
    node["body"], node["surface"], node["coordinate"] = wrap["body"], wrap["surface"], NO_COORDINATE
    body, place = bodies[wrap["body"]], read(end["place"])
    write(node["location"], turn_back(body["rotation"], subtract(place, read(body["origin"]))))
    write(node["ground"], place)
    node["is_placed"] = 1
