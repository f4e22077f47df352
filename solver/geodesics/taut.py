"""A path pulled taut between two points over surfaces that it touches in a given order: Newton's method.

Unknowns of each contact are four: its geodesic may slide by τ along itself and by β across, turn by θ at its beginning,
and grow by λ. Four equations ask that the straight pieces before and behind it leave along its directions:

    d·n = 0,   d·b = 0      at both ends, d being the straight piece there

Their derivatives come from the surface's bends and from the spread of neighbouring geodesics. Each equation knows only
the neighbours on the path. (As Scholz, Sherman, Stavness, Delp, Kecskeméthy, Multibody Syst. Dyn. 36:195, 2016.)
"""

from __future__ import annotations

from math import inf

from solver.compiled import compiled
from solver.geodesics.contact import set_geodesic
from solver.geodesics.follow import normal_at, onto
from solver.geodesics.room import Room
from solver.geodesics.series import EXACT
from solver.wrapping.course import Indices, Record, Records
from solver.wrapping.vectors import (
    Array,
    Vector,
    along,
    cross,
    dot,
    read,
    subtract,
    unit,
)

GUESS = 1e-4  # accuracy of a guessed geodesic (series.py)
SMALL_ENOUGH = 1e-14  # m, of the conditions
MOST_STEPS = 30
SINGULAR = 1e-14
LONGEST_STEP = 0.3  # of a radius, or rad


@compiled
def pull_taut(start: Vector, end: Vector, count: int, room: Room) -> bool:
    """Whether the first `count` contacts of room.order, guesses of accuracy GUESS, could be made exact; all in ground.

    Geodesics are as accurate as Newton's method makes use of: it squares the error.
    """
    contacts, order, accuracy = room.contacts, room.order, GUESS
    equations = room.matrix[: 4 * count, : 4 * count + 1]
    for _ in range(MOST_STEPS):
        error = _conditions(start, end, contacts, order, equations)
        if error <= SMALL_ENOUGH and accuracy == EXACT:
            return True
        _eliminate(equations)
        share = _share(contacts, order, equations[:, -1])
        if not share > 0.0:
            return False
        accuracy = max(EXACT, min(GUESS, 10.0 * error * error))
        for k in range(count):
            _move(contacts[order[k]], share, equations[4 * k : 4 * k + 4, -1], accuracy, room.series)
    return False


@compiled
def _conditions(start: Vector, end: Vector, contacts: Records, order: Indices, matrix: Array) -> float:
    """Fill the matrix with the derivatives by (τ, β, θ, λ) of each contact and, behind them, minus the conditions;
    returns the largest of these.
    """
    count = len(matrix) // 4
    worst = 0.0
    matrix[:] = 0.0
    for k in range(count):
        contact, row = contacts[order[k]], 4 * k
        first, last, spread = contact["first"], contact["last"], contact["spread"]
        before = read(contacts[order[k - 1]]["last"]["place"]) if k > 0 else start
        behind = read(contacts[order[k + 1]]["first"]["place"]) if k + 1 < count else end
        arriving, leaving = subtract(read(first["place"]), before), subtract(behind, read(last["place"]))
        _fill_end(matrix, row, row, first, arriving, 1.0, False, spread)
        _fill_end(matrix, row + 2, row, last, leaving, -1.0, True, spread)
        if k > 0:
            _fill_neighbour(matrix, row, row - 4, first, contacts[order[k - 1]], -1.0, True)
        if k + 1 < count:
            _fill_neighbour(matrix, row + 2, row + 4, last, contacts[order[k + 1]], 1.0, False)
        for i in range(4):
            worst = max(worst, abs(matrix[row + i, -1]))
    return worst


@compiled
def _fill_end(
    matrix: Array, row: int, column: int, end: Record, piece: Vector, sense: float, is_last: bool, spread: Array
) -> None:
    """The two conditions at one end of a contact and what its own unknowns do to them; the straight piece there grows
    by `sense` with the end's place.
    """
    on_t, on_n, on_b = dot(piece, read(end["t"])), dot(piece, read(end["n"])), dot(piece, read(end["b"]))
    tt, tb, bb = read(end["bends"])
    matrix[row, -1], matrix[row + 1, -1] = -on_n, -on_b
    _fill(matrix, row, column, is_last, spread, tt * on_t + tb * on_b, tb * on_t + bb * on_b, 0.0)
    _fill(matrix, row + 1, column, is_last, spread, -tb * on_n, sense - bb * on_n, -on_t)


@compiled
def _fill_neighbour(
    matrix: Array, row: int, column: int, end: Record, neighbour: Record, sense: float, is_last: bool
) -> None:
    """What the unknowns of the contact at the other end of a straight piece do to the conditions at this one."""
    other = neighbour["last"] if is_last else neighbour["first"]
    t, b = read(other["t"]), read(other["b"])
    n, across = read(end["n"]), read(end["b"])
    spread = neighbour["spread"]
    _fill(matrix, row, column, is_last, spread, sense * dot(t, n), sense * dot(b, n), 0.0)
    _fill(matrix, row + 1, column, is_last, spread, sense * dot(t, across), sense * dot(b, across), 0.0)


@compiled
def _fill(
    matrix: Array, row: int, column: int, is_last: bool, spread: Array, by_t: float, by_b: float, by_turn: float
) -> None:
    """Derivatives by an end's steps along t and b and its turn, as derivatives by the contact's four unknowns."""
    matrix[row, column] = by_t
    if is_last:
        matrix[row, column + 1] = by_b * spread[0] + by_turn * spread[2]
        matrix[row, column + 2] = by_b * spread[1] + by_turn * spread[3]
        matrix[row, column + 3] = by_t
    else:
        matrix[row, column + 1] = by_b
        matrix[row, column + 2] = by_turn
        matrix[row, column + 3] = 0.0


@compiled
def _eliminate(matrix: Array) -> None:
    """Solve the equations (Gauss, pivots by row) into the last column.

    What they leave open stays as it is: the direction round the axis of a spheroid for a path through its poles.
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
def _share(contacts: Records, order: Indices, steps: Array) -> float:
    """How much of the steps may be taken, so that none goes far on its surface; none if one is not a number."""
    longest = 0.0
    for k in range(len(steps) // 4):
        size = contacts[order[k]]["size"]
        radius = min(size[0], size[1], size[2])
        for i in range(4):
            step = abs(steps[4 * k + i])
            step = step if i == 2 else step / radius
            if not step < inf:
                return 0.0
            longest = max(longest, step)
    return 1.0 if longest <= LONGEST_STEP else LONGEST_STEP / longest


@compiled
def _move(contact: Record, share: float, steps: Array, accuracy: float, series: Array) -> None:
    kind, size = contact["kind"], read(contact["size"])
    x, t = read(contact["start"]), read(contact["heading"])
    b = cross(normal_at(kind, size, x), t)
    x = onto(kind, size, along(along(x, share * steps[0], t), share * steps[1], b))
    t, n = along(t, share * steps[2], b), normal_at(kind, size, x)
    set_geodesic(contact, x, unit(along(t, -dot(t, n), n)), contact["length"] + share * steps[3], accuracy, series)
