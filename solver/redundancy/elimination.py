"""Elimination of the unbounded unknowns frame by frame; compiled. The equations are in reduction.py."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.dense import copy
from solver.redundancy.householder import Triangle, triangularise

Array = NDArray[np.float64]


class Unreduced(NamedTuple):
    """A (frames, tracked, controls), C (frames, k, controls), the numbers of activations a and of unknowns f, the order
    (controls,) a, r, f in which their columns are treated, and the weights w (reserves,) of r.
    """

    matrix: Array
    cone_matrix: Array
    muscles: int
    free: int
    order: NDArray[np.int64]
    weights: Array


class ReducedRows(NamedTuple):
    """The arrays of reduction.Reduction that differ from frame to frame."""

    rows: Array
    effort: Array
    per_acceleration: Array
    reserves: Array
    free_per_effort: Array
    free_per_acceleration: Array


@compiled_for_python
def eliminate(problem: Unreduced, rank: int, triangle: Triangle, reduced: ReducedRows) -> int:
    """Fill the reduced rows of frames of this rank of A. Returns the rank, or that of the first frame of another.

    The triangle has the rows of A and below them those of C; the columns of a, r, and the accelerations.
    """
    tracked, cone, weighted = problem.matrix.shape[1], problem.cone_matrix.shape[1], len(problem.order) - problem.free
    for frame in range(len(problem.matrix)):
        _fill_triangle(problem, frame, triangle)
        found = triangularise(triangle, weighted)
        if found != rank:
            return found
        for i in range(problem.free):
            copy(triangle.others[i], reduced.free_per_effort[frame, i])
            copy(triangle.others[i, weighted:], reduced.free_per_acceleration[frame, i])
        for i in range(cone):  # rows of the cone follow the equalities, in place of those that no x reaches
            _eliminate_free(triangle, tracked + i, rank + i)
        lines = triangle.others[problem.free : rank + cone]
        for i in range(len(lines)):
            copy(lines[i], reduced.rows[frame, i])
            copy(lines[i, weighted:], reduced.per_acceleration[frame, i])
        _fill_effort(lines, problem.muscles, problem.weights, reduced.reserves[frame], reduced.effort[frame])
    return rank


@compiled
def _fill_triangle(problem: Unreduced, frame: int, triangle: Triangle) -> None:
    """A and the identity, and below it C and zeros."""
    matrix, cone_matrix, order = problem.matrix[frame], problem.cone_matrix[frame], problem.order
    weighted = len(order) - problem.free
    for i in range(len(triangle.others)):
        own = matrix[i] if i < len(matrix) else cone_matrix[i - len(matrix)]
        row, first = triangle.others[i], triangle.free[i]
        for j in range(weighted):
            row[j] = own[order[j]]
        for j in range(weighted, len(row)):
            row[j] = 0.0
        for j in range(len(first)):
            first[j] = own[order[weighted + j]]
        if i < len(matrix):
            row[weighted + i] = 1.0


@compiled
def _eliminate_free(triangle: Triangle, row: int, into: int) -> None:
    """A row of the cone with f from the upper rows, which are solved for it."""
    others, sums = triangle.others, triangle.sums
    copy(others[row], sums)
    for k in range(triangle.free.shape[1]):
        factor = triangle.free[row, k]
        for j in range(len(sums)):
            sums[j] -= factor * others[k, j]
    copy(sums, others[into])


@compiled
def _fill_effort(lines: Array, muscles: int, weights: Array, reserves: Array, effort: Array) -> None:
    """r of each multiplier, and R, from the columns of r behind those of the muscles."""
    for i in range(len(lines)):
        for k in range(len(weights)):
            reserves[k, i] = lines[i, muscles + k] / (2.0 * weights[k])
        for j in range(i + 1):
            entry = 0.0
            for k in range(len(weights)):
                entry += lines[j, muscles + k] * reserves[k, i]
            effort[i, j] = effort[j, i] = entry
