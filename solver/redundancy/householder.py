"""Householder reflections that triangularise the rows of a frame; compiled."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled
from solver.dense import copy, inner_product

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-9  # of the longest column


class Triangle(NamedTuple):
    """A matrix in two parts: the columns of the free unknowns (rows, free), and the others (rows, width), with zeros up
    to the width dense.padded. Only as many rows as the reflector has are reflected; sums (width,) is working memory.
    """

    free: Array
    others: Array
    reflector: Array
    sums: Array


@compiled
def triangularise(triangle: Triangle, weighted: int) -> int:
    """Reflect the rows in place: first along each of the free columns in turn, then along the longest that is left of
    the first `weighted` columns of the others. Then the upper rows are solved for the free unknowns, and those below
    are scaled to length 1 in the weighted columns.

    Returns the rank, less than the number of free columns where these are dependent; rows beyond have no meaning.
    """
    free, others, reflector, sums = triangle
    count, rank, longest = free.shape[1], 0, 0.0
    while rank < len(reflector):
        if rank == 0:
            for rows, end in ((free, count), (others, weighted)):
                longest = max(longest, _longest_column(rows, rank, end, triangle)[1])
        if rank < count:
            length = _set_reflector(free, rank, rank, reflector)
        else:
            column, _ = _longest_column(others, rank, weighted, triangle)
            length = _set_reflector(others, rank, column, reflector)
        if not length > RANK_TOLERANCE * longest:
            break
        if rank < count:
            _reflect(free, rank, reflector, sums)
        _reflect(others, rank, reflector, sums)
        rank += 1
    if rank >= count:
        _solve(free, others, sums)
        for i in range(count, rank):
            own = others[i, :weighted]
            _divide(others[i], sqrt(inner_product(own, own)))
    return rank


@compiled
def _longest_column(rows: Array, first: int, end: int, triangle: Triangle) -> tuple[int, float]:
    """Index of the longest of the columns before `end`, in the rows from the first on, and its length."""
    squares, longest, most = triangle.sums[: rows.shape[1]], 0, 0.0
    _clear(squares)
    for i in range(first, len(triangle.reflector)):
        for j in range(len(squares)):
            squares[j] += rows[i, j] * rows[i, j]
    for j in range(end):
        if squares[j] > most:
            longest, most = j, squares[j]
    return longest, sqrt(most)


@compiled
def _set_reflector(rows: Array, first: int, column: int, reflector: Array) -> float:
    """The column, from the first row on, and ± its length added to its first entry; returns that length."""
    square = 0.0
    for i in range(first, len(reflector)):
        reflector[i] = rows[i, column]
        square += reflector[i] * reflector[i]
    length = sqrt(square)
    reflector[first] += length if reflector[first] >= 0.0 else -length
    return length


@compiled
def _reflect(rows: Array, first: int, reflector: Array, sums: Array) -> None:
    """rows − 2 v (v·rows) / v·v, so that the column of the reflector v becomes ± its length in the first row."""
    shadow, own = sums[: rows.shape[1]], reflector[first:]
    _clear(shadow)
    for i in range(first, len(reflector)):
        factor = reflector[i]
        for j in range(len(shadow)):
            shadow[j] += factor * rows[i, j]
    scale = 2.0 / inner_product(own, own)
    for i in range(first, len(reflector)):
        factor = scale * reflector[i]
        for j in range(len(shadow)):
            rows[i, j] -= factor * shadow[j]


@compiled
def _solve(free: Array, others: Array, sums: Array) -> None:
    """Back substitution with the triangle of the free columns; a row is copied, so that it cannot overlap others."""
    for k in range(free.shape[1] - 1, -1, -1):
        _divide(others[k], free[k, k])
        copy(others[k], sums)
        for i in range(k):
            factor = free[i, k]
            for j in range(len(sums)):
                others[i, j] -= factor * sums[j]


@compiled
def _clear(row: Array) -> None:
    for j in range(len(row)):
        row[j] = 0.0


@compiled
def _divide(row: Array, divisor: float) -> None:
    for j in range(len(row)):
        row[j] /= divisor
