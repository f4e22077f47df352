"""The problem of one frame with forces that are functions F(a) of the activations: linearise it and solve it.

The matrices per force do not change with the activations. They are reduced once in a frame, and F(a₀) + F'(a₀) (a − a₀)
only scales columns of the reduced problem. Its effort is that of the activations plus the curvature of F, so that the
steps converge fast (sequential quadratic programming; Nocedal and Wright, Numerical Optimization, 2006, chapter 18):

    minimise  ½ Σ h (a − a₀)² + q a₀ a,   h = q − (Mᵀ v) F'',   v the multipliers before

which has the form of reduced_problem.py in a − (1 − q / h) a₀. With cubes of the activations F'' is neglected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.redundancy.frames import solve_frames
from solver.redundancy.reduced_problem import SequenceProblem, SequenceSolution, WarmStart
from solver.redundancy.reduction import Reduction, reduce_frames
from solver.redundancy.sequence import (
    OUTCOME_OF_CODE,
    FrameOutcome,
    FrameSequence,
    determined,
    solve_frame_with_clarabel,
    widest_bounds,
    with_bounded_actuators,
)
from solver.redundancy.workspace import FrameWorkspace, allocate_frame

Array = NDArray[np.float64]
LEAST_CURVATURE = 0.25  # h over q: of a force that grows with the activation faster than in proportion


class ForcePoint(NamedTuple):
    """Activations a₀, their forces F, F' and F'' over the greatest isometric ones; all (muscles,)."""

    activations: Array
    force: Array
    gain: Array
    curvature: Array

    @property
    def force_at_rest(self) -> Array:
        """The linear force at no activation."""
        rest: Array = self.force - self.gain * self.activations
        return rest


class FrameStep(NamedTuple):
    """Activations (muscles,) of the linear problem, its x (controls,) with forces in their place, and its outcome."""

    activations: Array
    forces: Array
    outcome: FrameOutcome


@dataclass(frozen=True, eq=False)
class ReducedFrame:
    """A frame for the compiled solver.

    sequence  with actuators that have two limits behind the muscles;  order (controls,) of its controls
    target    t (m,) of the reduced problem;  multipliers (m,) of the last solution, where the next one starts
    """

    sequence: FrameSequence
    order: NDArray[np.int64]
    reduction: Reduction
    target: Array
    multipliers: Array
    work: FrameWorkspace

    def solve(self, point: ForcePoint, bounds: Array) -> FrameStep:
        """Solve the problem linearised at a point, within bounds (2, muscles)."""
        muscles, reduction, rise = len(point.gain), self.reduction, self.sequence.rise
        rows = reduction.rows[0].copy()
        target = self.target - rows[:, :muscles] @ point.force_at_rest
        cost, shift = reduction.cost.copy(), np.zeros(len(rise))
        if reduction.exponent == 2:
            bent = cost[:muscles] - (self.multipliers @ rows[:, :muscles]) * point.curvature
            h = np.maximum(bent, LEAST_CURVATURE * cost[:muscles])
            shift[:muscles] = (1.0 - cost[:muscles] / h) * point.activations
            cost[:muscles] = h
        rows[:, :muscles] *= point.gain
        widest = self.sequence.widest_activations - shift
        allowed = widest.copy()
        allowed[:, :muscles] = bounds - shift[:muscles]
        unlimited = np.full(len(rise), np.inf)
        problem = SequenceProblem(
            cost,
            rows[None],
            reduction.effort,
            (target - rows @ shift)[None, None],
            reduction.equalities,
            unlimited,
            unlimited,
            widest,
            reduction.exponent,
        )
        solution = SequenceSolution(np.empty((1, 1, len(rise))), np.empty((1, 1, len(rows))), np.empty((1, 1), np.int8))
        solve_frames(problem, WarmStart(allowed[None], self.multipliers[None]), self.work, solution)
        unknowns = solution.a[0, 0] + shift
        activations = unknowns[:muscles].clip(0.0, 1.0)
        unknowns[:muscles] = point.force_at_rest + point.gain * activations
        forces = np.empty(len(self.order))
        forces[self.order] = reduction.controls(unknowns[None, None], solution.v, self.sequence.target)[0, 0]
        return FrameStep(activations, forces, OUTCOME_OF_CODE[solution.codes[0, 0]])


@dataclass(frozen=True, eq=False)
class ClarabelFrame:
    """A frame for Clarabel: the reference, and what the compiled solver cannot reduce."""

    sequence: FrameSequence
    multipliers: Array

    def solve(self, point: ForcePoint, bounds: Array) -> FrameStep:
        """As ReducedFrame.solve; the curvature is neglected."""
        sequence, muscles = self.sequence, len(point.gain)
        scale, offset = np.ones(len(sequence.weights)), np.zeros(len(sequence.weights))
        scale[:muscles], offset[:muscles] = point.gain, point.force_at_rest
        linear = replace(
            sequence,
            matrix=sequence.matrix * scale,
            target=sequence.target - sequence.matrix @ offset,
            cone_matrix=sequence.cone_matrix * scale,
            cone_offset=sequence.cone_offset + sequence.cone_matrix @ offset,
        )
        lower, upper = widest_bounds(linear, 1)
        lower[0, :muscles], upper[0, :muscles] = bounds
        controls, outcomes = solve_frame_with_clarabel(linear, 0, (lower, upper))
        activations = controls[0, :muscles].clip(0.0, 1.0)
        return FrameStep(activations, offset + scale * np.r_[activations, controls[0, muscles:]], outcomes[0])


def force_frame(
    sequence: FrameSequence, multipliers: Array, *, is_reference: bool = False
) -> ReducedFrame | ClarabelFrame:
    """The problem of a sequence of one frame and scenario whose first controls are muscle forces.

    multipliers  of the frame before, or of another length without one;  is_reference  for Clarabel in any case
    """
    weights = determined(sequence.weights, sequence.matrix, sequence.cone_matrix)
    given = replace(sequence, weights=weights)
    bounded = with_bounded_actuators(given) if sequence.has_limits else (given, np.arange(len(weights)))
    if is_reference or bounded is None:
        return ClarabelFrame(given, multipliers)
    ordered, order = bounded
    unknowns = len(ordered.rise)
    reduction = reduce_frames(ordered.weights, unknowns, ordered.matrix, ordered.cone_matrix, ordered.exponent)
    if reduction is None:
        return ClarabelFrame(given, multipliers)
    rows = reduction.rows.shape[1]
    guess = multipliers if len(multipliers) == rows else np.zeros(rows)
    target = np.einsum("ij,j->i", reduction.per_acceleration[0], ordered.target[0, 0])
    target[reduction.equalities :] -= ordered.cone_offset[0, 0]
    return ReducedFrame(ordered, order, reduction, target, guess, allocate_frame(unknowns, rows))
