"""Contacts of a shortest path: which of its surfaces it touches, and in which order."""

from __future__ import annotations

from math import inf, isnan

from solver.compiled import compiled
from solver.geodesics.contact import set_geodesic, to_surface_frame
from solver.geodesics.first_contact import find_first_contact
from solver.geodesics.planes import contact_in_plane
from solver.geodesics.shortest_path import GUESS, shorten_path
from solver.geodesics.workspace import GeodesicWorkspace
from solver.vectors import Vector, distance, dot, read, subtract
from solver.wrapping.path_tables import ELLIPSOID, NOT_CONVERGED, Indices, Record, Records

MOST_ROUNDS = 16
NO_PATH = -1
GAP = 1e-9  # m


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
