"""Initial guess of a geodesic on an ellipsoid: the plane through both ends in which the detour is least.

Divided by the semi-axes, the ellipsoid is the unit sphere and its section with a plane a circle: lines, planes and
tangents are preserved, lengths are not. In a half-plane at angle ψ about the line through both ends, with u along the
line and v across it and away from it, the path runs from the start to the circle, over it and on to the end. All these
circles have a chord on the line in common: the higher the arc above it, the longer the path. Where the line is close to
the centre, heights differ too little, and lengths are compared.

The shortest path between two points over surfaces that it touches in a given order, by Newton's method.

A contact has four unknowns: the middle of its geodesic slides by τ along it and by β across, the geodesic turns there
by θ, and grows by λ. Four equations require that the straight segments before and after it are tangent to it:

    d·n = 0,   d·b = 0      at both ends, d being the straight segment there

(on an ellipsoid the first has another form, _arc_to_tangent_point). Their derivatives follow from the curvatures of the
surface and the Jacobi fields of the geodesic. An equation involves only neighbouring contacts. (As Scholz, Sherman,
Stavness, Delp, Kecskeméthy, Multibody Syst. Dyn. 36:195, 2016.)
"""

from __future__ import annotations

from math import atan2, cos, inf, nan, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from solver.compiled import compiled
from solver.geodesics.geodesic import CONTACT, EXACT, ORDER, ROWS, normal_at, project_onto_surface, set_geodesic
from solver.vectors import (
    Array,
    Vector,
    add,
    along,
    any_across,
    cross,
    distance,
    divide,
    dot,
    multiply,
    norm,
    read,
    scale,
    subtract,
    unit,
    write,
)
from solver.wrapping.path_tables import ELLIPSOID, NODE, NOT_CONVERGED, Codes, Indices, PathTables, Record, Records
from solver.wrapping.segment import pierces, side
from solver.wrapping.wrapped_paths import allocate_wrench

PLANES = 12
STEP = 2.0 * pi / PLANES
COSINES = tuple(cos(k * STEP) for k in range(PLANES))
SINES = tuple(sin(k * STEP) for k in range(PLANES))
NEARLY_AS_SHORT = 2.0  # ratio of two detours below which they do not decide which geodesic is shorter
NEAR_CENTRE = 0.5  # of the unit sphere
REFINEMENTS = 2
FAR, FORBIDDEN = 1e9, 1e6  # above any detour
ROUND_OFF = 1e-6
OFF_MIDDLE = 0.15**0.5  # nodes of Gauss and Legendre's quadrature with three points, from the middle of 0 to 1

Pencil = tuple[Vector, Vector, Vector, float, float, float]
"""Directions to the foot of the origin on the line, across it, and u; distance of the foot; start and end along u."""

Circle = tuple[Vector, Vector, float, float, float, float, float]
"""v; centre of the section; height of the line above it along v; radius of the section; cosine and sine of the angle
from u to v at which the path reaches it; angle of the arc."""


@compiled
def shortest_planes(
    size: Vector, axis: int, allowed: int, start: Vector, end: Vector, detours: Array
) -> tuple[float, float]:
    """Angles ψ of the plane of the shortest path over an ellipsoid with these semi-axes, and of another that may be as
    short; NaN where there is none.

    axis, allowed  a path's middle must lie where coordinate `axis` has the sign `allowed`; 0 allows all sides
    detours        (PLANES,) working memory
    """
    p, q = divide(start, size), divide(end, size)
    if dot(p, p) <= 1.0 or dot(q, q) <= 1.0 or not pierces(subtract(q, p), p, 1.0)[0]:
        return nan, nan
    pencil = _pencil(p, q)
    away, products = pencil[3], _products_across(size, pencil)
    if away < NEAR_CENTRE:
        _set_detours(size, pencil, distance(start, end), detours)
    else:
        _set_square_heights(away, products, detours)
    first, second, least, next_least = 0.0, nan, FAR, FAR  # 0 where all are as long: between the poles of a spheroid
    for k in range(PLANES):
        before, here, behind = detours[k - 1], detours[k], detours[(k + 1) % PLANES]
        if not (here <= before and here < behind):
            continue
        angle = k * STEP + _parabola_minimum(before, here, behind)
        if allowed != 0 and side(_middle(pencil, cos(angle), sin(angle))[axis]) != allowed:
            here += FORBIDDEN
        if here < least:
            first, second, least, next_least = angle, first, here, least
        elif here < next_least:
            second, next_least = angle, here
    if away >= NEAR_CENTRE:
        first = _least_height(away, products, first)
    return first, (second if next_least <= NEARLY_AS_SHORT * least else nan)


@compiled
def contact_in_plane(size: Vector, start: Vector, end: Vector, angle: float) -> tuple[Vector, Vector, float]:
    """Middle, direction there and length on the ellipsoid of the path in the half-plane at an angle."""
    pencil = _pencil(divide(start, size), divide(end, size))
    u = pencil[2]
    v, centre, _, radius, c, s, arc = _circle(pencil, cos(angle), sin(angle))
    x, y = multiply(size, u), multiply(size, v)
    length = radius * _arc(dot(x, x), dot(x, y), dot(y, y), c, s, arc)
    half_c, half_s = cos(0.5 * arc), sin(0.5 * arc)
    c, s = c * half_c + s * half_s, s * half_c - c * half_s
    place = add(centre, scale(radius, add(scale(c, u), scale(s, v))))
    heading = add(scale(s, u), scale(-c, v))
    return multiply(size, place), unit(multiply(size, heading)), length


@compiled
def _pencil(p: Vector, q: Vector) -> Pencil:
    u = unit(subtract(q, p))
    foot = along(p, -dot(p, u), u)
    away = norm(foot)
    towards = scale(1.0 / away, foot) if away > 1e-12 else any_across(u)
    return towards, cross(u, towards), u, away, dot(p, u), dot(q, u)


@compiled
def _products_across(size: Vector, pencil: Pencil) -> Vector:
    """Products xx, xy and yy of the directions towards the foot and across, at right angles to the line [m²]."""
    x, y, u = multiply(size, pencil[0]), multiply(size, pencil[1]), unit(multiply(size, pencil[2]))
    x, y = along(x, -dot(x, u), u), along(y, -dot(y, u), u)
    return dot(x, x), dot(x, y), dot(y, y)


@compiled
def _set_square_heights(away: float, products: Vector, detours: Array) -> None:
    """Squares of the heights of the circles' tops above the line [m²], to which the detours are nearly proportional."""
    xx, xy, yy = products
    for k in range(PLANES):
        height = sqrt(1.0 - away * away * SINES[k] * SINES[k]) - away * COSINES[k]
        detours[k] = (height * _norm(xx, xy, yy, COSINES[k], SINES[k])) ** 2


@compiled
def _least_height(away: float, products: Vector, angle: float) -> float:
    """Improve the angle of a least height, by Newton's method for the derivative of its logarithm."""
    xx, xy, yy = products
    for _ in range(REFINEMENTS):
        c, s = cos(angle), sin(angle)
        radius = sqrt(1.0 - away * away * s * s)
        square = c * c * xx + 2.0 * c * s * xy + s * s * yy
        share = (c * s * (yy - xx) + (c * c - s * s) * xy) / square
        bend = ((c * c - s * s) * (yy - xx) - 4.0 * c * s * xy) / square - 2.0 * share * share
        slope, bend = share + away * s / radius, bend + away * c / radius**3
        step = -slope / bend if bend > 0.0 else 0.0
        angle += min(max(step, -0.5 * STEP), 0.5 * STEP)
    return angle


@compiled
def _set_detours(size: Vector, pencil: Pencil, straight: float, detours: Array) -> None:
    """How much longer [m] than the straight line the path in each half-plane is."""
    u, at_start, at_end = pencil[2], pencil[4], pencil[5]
    for k in range(PLANES):
        v, _, height, radius, c, s, arc = _circle(pencil, COSINES[k], SINES[k])
        x, y = multiply(size, u), multiply(size, v)
        xx, xy, yy = dot(x, x), dot(x, y), dot(y, y)
        turned_c, turned_s = c * cos(arc) + s * sin(arc), s * cos(arc) - c * sin(arc)
        before = _norm(xx, xy, yy, radius * c - at_start, radius * s - height)
        behind = _norm(xx, xy, yy, at_end - radius * turned_c, height - radius * turned_s)
        detours[k] = before + radius * _arc(xx, xy, yy, c, s, arc) + behind - straight


@compiled
def _circle(pencil: Pencil, cosine: float, sine: float) -> Circle:
    """Tangents to a circle of radius r from p, |p| = d, touch it at r/d (p/d turned by ± the angle with cosine r/d)."""
    towards, across, _, away, at_start, at_end = pencil
    v = add(scale(cosine, towards), scale(sine, across))
    height, radius = away * cosine, sqrt(1.0 - away * away * sine * sine)
    centre = along(scale(away, towards), -height, v)
    from_start, from_end = at_start * at_start + height * height, at_end * at_end + height * height
    k, m = sqrt(max(from_start - radius * radius, 0.0)), sqrt(max(from_end - radius * radius, 0.0))
    c, s = (at_start * radius + height * k) / from_start, (height * radius - at_start * k) / from_start
    end_c, end_s = (at_end * radius - height * m) / from_end, (height * radius + at_end * m) / from_end
    arc = atan2(s * end_c - c * end_s, c * end_c + s * end_s)
    return v, centre, height, radius, c, s, (arc if arc > -ROUND_OFF else arc + 2.0 * pi)


@compiled
def _middle(pencil: Pencil, cosine: float, sine: float) -> Vector:
    """Middle of the path on the unit sphere."""
    v, centre, _, radius, c, s, arc = _circle(pencil, cosine, sine)
    half_c, half_s = cos(0.5 * arc), sin(0.5 * arc)
    middle = add(scale(c * half_c + s * half_s, pencil[2]), scale(s * half_c - c * half_s, v))
    return add(centre, scale(radius, middle))


@compiled
def _arc(xx: float, xy: float, yy: float, c: float, s: float, arc: float) -> float:
    """Length of the arc from (c, s) on, of an ellipse x cos φ + y sin φ: by Gauss and Legendre's quadrature."""
    half_c, half_s = cos(0.5 * arc), sin(0.5 * arc)
    off_c, off_s = cos(OFF_MIDDLE * arc), sin(OFF_MIDDLE * arc)
    c, s = c * half_c + s * half_s, s * half_c - c * half_s
    middle = _norm(xx, xy, yy, -s, c)
    before = _norm(xx, xy, yy, -s * off_c - c * off_s, c * off_c - s * off_s)
    behind = _norm(xx, xy, yy, -s * off_c + c * off_s, c * off_c + s * off_s)
    return arc * (5.0 * before + 8.0 * middle + 5.0 * behind) / 18.0


@compiled
def _norm(xx: float, xy: float, yy: float, a: float, b: float) -> float:
    """|a x + b y|, of vectors with these products."""
    return sqrt(a * a * xx + 2.0 * a * b * xy + b * b * yy)


@compiled
def _parabola_minimum(before: float, here: float, behind: float) -> float:
    """Minimum point of the parabola through three equidistant lengths, of which the middle one is the least."""
    bend = before - 2.0 * here + behind
    return 0.5 * STEP * (before - behind) / bend if bend > ROUND_OFF * here else 0.0


GUESS = 1e-4  # accuracy of a guessed geodesic (geodesic.py)
MOST_STEPS = 30
SINGULAR = 1e-14
FIRST, LAST = 1.0, -1.0  # ends of a contact: sense in which the straight segment there grows as the end moves along t
LONGEST_STEP, EXACT_FROM, LAST_STEP = 0.3, 3e-4, 1e-7  # in radii of the surface, or rad


@compiled
def shorten_path(start: Vector, end: Vector, count: int, work: GeodesicWorkspace) -> bool:
    """Make the first `count` contacts of work.order, guesses of accuracy GUESS, exact; False where that fails. All in
    ground.

    Geodesics are traced only as accurately as the step of Newton's method needs: it squares the error. The last step is
    applied to first order, without tracing the geodesics again.
    """
    contacts, order, accuracy = work.contacts, work.order, GUESS
    equations = work.matrix[: 4 * count, : 4 * count + 1]
    steps = equations[:, -1]
    for _ in range(MOST_STEPS):
        _fill(start, end, contacts, order, equations)
        _solve_equations(equations)
        longest = _largest_step(contacts, order, steps)
        if longest <= LAST_STEP and accuracy == EXACT:
            for k in range(count):
                _move_ends(contacts[order[k]], steps[4 * k : 4 * k + 4])
            return True
        if not longest < inf:
            return False
        accuracy = EXACT if longest < EXACT_FROM else min(GUESS, 0.01 * longest * longest)
        share = 1.0 if longest <= LONGEST_STEP else LONGEST_STEP / longest
        for k in range(count):
            _move(contacts[order[k]], share, steps[4 * k : 4 * k + 4], accuracy, work.series, work.code)
    work.code[0] = NOT_CONVERGED
    return False


@compiled
def _fill(start: Vector, end: Vector, contacts: Records, order: Indices, matrix: Array) -> None:
    """Derivatives of the conditions by (τ, β, θ, λ) of the contacts and, in the last column, minus the conditions."""
    count = len(matrix) // 4
    matrix[:] = 0.0
    for k in range(count):
        contact, row = contacts[order[k]], 4 * k
        first, last = contact["first"], contact["last"]
        before = read(contacts[order[k - 1]]["last"]["place"]) if k > 0 else start
        behind = read(contacts[order[k + 1]]["first"]["place"]) if k + 1 < count else end
        arriving, leaving = subtract(read(first["place"]), before), subtract(behind, read(last["place"]))
        ahead, above = _fill_end(matrix, row, contact, first, arriving, FIRST)
        if k > 0:
            _fill_neighbour(matrix, row, row - 4, first, contacts[order[k - 1]], ahead, above, LAST)
        ahead, above = _fill_end(matrix, row + 2, contact, last, leaving, LAST)
        if k + 1 < count:
            _fill_neighbour(matrix, row + 2, row + 4, last, contacts[order[k + 1]], ahead, above, FIRST)


@compiled
def _fill_end(
    matrix: Array, row: int, contact: Record, end: Record, segment: Vector, sense: float
) -> tuple[float, float]:
    """The two conditions at one end of a contact, FIRST or LAST, and their derivatives by its own unknowns.

    Returns the derivatives of the first condition by the components of the straight segment there along t and n.
    """
    on_t, on_n, on_b = dot(segment, read(end["t"])), dot(segment, read(end["n"])), dot(segment, read(end["b"]))
    tt, tb, bb = read(end["curvatures"])
    missing, ahead, above = on_n, 0.0, 1.0
    if contact["kind"] == ELLIPSOID:
        missing, ahead, above = _arc_to_tangent_point(1.0 / tt, on_t, -sense * on_n)
        above *= -sense
    by_t = ahead * (sense - tt * on_n) + above * (tt * on_t + tb * on_b)
    by_b = -ahead * tb * on_n + above * (tb * on_t + bb * on_b)
    column, jacobi = row - 2 if sense == LAST else row, end["jacobi"]
    matrix[row, -1], matrix[row + 1, -1] = -missing, -on_b
    _differentiate(matrix, row, column, sense, jacobi, by_t, by_b, ahead * on_b)
    _differentiate(matrix, row + 1, column, sense, jacobi, -tb * on_n, sense - bb * on_n, -on_t)
    return ahead, above


@compiled
def _arc_to_tangent_point(radius: float, x: float, y: float) -> tuple[float, float, float]:
    """Arc length on a circle from its top (0, 0) to the tangent point of the line to (x, y); its derivatives by x, y.

    Unlike y itself it is zero at only one of the two tangent points, and nearly linear where the other is close, as for
    an end close to the surface. For a point inside, the arc to the nearest point of the circle.
    """
    height = y + radius
    square = x * x + height * height
    by_x, by_y = height / square, -x / square
    if not square > radius * radius:
        return radius * atan2(x, height), radius * by_x, radius * by_y
    k = sqrt(square - radius * radius)
    by_x -= radius * x / (square * k)
    by_y -= radius * height / (square * k)
    return radius * atan2(x * radius - height * k, height * radius + x * k), radius * by_x, radius * by_y


@compiled
def _fill_neighbour(
    matrix: Array, row: int, column: int, end: Record, neighbour: Record, ahead: float, above: float, sense: float
) -> None:
    """Derivatives of the conditions at one end of a straight segment by the unknowns of the contact at its other end,
    which is that contact's FIRST or LAST.
    """
    other = neighbour["last"] if sense == LAST else neighbour["first"]
    jacobi = other["jacobi"]
    t, b, across = read(other["t"]), read(other["b"]), read(end["b"])
    towards = add(scale(sense * ahead, read(end["t"])), scale(sense * above, read(end["n"])))
    _differentiate(matrix, row, column, sense, jacobi, dot(t, towards), dot(b, towards), 0.0)
    _differentiate(matrix, row + 1, column, sense, jacobi, sense * dot(t, across), sense * dot(b, across), 0.0)


@compiled
def _differentiate(
    matrix: Array, row: int, column: int, sense: float, jacobi: Array, by_t: float, by_b: float, by_turn: float
) -> None:
    """Derivatives by the steps of an end along t and b and by its turn, as derivatives by the contact's four unknowns;
    sense as of that end.
    """
    matrix[row, column] = by_t
    matrix[row, column + 1] = by_b * jacobi[0] + by_turn * jacobi[2]
    matrix[row, column + 2] = by_b * jacobi[1] + by_turn * jacobi[3]
    matrix[row, column + 3] = -0.5 * sense * by_t


@compiled
def _solve_equations(matrix: Array) -> None:
    """Solve the equations (Gauss, pivots by row) into the last column.

    Unknowns that they do not determine stay as they are: the direction about the axis of a spheroid for a path through
    its poles.
    """
    size = len(matrix)
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        for j in range(k, matrix.shape[1]):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        if abs(matrix[k, k]) < SINGULAR:
            matrix[k, k] = inf
        for i in range(k + 1, size):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, matrix.shape[1]):
                matrix[i, j] -= factor * matrix[k, j]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            matrix[k, -1] -= matrix[k, j] * matrix[j, -1]
        matrix[k, -1] /= matrix[k, k]


@compiled
def _largest_step(contacts: Records, order: Indices, steps: Array) -> float:
    """Infinite if one of the steps is not a number."""
    longest = 0.0
    for k in range(len(steps) // 4):
        size = contacts[order[k]]["size"]
        radius = min(size[0], size[1], size[2])
        for i in range(4):
            step = abs(steps[4 * k + i])
            if not step < inf:
                return inf
            longest = max(longest, step if i == 2 else step / radius)
    return longest


@compiled
def _move_ends(contact: Record, steps: Array) -> None:
    _move_end(contact["first"], steps[0] - 0.5 * steps[3], steps)
    _move_end(contact["last"], steps[0] + 0.5 * steps[3], steps)
    contact["length"] += steps[3]


@compiled
def _move_end(end: Record, forwards: float, steps: Array) -> None:
    across = end["jacobi"][0] * steps[1] + end["jacobi"][1] * steps[2]
    write(end["place"], along(along(read(end["place"]), forwards, read(end["t"])), across, read(end["b"])))


@compiled
def _move(contact: Record, share: float, steps: Array, accuracy: float, series: Array, code: Codes) -> None:
    kind, size = contact["kind"], read(contact["size"])
    x, t = read(contact["middle"]), read(contact["heading"])
    b = cross(normal_at(kind, size, x), t)
    x = project_onto_surface(kind, size, along(along(x, share * steps[0], t), share * steps[1], b))
    t, n = along(t, share * steps[2], b), normal_at(kind, size, x)
    heading, length = unit(along(t, -dot(t, n), n)), contact["length"] + share * steps[3]
    set_geodesic(contact, x, heading, length, accuracy, series, code)


class GeodesicWorkspace(NamedTuple):
    """nodes of a path (NODE) and their sequence along it; stops, the nodes that are its path points; its contacts
    (CONTACT), one for each of its surfaces, and their order along a segment; the matrix of a path; the series of
    geodesic.py; the detours; wrench (bodies, 6), zero between paths; code (1,), the path's outcome.
    """

    nodes: Records
    sequence: Indices
    stops: Indices
    contacts: Records
    order: Indices
    matrix: Array
    series: Array
    detours: Array
    wrench: Array
    code: Codes


def allocate_geodesic(tables: PathTables) -> GeodesicWorkspace:
    points = int(np.diff(tables.first_point).max(initial=0))
    wraps = int(np.diff(tables.first_wrap).max(initial=0))
    nodes = points + 2 * wraps * points
    return GeodesicWorkspace(
        np.zeros(nodes, NODE),
        np.zeros(nodes, np.int64),
        np.zeros(points, np.int64),
        np.zeros(wraps, CONTACT),
        np.zeros(wraps, np.int64),
        np.zeros((4 * wraps, 4 * wraps + 1)),
        np.zeros((ROWS, ORDER + 1)),
        np.zeros(PLANES),
        allocate_wrench(tables),
        np.zeros(1, np.int8),
    )
