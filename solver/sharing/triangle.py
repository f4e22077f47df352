"""Householder reflections that make a triangle of each frame's rows; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python

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
        least, rank = RANK_TOLERANCE**2 * np.max(_squares(rows[:, : free + weighted], sums)), 0
        while rank < len(rows):
            start, end = (rank, rank + 1) if rank < free else (free, free + weighted)
            squares = _squares(rows[rank:, start:end], sums)
            column = int(np.argmax(squares))
            if not squares[column] > least:
                break
            _reflect(rows[rank:, start:], column, np.sqrt(squares[column]), sums)
            rank += 1
        ranks[frame] = rank
        if rank >= free:
            _solve(rows[:free], free)
            for i in range(free, rank):
                _divide(rows[i, free:], np.sqrt(_squares(rows[i : i + 1, free : free + weighted], sums).sum()))
    return ranks


# Columns are counted from 0 in these, by slices: then the compiler knows that no index is negative, and takes several
# steps of a loop at once.


@compiled
def _squares(rows: Array, sums: Array) -> Array:
    """(columns,) of each column, its square; in the room of sums."""
    squares = sums[: rows.shape[1]]
    squares[:] = 0.0
    for row in rows:
        for j in range(len(squares)):
            squares[j] += row[j] * row[j]
    return squares


@compiled
def _reflect(rows: Array, column: int, length: float, sums: Array) -> None:
    """The column becomes ± its length in the first row and zero below."""
    shadow, square, first = sums[: rows.shape[1]], 0.0, rows[0, column]
    rows[0, column] += length if first >= 0.0 else -length
    shadow[:] = 0.0
    for row in rows:
        factor = row[column]
        square += factor * factor
        for j in range(len(shadow)):
            shadow[j] += factor * row[j]
    for row in rows:
        factor = 2.0 * row[column] / square
        for j in range(len(shadow)):
            row[j] -= factor * shadow[j]
    rows[:, column] = 0.0
    rows[0, column] = -length if first >= 0.0 else length


@compiled
def _solve(rows: Array, free: int) -> None:
    """Backwards, so that the triangle becomes the identity."""
    for k in range(free - 1, -1, -1):
        row = rows[k, k:]
        _divide(row, row[0])
        for i in range(k):
            above, factor = rows[i, k:], rows[i, k]
            for j in range(len(row)):
                above[j] -= factor * row[j]


@compiled
def _divide(row: Array, divisor: float) -> None:
    for j in range(len(row)):
        row[j] /= divisor
