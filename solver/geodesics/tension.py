"""How long paths pulled taut are, how fast they lengthen and how they pull; compiled, for all paths.

Tangents are exact, and so the tangent points may count as fixed in their bodies: what they slide changes the length in
second order only, and the forces are the derivative of the length.
"""

from __future__ import annotations

from solver.compiled import compiled, compiled_for_python
from solver.geodesics.lay import lay_between
from solver.geodesics.room import Room
from solver.model import NO_COORDINATE
from solver.vectors import Array, read, scale, subtract, turn_back, unit, write
from solver.wrapping.course import NO_SURFACE, Courses, Indices, Laid, Record, Records
from solver.wrapping.sweep import lay_points, place_in_ground, points_and_wraps, to_ground
from solver.wrapping.tension import path_speed, pull_on


@compiled_for_python
def lay_all(courses: Courses, poses: Records, changes: Records, rates: Array, room: Room, laid: Laid) -> None:
    """As wrapping.tension.lay_all, with geodesics."""
    for frame in range(len(poses)):
        bodies, u = poses[frame], rates[frame]
        for path in range(laid.lengths.shape[1]):
            points, wraps = points_and_wraps(courses, path)
            count, laid.lengths[frame, path] = _lay_path(points, wraps, bodies, changes[frame], room)
            laid.speeds[frame, path] = path_speed(bodies, u, room.nodes, room.sequence, count)
            _pull(bodies, room.nodes, room.sequence, count, laid.wrenches[frame, path], laid.mobilities[frame, path])


@compiled
def _lay_path(points: Records, wraps: Records, bodies: Records, changes: Records, room: Room) -> tuple[int, float]:
    """Lay one path (POINT, WRAP) in one posture (BODY, CHANGE), each piece between two of its points for itself; as
    wrapping.sweep.lay_path.
    """
    nodes, sequence, stops = room.nodes, room.sequence, room.stops
    present = lay_points(points, wraps, changes, nodes, stops)
    for k in range(len(wraps)):
        _place_surface(wraps[k], bodies, room.contacts[k])
    sequence[0] = stops[0]
    length, count, node = 0.0, 1, len(points)
    for stop in range(1, present):
        first, last = stops[stop - 1], stops[stop]
        start, end = place_in_ground(bodies, nodes, first), place_in_ground(bodies, nodes, last)
        touched, piece = lay_between(start, end, first, last, wraps, room)
        length += piece
        for k in range(touched):
            wrap, contact = wraps[room.order[k]], room.contacts[room.order[k]]
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
def _pull(bodies: Records, nodes: Records, sequence: Indices, count: int, wrench: Array, mobility: Array) -> None:
    """Add what a tension of 1 does along the straight pieces, also to points that move within one body."""
    for k in range(count - 1):
        start, end = sequence[k], sequence[k + 1]
        if nodes[start]["surface"] != NO_SURFACE and nodes[start]["surface"] == nodes[end]["surface"]:
            continue
        force = unit(subtract(place_in_ground(bodies, nodes, end), place_in_ground(bodies, nodes, start)))
        pull_on(bodies, nodes, start, force, wrench, mobility)
        pull_on(bodies, nodes, end, scale(-1.0, force), wrench, mobility)
