"""Lengths, lengthening speeds and forces of shortest paths over geodesics; compiled, for all paths.

Tangents are exact, so the tangent points can be taken as fixed in their bodies: sliding changes the length in second
order only, and the forces are the derivative of the length.
"""

from __future__ import annotations

from solver.compiled import compiled, compiled_for_python
from solver.geodesics.contact_order import find_contacts
from solver.geodesics.workspace import GeodesicWorkspace
from solver.model import NO_COORDINATE
from solver.vectors import Array, read, scale, subtract, turn_back, unit, write
from solver.wrapping.opensim_path import place_in_ground, place_path_points, points_and_wraps, to_ground
from solver.wrapping.path_tables import CONVERGED, NO_SURFACE, Indices, PathResults, PathTables, Record, Records
from solver.wrapping.tension import apply_tension, path_speed


@compiled_for_python
def evaluate_geodesic_paths(
    tables: PathTables, poses: Records, changes: Records, rates: Array, work: GeodesicWorkspace, results: PathResults
) -> None:
    """As wrapping.tension.evaluate_wrapped_paths, with geodesics."""
    for frame in range(len(poses)):
        bodies, u = poses[frame], rates[frame]
        for path in range(results.lengths.shape[1]):
            points, wraps = points_and_wraps(tables, path)
            work.code[0] = CONVERGED
            count, results.lengths[frame, path] = _wrap_path(points, wraps, bodies, changes[frame], work)
            results.codes[frame, path] = work.code[0]
            results.speeds[frame, path] = path_speed(bodies, u, work.nodes, work.sequence, count)
            _apply_tensions(
                bodies, work.nodes, work.sequence, count, results.wrenches[frame, path], results.mobilities[frame, path]
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
            _set_node(nodes[node], wrap, bodies, contact["first"])
            _set_node(nodes[node + 1], wrap, bodies, contact["last"])
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
def _set_node(node: Record, wrap: Record, bodies: Records, end: Record) -> None:
    """A tangent point: an end (END) of a contact."""
    body, place = bodies[wrap["body"]], read(end["place"])
    node["body"], node["surface"], node["coordinate"] = wrap["body"], wrap["surface"], NO_COORDINATE
    write(node["location"], turn_back(body["rotation"], subtract(place, read(body["origin"]))))
    write(node["ground"], place)
    node["is_placed"] = 1


@compiled
def _apply_tensions(
    bodies: Records, nodes: Records, sequence: Indices, count: int, wrench: Array, mobility: Array
) -> None:
    """Add the forces of a tension of 1 N along the straight segments, also on points that move within one body."""
    for k in range(count - 1):
        start, end = sequence[k], sequence[k + 1]
        if nodes[start]["surface"] != NO_SURFACE and nodes[start]["surface"] == nodes[end]["surface"]:
            continue
        force = unit(subtract(place_in_ground(bodies, nodes, end), place_in_ground(bodies, nodes, start)))
        apply_tension(bodies, nodes, start, force, wrench, mobility)
        apply_tension(bodies, nodes, end, scale(-1.0, force), wrench, mobility)
