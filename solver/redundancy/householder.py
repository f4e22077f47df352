"""Householder reflections that triangularise the rows of each frame; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.dense import dot

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-9  # of the longest column


@compiled_for_python
def triangularise(triangles: Array, free: int, weighted: int) -> NDArray[np.int64]:
    """Turn the rows of triangles (frames, rows, columns) in place: first along each of the `free` columns in turn, then
    along the longest that is left of the next `weighted` columns. Then the first rows are solved for the free columns,
    which become the identity, and the others are scaled to length 1 in the weighted columns.

    Returns the ranks (frames,), less than `free` where the free columns are dependent; rows beyond have no meaning.
    """
    ranks = np.empty(len(triangles), np.int64)
    sums = np.empty(triangles.shape[2])
    for frame in range(len(triangles)):
        rows = triangles[frame]
        _, longest = _longest_column(rows[:, : free + weighted], sums)
        rank = 0
        while rank < len(rows):
            start, end = (rank, rank + 1) if rank < free else (free, free + weighted)
            column, length = _longest_column(rows[rank:, start:end], sums)
            if not length > RANK_TOLERANCE * longest:
                break
            _reflect(rows[rank:, start:], column, length, sums)
            rank += 1
        ranks[frame] = rank
        if rank >= free:
            _solve(rows[:free], free)
            for i in range(free, rank):
                own = rows[i, free : free + weighted]
                _divide(rows[i, free:], np.sqrt(dot(own, own)))
    return ranks


# These functions slice columns so that indices start at 0: the compiler knows that none is negative, and vectorises.


@compiled
def _longest_column(rows: Array, sums: Array) -> tuple[int, float]:
    """Index of the longest column, and its length."""
    squares = sums[: rows.shape[1]]
    _clear(squares)
    for row in rows:
        for j in range(len(squares)):
            squares[j] += row[j] * row[j]
    longest = 0
    for j in range(len(squares)):
        if squares[j] > squares[longest]:
            longest = j
    return longest, float(np.sqrt(squares[longest]))


@compiled
def _reflect(rows: Array, column: int, length: float, sums: Array) -> None:
    """The column becomes ± its length in the first row and zero below."""
    shadow, square, first = sums[: rows.shape[1]], 0.0, rows[0, column]
    rows[0, column] += length if first >= 0.0 else -length
    _clear(shadow)
    for row in rows:
        factor = row[column]
        square += factor * factor
        for j in range(len(shadow)):
            shadow[j] += factor * row[j]
    for row in rows:
        factor = 2.0 * row[column] / square
        for j in range(len(shadow)):
            row[j] -= factor * shadow[j]
    for row in rows:
        row[column] = 0.0
    rows[0, column] = -length if first >= 0.0 else length


@compiled
def _solve(rows: Array, free: int) -> None:
    """Back substitution, after which the triangle is the identity."""
    for k in range(free - 1, -1, -1):
        row = rows[k, k:]
        _divide(row, row[0])
        for i in range(k):
            above, factor = rows[i, k:], rows[i, k]
            for j in range(len(row)):
                above[j] -= factor * row[j]


@compiled
def _clear(row: Array) -> None:
    for j in range(len(row)):
        row[j] = 0.0


@compiled
def _divide(row: Array, divisor: float) -> None:
    for j in range(len(row)):
        row[j] /= divisor
