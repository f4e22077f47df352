"""Frames whose effort or muscle forces are not those of the compiled solver: a quadratic program at a point, and a
sequence of them.

At activations a₀ the forces F of elastic tendons (elastic.py) and the effort Σ w φ(a) of an ActivationCost (effort.py)
are replaced by their linear and quadratic models,

    minimise  ½ Σ h (a − a₀)² + g (a − a₀) + Σ w r²,   g = w φ',   h = w φ'' − (Mᵀ v) F'',   v the multipliers before

which has the form of problem.py in a − (a₀ − g / h). Its solution is the next a₀ (sequential quadratic
programming; Nocedal and Wright, Numerical Optimization, 2006, chapter 18). With rigid tendons the problem is convex and
its points stay within all constraints along a step, so that a step is shortened until the effort falls, and the
iteration ends at the least effort.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from solver.errors import SolverCode
from solver.model import Array, ModelError
from solver.redundancy.conic import solve_frame_with_clarabel
from solver.redundancy.effort import Effort
from solver.redundancy.frames import solve_frames
from solver.redundancy.problem import (
    OUTCOME_OF_CODE,
    ActivationRates,
    FrameOutcome,
    Outcomes,
    RedundancyProblem,
    WarmStart,
)
from solver.redundancy.reduction import Reduction, reduce_frames

LEAST_CURVATURE = 0.25  # h over w φ'': of a force that grows with the activation faster than in proportion
FIRST_GUESS = 0.1
ITERATIONS = 60
STEP_GOAL = 1e-8  # of an activation
EFFORT_GOAL = 1e-15  # of the effort, between its value and the least one of the quadratic program
SUFFICIENT = 1e-4  # share of the expected decrease that a step must have
SHORTEST_STEP = 1e-6
ROUND_OFF = 1e-12  # of the effort; a smaller decrease cannot be seen in it
UNSOLVED = (FrameOutcome.INFEASIBLE, FrameOutcome.NOT_CONVERGED)


class ForcePoint(NamedTuple):
    """Activations a₀, their forces F, F' and F'' over the greatest isometric ones; all (muscles,)."""

    activations: Array
    force: Array
    gain: Array
    curvature: Array

    @property
    def force_at_rest(self) -> Array:
        """The linear force at no activation."""
        return np.asarray(self.force - self.gain * self.activations)


class FrameStep(NamedTuple):
    """Activations (muscles,) of the linear problem, its x (controls,) with forces in their place, and its outcome."""

    activations: Array
    forces: Array
    outcome: FrameOutcome


@dataclass(frozen=True, eq=False)
class ReducedFrame:
    """A frame for the compiled solver.

    target  t (m,) of the reduced problem;  multipliers (m,) of the last solution, where the next one starts
    """

    problem: RedundancyProblem
    effort: Effort
    reduction: Reduction
    target: Array
    multipliers: Array

    def solve(self, point: ForcePoint, bounds: Array) -> FrameStep:
        """Solve the problem linearised at a point, within bounds (2, muscles)."""
        muscles, reduction, unknowns = len(point.gain), self.reduction, self.problem.muscles
        rows = reduction.rows[0].copy()
        target = self.target - rows[:, :muscles] @ point.force_at_rest
        cost, shift, scale = reduction.cost.copy(), np.zeros(unknowns), 1.0
        if self.effort.has_quadratic_steps:
            slope, curvature = self.effort.slopes(point.activations), self.effort.curvatures(point.activations)
            bent = curvature - (self.multipliers @ rows[:, :muscles]) * point.curvature
            h = np.maximum(bent, LEAST_CURVATURE * curvature)
            shift[:muscles] = point.activations - slope / h
            cost[:muscles] = h
            if self.effort.cost is not None:
                scale = 0.5 * h.mean()
        rows[:, :muscles] *= point.gain
        widest = self.problem.widest_activations - shift
        allowed = widest.copy()
        allowed[:, :muscles] = bounds - shift[:muscles]
        unlimited = np.full(unknowns, np.inf)
        start = WarmStart(allowed[None], self.multipliers[None] / scale)
        quadratic = reduction._replace(cost=cost / scale, rows=rows[None], effort=reduction.effort * scale)
        rates = ActivationRates(unlimited, unlimited, widest)
        found = solve_frames(quadratic, (target - rows @ shift)[None, None], rates, start)
        self.multipliers[:] = scale * start.multipliers[0]
        a = found.a[0, 0] + shift
        activations = a[:muscles].clip(*self.problem.widest_activations[:, :muscles])
        a[:muscles] = point.force_at_rest + point.gain * activations
        forces = reduction.x(a[None, None], scale * found.v, self.problem.target)[0, 0]
        return FrameStep(activations, forces, OUTCOME_OF_CODE[found.codes[0, 0]])


@dataclass(frozen=True, eq=False)
class ClarabelFrame:
    """A frame for Clarabel: the reference, and problems that the compiled solver cannot reduce."""

    problem: RedundancyProblem
    multipliers: Array

    def solve(self, point: ForcePoint, bounds: Array) -> FrameStep:
        """As ReducedFrame.solve; the curvature is neglected."""
        problem, muscles = self.problem, len(point.gain)
        scale, offset = np.ones(len(problem.weights)), np.zeros(len(problem.weights))
        scale[:muscles], offset[:muscles] = point.gain, point.force_at_rest
        linear = replace(
            problem,
            matrix=problem.matrix * scale,
            target=problem.target - problem.matrix @ offset,
            reaction_matrix=problem.reaction_matrix * scale,
            reaction_at_rest=problem.reaction_at_rest + problem.reaction_matrix @ offset,
        )
        controls, outcomes = solve_frame_with_clarabel(linear, bounds[None])
        activations = controls[0, :muscles].clip(0.0, 1.0)
        return FrameStep(activations, offset + scale * np.r_[activations, controls[0, muscles:]], outcomes[0])


def reduced_frame(problem: RedundancyProblem, multipliers: Array) -> ReducedFrame | None:
    """A problem of one frame and scenario whose first controls are muscle forces; None where it cannot be reduced.

    multipliers are those of the frame before, or of another length without one.
    """
    reducible = problem.reducible()
    reduction = None if reducible is None else reduce_frames(reducible)
    if reducible is None or reduction is None:
        return None
    muscles, rows = problem.muscles, reduction.rows.shape[1]
    weights = np.concatenate([reducible.weights[:muscles], problem.weights[muscles:]])
    guess = multipliers if len(multipliers) == rows else np.zeros(rows)
    target = reduction.targets(problem.target, problem.cone_offset)[0, 0]
    return ReducedFrame(reducible, replace(problem.effort, weights=weights), reduction, target, guess)


class ConvexFrames:
    """Frames with an ActivationCost, each from the solution of the frame before."""

    def __init__(self, scenarios: int) -> None:
        self._guesses = [np.zeros(0)] * scenarios
        self._multipliers = [np.zeros(0)] * scenarios

    def solve(self, problem: RedundancyProblem, bounds: Array) -> tuple[Array, Outcomes]:
        """x (scenarios, controls) and outcomes (scenarios,) of a problem of one frame, with activations within bounds
        (scenarios, 2, muscles).

        Raises ModelError for a problem that only Clarabel solves: it has no other costs than powers.
        """
        found = [self._solve(problem.scenario(i), i, within) for i, within in enumerate(bounds)]
        outcomes = np.array([step.outcome for step in found], dtype=object)
        return np.array([step.forces for step in found]), outcomes

    def _solve(self, problem: RedundancyProblem, scenario: int, bounds: Array) -> FrameStep:
        frame = reduced_frame(problem, self._multipliers[scenario])
        if frame is None:
            raise ModelError(
                "a cost function of activations needs muscles with weights above 0, actuators with two limits or none, "
                "and free actuators that the motion determines, and the problem has others; change weights or limits",
                SolverCode.UNSUPPORTED,
            )
        muscles, guess = problem.muscles, self._guesses[scenario]
        guess = guess if len(guess) == muscles else np.full(muscles, FIRST_GUESS)
        found = _least_effort(frame, guess.clip(*bounds), bounds)
        self._guesses[scenario], self._multipliers[scenario] = found.activations, frame.multipliers
        return found


def _least_effort(frame: ReducedFrame, guess: Array, bounds: Array) -> FrameStep:
    """Solve quadratic programs from a guess (muscles,), which need not satisfy the constraints."""
    effort, muscles = frame.effort, len(guess)
    a, x, value = guess, np.zeros(0), np.inf
    for _ in range(ITERATIONS):
        curvature = effort.curvatures(a)
        found = frame.solve(ForcePoint(a, a, np.ones(muscles), np.zeros(muscles)), bounds)
        if found.outcome in UNSOLVED:
            return found
        change = found.activations - a
        decrease = float(curvature @ change**2)
        if np.abs(change).max() <= STEP_GOAL or decrease <= EFFORT_GOAL * value < np.inf:
            return found
        x, value = _shortened(effort, x, value, found.forces, decrease)
        a = x[:muscles].clip(*bounds)
    return found._replace(outcome=FrameOutcome.NOT_CONVERGED)


def _shortened(effort: Effort, x: Array, value: float, end: Array, decrease: float) -> tuple[Array, float]:
    """The point on the way from x, with this effort, to the end at which the effort has fallen enough, and its effort.
    Without an x it is the end.
    """
    ahead, share = float(effort.terms(end).sum()), 1.0
    if decrease <= ROUND_OFF * value < np.inf:
        return end, ahead
    while ahead > value - SUFFICIENT * share * decrease and share > SHORTEST_STEP:
        share *= 0.5
        ahead = float(effort.terms(x + share * (end - x)).sum())
    return (end if share == 1.0 else x + share * (end - x)), ahead
