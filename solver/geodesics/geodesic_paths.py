"""Lengths, lengthening speeds and forces of shortest paths over geodesics; compiled, for all paths.

Tangents are exact, so the tangent points can be taken as fixed in their bodies: sliding changes the length in second
order only, and the forces are the derivative of the length.

Contacts of a path are the surfaces that it touches, in their order. The first contact of a straight segment with a
surface is exact on spheres and cylinders, a guess on ellipsoids. Its points are in the surface's own frame [m].
"""

from __future__ import annotations

from math import atan2, cos, inf, isnan, nan, pi, sin, sqrt

from solver.compiled import compiled, compiled_with_private_functions
from solver.geodesics.geodesic import set_geodesic, to_surface_frame
from solver.geodesics.shortest_path import GUESS, GeodesicWorkspace, contact_in_plane, shorten_path, shortest_planes
from solver.model import NO_COORDINATE
from solver.vectors import (
    ORIGIN,
    Array,
    Vector,
    add,
    any_across,
    cross,
    distance,
    dot,
    norm,
    read,
    scale,
    subtract,
    turn_back,
    unit,
    write,
)
from solver.wrapping.path_tables import (
    CONVERGED,
    ELLIPSOID,
    NOT_CONVERGED,
    SPHERE,
    Indices,
    PathResults,
    PathTables,
    Record,
    Records,
)
from solver.wrapping.segment import pierces, side
from solver.wrapping.wrapped_paths import (
    ALSO_WITHIN_BODIES,
    move_wrenches,
    place_in_ground,
    place_path_points,
    pull,
    to_ground,
)


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
        along = work.nodes, work.sequence, work.wrench
        results.speeds[frame, path] = pull(bodies, rates, along, count, mobility, ALSO_WITHIN_BODIES)
        move_wrenches(tables, path, work.wrench, results.wrenches[frame])


@compiled
def _wrap_path(
    points: Records, wraps: Records, bodies: Records, changes: Records, work: GeodesicWorkspace
) -> tuple[int, float]:
    """Wrap one path (POINT, WRAP) in one posture (POSE, CHANGE), each segment between two of its points by itself;
    returns as wrapping.wrapped_paths.wrap_path.
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


MOST_ROUNDS = 16
NO_PATH = -1
GAP = 1e-9  # m
FirstContact = tuple[bool, Vector, Vector, float, float]
"""Whether there is contact, then the geodesic: its middle, its direction there, its length; and on an ellipsoid
the plane (shortest_path.py) of another geodesic that may be as short, or NaN."""

NO_CONTACT = (False, ORIGIN, ORIGIN, 0.0, nan)


@compiled
def find_contacts(
    start: Vector, end: Vector, first: int, last: int, wraps: Records, work: GeodesicWorkspace
) -> tuple[int, float]:
    """Wrap the segment between two path points in ground, numbers `first` and `last` of the path, over the surfaces
    (WRAP) that obstruct it. Kind, size and pose of the surfaces are set in work.contacts.

    Returns the number of contacts, whose order along the path is in work.order, and the length [m].
    """
    contacts, count = work.contacts, 0
    for k in range(len(wraps)):
        contacts[k]["is_left_out"] = first < wraps[k]["first"] or last > wraps[k]["last"]
    for _ in range(MOST_ROUNDS):
        before = count
        for k in range(len(wraps)):
            if not contacts[k]["is_left_out"]:
                count = _wrap_over(start, end, k, wraps[k], count, work)
            if count == NO_PATH:
                contacts[k]["is_left_out"] = 1
                count, before = 0, NO_PATH
                break
        if count == before or len(wraps) == 1:
            break
    else:
        work.code[0] = NOT_CONVERGED
    return count, _length(start, end, count, work)


@compiled
def _wrap_over(start: Vector, end: Vector, k: int, wrap: Record, count: int, work: GeodesicWorkspace) -> int:
    """Wrap the path over one more surface, if that obstructs one of its straight segments.

    Returns the number of contacts, or NO_PATH.
    """
    contacts, order = work.contacts, work.order
    for j in range(count):
        if order[j] == k:
            return count
    contact = contacts[k]
    size = read(contact["size"])
    for gap in range(count + 1):
        before, behind = start, end
        if gap > 0:
            before = read(contacts[order[gap - 1]]["last"]["place"])
        if gap < count:
            behind = read(contacts[order[gap]]["first"]["place"])
        touches, place, heading, length, another = find_first_contact(
            wrap["kind"],
            size,
            wrap["axis"],
            wrap["allowed"],
            to_surface_frame(contact, before),
            to_surface_frame(contact, behind),
            work.detours,
        )
        if not touches:
            continue
        _insert(order, count, gap, k)
        set_geodesic(contact, place, heading, length, GUESS, work.series, work.code)
        if wrap["kind"] == ELLIPSOID or count > 0:
            return _shorten_with_contact(start, end, contact, before, behind, another, count + 1, work)
        return 1
    return count


@compiled
def _shorten_with_contact(
    start: Vector,
    end: Vector,
    contact: Record,
    before: Vector,
    behind: Vector,
    another: float,
    count: int,
    work: GeodesicWorkspace,
) -> int:
    """Shorten the path with its latest contact, on the shorter side where two are possible, and remove contacts at
    which the path would pull on the surface.
    """
    place, heading, on_surface = read(contact["middle"]), read(contact["heading"]), contact["length"]
    code = work.code[0]
    length = _shortest_length(start, end, count, work)
    if not isnan(another):
        work.code[0] = code  # only the side that is taken must converge: the other may have no shortest path
        other_place, other_heading, other_on_surface = contact_in_plane(
            read(contact["size"]), to_surface_frame(contact, before), to_surface_frame(contact, behind), another
        )
        set_geodesic(contact, other_place, other_heading, other_on_surface, GUESS, work.series, work.code)
        if not _shortest_length(start, end, count, work) < length:
            work.code[0] = code
            set_geodesic(contact, place, heading, on_surface, GUESS, work.series, work.code)
            length = _shortest_length(start, end, count, work)
    k = 0
    while k < count:
        if work.contacts[work.order[k]]["length"] > 0.0:
            k += 1
        else:
            count, k = _remove(work.order, count, k), 0
            length = _shortest_length(start, end, count, work)
    return count if length < inf else NO_PATH


@compiled
def _shortest_length(start: Vector, end: Vector, count: int, work: GeodesicWorkspace) -> float:
    """Length [m] after shortening; infinite where there is no path, as between two surfaces that leave no gap."""
    if not shorten_path(start, end, count, work):
        return inf
    place = start
    for k in range(count):
        first, last = work.contacts[work.order[k]]["first"], work.contacts[work.order[k]]["last"]
        if dot(subtract(read(first["place"]), place), read(first["t"])) < (GAP if k > 0 else 0.0):
            return inf
        place = read(last["place"])
        if k + 1 == count and dot(subtract(end, place), read(last["t"])) < 0.0:
            return inf
    return _length(start, end, count, work)


@compiled
def _length(start: Vector, end: Vector, count: int, work: GeodesicWorkspace) -> float:
    length, place = 0.0, start
    for k in range(count):
        contact = work.contacts[work.order[k]]
        length += distance(place, read(contact["first"]["place"])) + contact["length"]
        place = read(contact["last"]["place"])
    return length + distance(place, end)


@compiled
def _insert(order: Indices, count: int, gap: int, k: int) -> None:
    for j in range(count, gap, -1):
        order[j] = order[j - 1]
    order[gap] = k


@compiled
def _remove(order: Indices, count: int, k: int) -> int:
    for j in range(k, count - 1):
        order[j] = order[j + 1]
    return count - 1


@compiled
def find_first_contact(
    kind: int, size: Vector, axis: int, allowed: int, start: Vector, end: Vector, detours: Array
) -> FirstContact:
    """axis, allowed: the path must pass where coordinate `axis` has the sign `allowed`; 0 allows all sides."""
    if kind == ELLIPSOID:
        return _contact_ellipsoid(size, axis, allowed, start, end, detours)
    if kind == SPHERE:
        return _contact_sphere(size[0], axis, allowed, start, end)
    return _contact_cylinder(size[0], size[2], axis, allowed, start, end)


@compiled
def _contact_ellipsoid(
    size: Vector, axis: int, allowed: int, start: Vector, end: Vector, detours: Array
) -> FirstContact:
    angle, another = shortest_planes(size, axis, allowed, start, end, detours)
    if isnan(angle):
        return NO_CONTACT
    place, heading, length = contact_in_plane(size, start, end, angle)
    return True, place, heading, length, another


@compiled
def _contact_sphere(radius: float, axis: int, allowed: int, start: Vector, end: Vector) -> FirstContact:
    """As in OpenSim, there is contact only if the segment intersects the sphere; the path takes the allowed side."""
    if norm(start) <= radius or norm(end) <= radius or not pierces(subtract(end, start), start, radius * radius)[0]:
        return NO_CONTACT
    x = unit(start)
    normal = cross(start, end)
    # Through the centre, all directions are equally short.
    normal = any_across(x) if norm(normal) < 1e-14 * norm(start) * norm(end) else unit(normal)
    y, opening = cross(normal, x), atan2(norm(cross(start, end)), dot(start, end))
    at_start, at_end = _tangent_angle(norm(start), radius), _tangent_angle(norm(end), radius)
    middle = 0.5 * (at_start + opening - at_end)
    is_free = allowed == 0 or (side(start[axis]) == allowed and side(end[axis]) == allowed)
    if not is_free and side(cos(middle) * x[axis] + sin(middle) * y[axis]) != allowed:
        y, opening = scale(-1.0, y), 2.0 * pi - opening
        middle = 0.5 * (at_start + opening - at_end)
    c, s = cos(middle), sin(middle)
    heading = add(scale(-s, x), scale(c, y))
    return True, scale(radius, add(scale(c, x), scale(s, y))), heading, radius * (opening - at_start - at_end), nan


@compiled
def _contact_cylinder(
    radius: float, length: float, axis: int, allowed: int, start: Vector, end: Vector
) -> FirstContact:
    """On the unrolled cylinder the path is straight. As in OpenSim, there is no contact beyond the cylinder's ends."""
    from_axis, to_axis = sqrt(start[0] ** 2 + start[1] ** 2), sqrt(end[0] ** 2 + end[1] ** 2)
    if from_axis <= radius or to_axis <= radius:
        return NO_CONTACT
    sweep = _sweep(axis, allowed, start, end)
    at_start, at_end = _tangent_angle(from_axis, radius), _tangent_angle(to_axis, radius)
    arc = radius * (abs(sweep) - at_start - at_end)
    if not arc > 0.0:
        return NO_CONTACT
    sense = 1.0 if sweep > 0.0 else -1.0
    before, behind = sqrt(from_axis**2 - radius**2), sqrt(to_axis**2 - radius**2)
    slope = (end[2] - start[2]) / (before + arc + behind)
    low, high = start[2] + slope * before, end[2] - slope * behind
    if abs(low) > length / 2.0 and abs(high) > length / 2.0:
        return NO_CONTACT
    turned = at_start + 0.5 * arc / radius
    c, s = cos(turned), sense * sin(turned)
    x, y = (c * start[0] - s * start[1]) / from_axis, (s * start[0] + c * start[1]) / from_axis
    stretch = sqrt(1.0 + slope * slope)
    heading = (-sense * y / stretch, sense * x / stretch, slope / stretch)
    return True, (radius * x, radius * y, 0.5 * (low + high)), heading, arc * stretch, nan


@compiled
def _sweep(axis: int, allowed: int, start: Vector, end: Vector) -> float:
    """The angle about z from start to end: the smaller one or, where only one side is allowed, the one that does not
    pass the middle of the other side. A side along z does not restrict the direction.
    """
    if allowed == 0 or axis == 2:
        return atan2(start[0] * end[1] - start[1] * end[0], start[0] * end[0] + start[1] * end[1])
    return _angle_from_forbidden_side(axis, allowed, end) - _angle_from_forbidden_side(axis, allowed, start)


@compiled
def _angle_from_forbidden_side(axis: int, allowed: int, point: Vector) -> float:
    """The angle about z, 0 to 2π, from the middle of the forbidden side."""
    angle = atan2(allowed * point[1 - axis] * (-1.0 if axis == 0 else 1.0), -allowed * point[axis])
    return angle if angle >= 0.0 else angle + 2.0 * pi


@compiled
def _tangent_angle(away: float, radius: float) -> float:
    """Angle at the centre between a point and the point where a tangent from it touches the circle."""
    return atan2(sqrt(away * away - radius * radius), radius)
