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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.multibody.rotations import each_frame
from solver.redundancy.householder import triangularise
from solver.redundancy.problem import SequenceProblem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reduction:
    """The reduced problem of every frame, in m rows; the first `equalities` of them are G's, each scaled to length 1.

    cost                   q (muscles,)
    is_free                (controls,) which of x are f;  exponent p of the activations
    rows                   M (frames, m, muscles);  effort R (frames, m, m)
    per_acceleration       (frames, m, tracked): t = this times b, less c in the cone's rows
    reserves               (frames, r, m): r = this times v
    free_per_effort        U⁻¹ F (frames, f, a and r);  free_per_acceleration  U⁻¹ Qᵀ (frames, f, tracked)
    """

    equalities: int
    exponent: int
    cost: Array
    is_free: NDArray[np.bool_]
    rows: Array
    effort: Array
    per_acceleration: Array
    reserves: Array
    free_per_effort: Array
    free_per_acceleration: Array

    def problem(self, frames: slice, acceleration: Array, ray: Array, rise: Array, fall: Array) -> SequenceProblem:
        """The problems of these frames with b (scenarios, frames, tracked), c (scenarios, frames, k), rise and fall."""
        t = each_frame(self.per_acceleration[frames], acceleration)
        t[..., self.equalities :] -= ray
        return SequenceProblem(
            q=self.cost,
            M=self.rows[frames],
            R=self.effort[frames],
            t=np.ascontiguousarray(t),
            equalities=self.equalities,
            rise=rise,
            fall=fall,
            exponent=self.exponent,
        )

    def controls(self, frames: slice, a: Array, v: Array, acceleration: Array) -> Array:
        """x (scenarios, frames, controls) of a (scenarios, frames, muscles), v (scenarios, frames, m) and b."""
        effort = np.concatenate([a, each_frame(self.reserves[frames], v)], axis=-1)
        controls = np.empty((*a.shape[:2], len(self.is_free)))
        controls[..., ~self.is_free] = effort
        controls[..., self.is_free] = each_frame(self.free_per_acceleration[frames], acceleration) - each_frame(
            self.free_per_effort[frames], effort
        )
        return controls


def reduce_frames(
    weights: Array, muscles: int, matrix: Array, cone_matrix: Array, exponent: int = 2
) -> Reduction | None:
    """Reduce A (frames, tracked, controls) and C (frames, k, controls); weights w (controls,), muscles come first.

    None for another structure: a muscle without weight, free actuators that A leaves undetermined, or frames
    of different rank.
    """
    is_free = weights == 0
    tracked, free, weighted = matrix.shape[1], int(is_free.sum()), int((~is_free).sum())
    if is_free[:muscles].any() or free > tracked:
        return None
    triangles = np.empty((len(matrix), tracked, free + weighted + tracked))
    triangles[:, :, :free], triangles[:, :, free:-tracked] = matrix[:, :, is_free], matrix[:, :, ~is_free]
    triangles[:, :, -tracked:] = np.eye(tracked)
    ranks = set(triangularise(triangles, free, weighted).tolist())
    rank = min(ranks, default=tracked)
    if rank < free or len(ranks) > 1:
        return None
    F, of_acceleration = triangles[:, :free, free:-tracked], triangles[:, :free, -tracked:]
    equalities = triangles[:, free:rank, free:]
    on_free = cone_matrix[:, :, is_free]
    M = np.concatenate([equalities[:, :, :weighted], cone_matrix[:, :, ~is_free] - on_free @ F], axis=1)
    reserves = np.swapaxes(M[:, :, muscles:], 1, 2) / (2 * weights[~is_free][muscles:, None])
    return Reduction(
        equalities=rank - free,
        exponent=exponent,
        cost=exponent * weights[:muscles],
        is_free=is_free,
        rows=np.ascontiguousarray(M[:, :, :muscles]),
        effort=M[:, :, muscles:] @ reserves,
        per_acceleration=np.concatenate([equalities[:, :, weighted:], -on_free @ of_acceleration], axis=1),
        reserves=reserves,
        free_per_effort=F,
        free_per_acceleration=of_acceleration,
    )
