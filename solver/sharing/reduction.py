"""The redundancy problem with what is unbounded eliminated: bounded activations a and few multipliers v are left.

    minimise  Σ w x²   subject to   A x = b,   a within bounds,   C x + c in the cone,   x = (a, r, f)

A x = b is meant in the space that A reaches: where constraints bind accelerations, A has fewer independent rows than
rows, and what no x can reach is left out. f are the actuators without weight, r those with. Householder reflections,
first along the columns of f, then along the longest column that remains, make of A an upper triangle

    Qᵀ A = ( U  F )    f = U⁻¹ (Qᵀ b − F (a, r)) whatever a and r are: f drops out with its rows
           ( 0  G )    equalities of a and r alone, as many as G has rank
           ( 0  0 )    unreachable

and with f in its place the cone's rows become H (a, r) + h. The r that cost least are r = (M_r / 2w)ᵀ v, M = (G, H), so
that of M (a, r) there remains M a + R v with R = M_r (2w)⁻¹ M_rᵀ, which is the form of newton.py. In the
published problem a, r and f are 33, 9 and 8, and v has 6 + 3 entries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-9  # of the longest column


@dataclass(frozen=True, eq=False)
class Reduction:
    """The reduced problem of every frame, in m rows; the first `equalities` of them are G's, each scaled to length 1.

    is_free                (controls,) which of x are f
    rows                   M (frames, m, muscles);  effort R (frames, m, m)
    per_acceleration       (frames, m, tracked): t = this times b, less c in the cone's rows
    reserves               (frames, r, m): r = this times v
    free_per_effort        U⁻¹ F (frames, f, a and r);  free_per_acceleration  U⁻¹ Qᵀ (frames, f, tracked)
    """

    equalities: int
    is_free: NDArray[np.bool_]
    rows: Array
    effort: Array
    per_acceleration: Array
    reserves: Array
    free_per_effort: Array
    free_per_acceleration: Array

    def targets(self, frames: slice, acceleration: Array, ray: Array) -> Array:
        """t (scenarios, frames, m) of b (scenarios, frames, tracked) and c (scenarios, frames, k)."""
        targets = each_frame(self.per_acceleration[frames], acceleration)
        targets[..., self.equalities :] -= ray
        return targets

    def controls(self, frames: slice, a: Array, v: Array, acceleration: Array) -> Array:
        """x (scenarios, frames, controls) of a (scenarios, frames, muscles), v (scenarios, frames, m) and b."""
        effort = np.concatenate([a, each_frame(self.reserves[frames], v)], axis=-1)
        controls = np.empty((*a.shape[:2], len(self.is_free)))
        controls[..., ~self.is_free] = effort
        controls[..., self.is_free] = each_frame(self.free_per_acceleration[frames], acceleration) - each_frame(
            self.free_per_effort[frames], effort
        )
        return controls


def reduce_frames(weights: Array, muscles: int, matrix: Array, cone_matrix: Array) -> Reduction | None:
    """Reduce A (frames, tracked, controls) and C (frames, k, controls); weights w (controls,), muscles come first.

    None where the structure is another: a muscle without weight, or free actuators that A leaves undetermined.
    """
    is_free = weights == 0
    tracked, free, weighted = matrix.shape[1], int(is_free.sum()), int((~is_free).sum())
    if is_free[:muscles].any() or free > tracked:
        return None
    identity = np.broadcast_to(np.eye(tracked), (len(matrix), tracked, tracked))
    triangle = np.concatenate([matrix[:, :, is_free], matrix[:, :, ~is_free], identity], axis=2)
    rank = int(triangularise(triangle, free, weighted).min(initial=tracked))
    if rank < free:
        return None
    solved = np.linalg.solve(triangle[:, :free, :free], triangle[:, :free, free:])
    F, of_acceleration = solved[:, :, :weighted], solved[:, :, weighted:]
    equalities = triangle[:, free:rank, free:]
    equalities /= np.linalg.norm(equalities[:, :, :weighted], axis=2, keepdims=True)
    on_free = cone_matrix[:, :, is_free]
    M = np.concatenate([equalities[:, :, :weighted], cone_matrix[:, :, ~is_free] - on_free @ F], axis=1)
    reserves = np.swapaxes(M[:, :, muscles:], 1, 2) / (2 * weights[~is_free][muscles:, None])
    return Reduction(
        equalities=rank - free,
        is_free=is_free,
        rows=np.ascontiguousarray(M[:, :, :muscles]),
        effort=M[:, :, muscles:] @ reserves,
        per_acceleration=np.concatenate([equalities[:, :, weighted:], -on_free @ of_acceleration], axis=1),
        reserves=reserves,
        free_per_effort=F,
        free_per_acceleration=of_acceleration,
    )


def each_frame(matrix: Array, values: Array) -> Array:
    """The product of each frame's matrix (frames, i, j) with its values (scenarios, frames, j)."""
    product: Array = np.moveaxis(matrix @ np.moveaxis(values, 0, 2), 2, 0)
    return product


@compiled_for_python
def triangularise(triangle: Array, free: int, weighted: int) -> NDArray[np.int64]:
    """Reflect each frame's rows in place; returns the ranks (frames,), less than `free` where f is undetermined."""
    ranks = np.empty(len(triangle), np.int64)
    mirror, shadow = np.empty(triangle.shape[1]), np.empty(triangle.shape[2])
    for frame in range(len(triangle)):
        rows = triangle[frame]
        longest = 0.0
        for j in range(free + weighted):
            longest = max(longest, _length(rows, 0, j))
        rank = 0
        while rank < len(rows):
            column = rank if rank < free else _longest_column(rows, rank, free, free + weighted)
            if not _length(rows, rank, column) > RANK_TOLERANCE * longest:
                break
            _reflect(rows, rank, column, mirror, shadow)
            rank += 1
        ranks[frame] = rank
    return ranks


@compiled
def _longest_column(rows: Array, first: int, start: int, end: int) -> int:
    best, longest = start, -1.0
    for j in range(start, end):
        length = _length(rows, first, j)
        if length > longest:
            best, longest = j, length
    return best


@compiled
def _length(rows: Array, first: int, column: int) -> float:
    square = 0.0
    for i in range(first, len(rows)):
        square += rows[i, column] ** 2
    return float(np.sqrt(square))


@compiled
def _reflect(rows: Array, first: int, column: int, mirror: Array, shadow: Array) -> None:
    """Householder: the column's part from row `first` on becomes its length there and zero below."""
    length = _length(rows, first, column)
    for i in range(first, len(rows)):
        mirror[i] = rows[i, column]
    mirror[first] += length if mirror[first] >= 0.0 else -length
    square = 0.0
    shadow[:] = 0.0
    for i in range(first, len(rows)):
        square += mirror[i] * mirror[i]
        for j in range(len(shadow)):
            shadow[j] += mirror[i] * rows[i, j]
    for i in range(first, len(rows)):
        factor = 2.0 * mirror[i] / square
        for j in range(len(shadow)):
            rows[i, j] -= factor * shadow[j]
