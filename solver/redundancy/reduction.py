"""Eliminate the unbounded unknowns of the redundancy problem: bounded activations a and a few multipliers v remain.

    minimise  Σ w aᵖ + Σ w r²   subject to   A x = b,   a within bounds,   C x + c in the cone,   x = (a, r, f)

A x = b is restricted to the range of A: with constraints on accelerations A has dependent rows, and the part of b that
no x produces is left out. f are the actuators without weight, r those with. Householder reflections,
first along the columns of f, then along the longest column that remains, make of A an upper triangle

    Qᵀ A = ( U  F )    f = U⁻¹ (Qᵀ b − F (a, r)) whatever a and r are: f drops out with its rows
           ( 0  G )    equalities of a and r alone, as many as G has rank
           ( 0  0 )    unreachable

and with f in its place the cone's rows become H (a, r) + h. The r of least effort are r = (M_r / 2w)ᵀ v, M = (G, H), so
that of M (a, r) there remains M a + R v with R = M_r (2w)⁻¹ M_rᵀ, the form of problem.py. In the
published problem a, r and f are 33, 9 and 8, and v has 6 + 3 entries.
"""

from __future__ import annotations

from math import prod, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.dense import LANES, copy, inner_product
from solver.multibody.postures import each_frame, read_only
from solver.redundancy.problem import RedundancyProblem

Array = NDArray[np.float64]
NO_RANK = -1
RANK_TOLERANCE = 1e-9  # of the longest column
CACHE_LINE = 64  # bytes


class Reduction(NamedTuple):
    """The reduced problem of every frame, in m rows; the first `equalities` of them are G's, each scaled to length 1.

    rank                   of A
    exponent               p of the activations;  cost q (n,)
    reserve_weights        w (r,) of r
    columns                (controls,) of A for a, r and f, in this order;  controls (controls,) of x for the same
    rows                   M (frames, m, n);  effort R (frames, m, m)
    per_acceleration       (frames, m, tracked): t = this times b, less c in the cone's rows
    reserves               (frames, r, m): r = this times v
    free_per_effort        U⁻¹ F (frames, f, a and r);  free_per_acceleration  U⁻¹ Qᵀ (frames, f, tracked)
    """

    equalities: int
    rank: int
    exponent: int
    cost: Array
    reserve_weights: Array
    columns: NDArray[np.int64]
    controls: NDArray[np.int64]
    rows: Array
    effort: Array
    per_acceleration: Array
    reserves: Array
    free_per_effort: Array
    free_per_acceleration: Array

    def targets(self, acceleration: Array, ray: Array) -> Array:
        """t (scenarios, frames, m) of b (scenarios, frames, tracked) and c (scenarios, frames, k)."""
        t = each_frame(self.per_acceleration, acceleration)
        t[..., self.equalities :] -= ray
        return np.ascontiguousarray(t)

    def x(self, a: Array, v: Array, acceleration: Array) -> Array:
        """x (scenarios, frames, controls) of a (scenarios, frames, n), v (scenarios, frames, m) and b."""
        weighted = np.concatenate([a, each_frame(self.reserves, v)], axis=-1)
        free = each_frame(self.free_per_acceleration, acceleration) - each_frame(self.free_per_effort, weighted)
        x = np.empty((*a.shape[:2], len(self.controls)))
        x[..., self.controls[: weighted.shape[-1]]] = weighted
        x[..., self.controls[weighted.shape[-1] :]] = free
        return x


def reduce_frames(problem: RedundancyProblem, rank: int | None = None) -> Reduction | None:
    """Reduce A and C of all frames. None where the problem has another structure: a muscle without weight, free
    actuators that A leaves undetermined, or frames of different rank, or of another than the given one.
    """
    matrix, cone_matrix, weights, unknowns = problem.matrix, problem.cone_matrix, problem.weights, problem.muscles
    is_free = weights == 0
    (frames, tracked, controls), free, cone = matrix.shape, int(is_free.sum()), cone_matrix.shape[1]
    if is_free[:unknowns].any() or free > tracked:
        return None
    columns = np.argsort(is_free, kind="stable")
    reserve_weights = weights[~is_free][unknowns:]

    def allocate(frames: int, m: int) -> Reduction:
        exponent, order = problem.exponent, problem.order
        return Reduction(
            equalities=m - cone,
            rank=m - cone + free,
            exponent=exponent,
            cost=exponent * weights[:unknowns],
            reserve_weights=reserve_weights,
            columns=columns,
            controls=columns if order is None else order[columns],
            rows=np.empty((frames, m, unknowns)),
            effort=np.empty((frames, m, m)),
            per_acceleration=np.empty((frames, m, tracked)),
            reserves=np.empty((frames, len(reserve_weights), m)),
            free_per_effort=np.empty((frames, free, unknowns + len(reserve_weights))),
            free_per_acceleration=np.empty((frames, free, tracked)),
        )

    width = -(-(controls - free + tracked) // LANES) * LANES  # rows are worked on by so many numbers at once
    triangle = Triangle(
        free=np.empty((tracked + cone, free)),
        others=aligned(tracked + cone, width),
        reflector=np.empty(tracked),
        sums=aligned(width),
    )
    matrix, cone_matrix = read_only(matrix), read_only(cone_matrix)
    if rank is None:
        rank = eliminate(matrix[:1], cone_matrix[:1], NO_RANK, triangle, allocate(0, 0)) if frames else tracked
    if rank < free:
        return None
    reduction = allocate(frames, rank - free + cone)
    return reduction if eliminate(matrix, cone_matrix, rank, triangle, reduction) == rank else None


def aligned(*shape: int) -> Array:
    """Zeros that start at a cache line, as working memory. NumPy's arrays start at any multiple of 16 bytes, so that in
    half of them vectorised loops read across cache lines.
    """
    memory = np.zeros(prod(shape) + CACHE_LINE // 8)
    start = -memory.ctypes.data % CACHE_LINE // 8
    return memory[start : start + prod(shape)].reshape(shape)


@compiled_for_python
def eliminate(matrix: Array, cone_matrix: Array, rank: int, triangle: Triangle, reduced: Reduction) -> int:
    """Fill the reduced rows of frames of this rank of A (frames, tracked, controls), with C (frames, k, controls).
    Returns the rank, or that of the first frame of another.

    The triangle has the rows of A and below them those of C; the columns of a, r, and the accelerations.
    """
    tracked, cone, free = matrix.shape[1], cone_matrix.shape[1], triangle.free.shape[1]
    weighted = len(reduced.columns) - free
    muscles = len(reduced.cost)
    for frame in range(len(matrix)):
        _fill_triangle(matrix[frame], cone_matrix[frame], reduced.columns, triangle)
        found = triangularise(triangle, weighted)
        if found != rank:
            return found
        for i in range(free):
            copy(triangle.others[i], reduced.free_per_effort[frame, i])
            copy(triangle.others[i, weighted:], reduced.free_per_acceleration[frame, i])
        for i in range(cone):  # rows of the cone follow the equalities, in place of those that no x reaches
            _eliminate_free(triangle, tracked + i, rank + i)
        lines = triangle.others[free : rank + cone]
        for i in range(len(lines)):
            copy(lines[i], reduced.rows[frame, i])
            copy(lines[i, weighted:], reduced.per_acceleration[frame, i])
        _fill_effort(lines, muscles, reduced.reserve_weights, reduced.reserves[frame], reduced.effort[frame])
    return rank


@compiled
def _fill_triangle(matrix: Array, cone_matrix: Array, order: NDArray[np.int64], triangle: Triangle) -> None:
    """A and the identity, and below it C and zeros, of a frame."""
    weighted = len(order) - triangle.free.shape[1]
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


class Triangle(NamedTuple):
    """A matrix in two parts: the columns of the free unknowns (rows, free), and the others (rows, width), with zeros up
    to a multiple of LANES. Only as many rows as the reflector has are reflected; sums (width,) is working memory.
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
