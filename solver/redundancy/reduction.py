"""Eliminate the unbounded unknowns of the redundancy problem: bounded activations a and a few multipliers v remain.

    minimise  Σ w aᵖ + Σ w r²   subject to   A x = b,   a within bounds,   C x + c in the cone,   x = (a, r, f)

A x = b is restricted to the range of A: with constraints on accelerations A has dependent rows, and the part of b that
no x produces is left out. f are the actuators without weight, r those with. Householder reflections,
first along the columns of f, then along the longest column that remains, make of A an upper triangle

    Qᵀ A = ( U  F )    f = U⁻¹ (Qᵀ b − F (a, r)) whatever a and r are: f drops out with its rows
           ( 0  G )    equalities of a and r alone, as many as G has rank
           ( 0  0 )    unreachable

and with f in its place the cone's rows become H (a, r) + h. The r of least effort are r = (M_r / 2w)ᵀ v, M = (G, H), so
that of M (a, r) there remains M a + R v with R = M_r (2w)⁻¹ M_rᵀ, the form of reduced_problem.py. In the
published problem a, r and f are 33, 9 and 8, and v has 6 + 3 entries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.dense import aligned, padded
from solver.frozen import read_only
from solver.multibody.rotations import each_frame
from solver.redundancy.elimination import ReducedRows, Unreduced, eliminate
from solver.redundancy.householder import Triangle
from solver.redundancy.reduced_problem import SequenceProblem

Array = NDArray[np.float64]
NO_RANK = -1


@dataclass(frozen=True, eq=False)
class Reduction:
    """The reduced problem of every frame, in m rows; the first `equalities` of them are G's, each scaled to length 1.

    cost                   q (muscles,)
    rank                   of A
    is_free                (controls,) which of x are f;  exponent p of the activations
    rows                   M (frames, m, muscles);  effort R (frames, m, m)
    per_acceleration       (frames, m, tracked): t = this times b, less c in the cone's rows
    reserves               (frames, r, m): r = this times v
    free_per_effort        U⁻¹ F (frames, f, a and r);  free_per_acceleration  U⁻¹ Qᵀ (frames, f, tracked)
    """

    equalities: int
    rank: int
    exponent: int
    cost: Array
    is_free: NDArray[np.bool_]
    rows: Array
    effort: Array
    per_acceleration: Array
    reserves: Array
    free_per_effort: Array
    free_per_acceleration: Array

    def problem(self, acceleration: Array, ray: Array, rise: Array, fall: Array, widest: Array) -> SequenceProblem:
        """The problems with b (scenarios, frames, tracked), c (scenarios, frames, k), and bounds."""
        t = each_frame(self.per_acceleration, acceleration)
        t[..., self.equalities :] -= ray
        return SequenceProblem(
            q=self.cost,
            M=self.rows,
            R=self.effort,
            t=np.ascontiguousarray(t),
            equalities=self.equalities,
            rise=rise,
            fall=fall,
            widest=widest,
            exponent=self.exponent,
        )

    def controls(self, a: Array, v: Array, acceleration: Array) -> Array:
        """x (scenarios, frames, controls) of a (scenarios, frames, muscles), v (scenarios, frames, m) and b."""
        effort = np.concatenate([a, each_frame(self.reserves, v)], axis=-1)
        controls = np.empty((*a.shape[:2], len(self.is_free)))
        controls[..., ~self.is_free] = effort
        controls[..., self.is_free] = each_frame(self.free_per_acceleration, acceleration) - each_frame(
            self.free_per_effort, effort
        )
        return controls


def reduce_frames(
    weights: Array, muscles: int, matrix: Array, cone_matrix: Array, exponent: int = 2, rank: int | None = None
) -> Reduction | None:
    """Reduce A (frames, tracked, controls) and C (frames, k, controls); weights w (controls,), muscles come first.

    None for another structure: a muscle without weight, free actuators that A leaves undetermined, or frames
    of different rank, or of another than the given one.
    """
    is_free = weights == 0
    (frames, tracked, controls), free, cone = matrix.shape, int(is_free.sum()), cone_matrix.shape[1]
    if is_free[:muscles].any() or free > tracked:
        return None
    unreduced = Unreduced(
        matrix=read_only(matrix),
        cone_matrix=read_only(cone_matrix),
        muscles=muscles,
        free=free,
        order=np.argsort(is_free, kind="stable"),
        weights=weights[~is_free][muscles:],
    )
    width = padded(controls - free + tracked)
    triangle = Triangle(
        free=np.empty((tracked + cone, free)),
        others=aligned(tracked + cone, width),
        reflector=np.empty(tracked),
        sums=aligned(width),
    )
    first = unreduced._replace(matrix=unreduced.matrix[:1])
    if rank is None:
        rank = eliminate(first, NO_RANK, triangle, _allocate(unreduced, 0, 0)) if frames else tracked
    if rank < free:
        return None
    reduced = _allocate(unreduced, frames, rank - free + cone)
    if eliminate(unreduced, rank, triangle, reduced) != rank:
        return None
    return Reduction(rank - free, rank, exponent, exponent * weights[:muscles], is_free, *reduced)


def _allocate(unreduced: Unreduced, frames: int, m: int) -> ReducedRows:
    """For m rows in each frame."""
    tracked, free, reserves = unreduced.matrix.shape[1], unreduced.free, len(unreduced.weights)
    return ReducedRows(
        rows=np.empty((frames, m, unreduced.muscles)),
        effort=np.empty((frames, m, m)),
        per_acceleration=np.empty((frames, m, tracked)),
        reserves=np.empty((frames, reserves, m)),
        free_per_effort=np.empty((frames, free, unreduced.muscles + reserves)),
        free_per_acceleration=np.empty((frames, free, tracked)),
    )
