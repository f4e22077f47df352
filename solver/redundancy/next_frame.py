"""The redundancy problem frame by frame, as the frames come: each starts from the activations of the frame before.

The result is that of solve_redundancy over the same frames. After a gap the bounds of the activations grow with the
true interval; after a frame without a solution they are 0 and 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.redundancy.problem import LoadResponse, RedundancyProblem, ScenarioSolutions, solve_redundancy
from solver.redundancy.reduced_problem import BEYOND_RATE, SOLVED, SequenceSolution, WarmStart
from solver.redundancy.sequence import (
    OUTCOME_OF_CODE,
    FrameOutcome,
    FrameSequence,
    Outcomes,
    Progress,
    determined,
    solve_frame_with_clarabel,
    widest_bounds,
    with_bounded_actuators,
)

Array = NDArray[np.float64]

LONGEST = 10.0
"""s; after which every activation between 0 and 1 can be reached."""


class FrameByFrame:
    """Activations of the last solved frame of every scenario, and the solver's guess for the next one."""

    def __init__(self, scenarios: int, muscles: int) -> None:
        self._activations = np.zeros((scenarios, muscles))
        self._time = np.full(scenarios, -np.inf)
        self._now = -np.inf
        self._multipliers = np.zeros((scenarios, 0))

    def solve(self, problem: RedundancyProblem, loads: LoadResponse | None = None) -> ScenarioSolutions:
        """Solve a problem of one frame, at its time [s], later than that of the frame before, for all scenarios."""
        self._now = float(problem.time[0])
        solve_run = self._solve_with_clarabel if problem.solver == "clarabel" else self._solve
        self._time_constants = problem.time_constants
        return solve_redundancy(problem, loads, workers=1, solve_run=solve_run)

    def forget(self, scenario: int) -> None:
        """Start a scenario anew: its activations may be anything in the next frame."""
        self._time[scenario] = -np.inf

    def _solve(self, sequence: FrameSequence, progress: Progress, workers: int | None) -> tuple[Array, Outcomes]:
        from solver.redundancy.frames import solve_activations  # the compiler behind it takes long to import
        from solver.redundancy.interior_point import allocate_frame
        from solver.redundancy.reduction import reduce_frames

        given, muscles, order = sequence, len(sequence.rise), np.arange(len(sequence.weights))
        if sequence.has_limits:
            bounded = with_bounded_actuators(sequence)
            if bounded is None:
                return self._solve_with_clarabel(sequence, progress, workers)
            sequence, order = bounded
        weights = determined(sequence.weights, sequence.matrix, sequence.cone_matrix)
        unknowns = len(sequence.rise)  # activations, then actuators with limits
        reduction = reduce_frames(weights, unknowns, sequence.matrix, sequence.cone_matrix, sequence.exponent)
        if reduction is None:
            return self._solve_with_clarabel(given, progress, workers)
        scenarios, rows = len(sequence.target), reduction.rows.shape[1]
        if self._multipliers.shape[1] != rows:
            self._multipliers = np.zeros((scenarios, rows))
        widest = sequence.widest_activations
        reduced = reduction.problem(sequence.target, sequence.cone_offset, sequence.rise, sequence.fall, widest)
        bounds = np.tile(widest, (scenarios, 1, 1))
        bounds[:, :, :muscles] = np.stack(self._bounds(), axis=1)
        start = WarmStart(bounds, self._multipliers)
        solution = SequenceSolution(
            a=np.empty((scenarios, 1, unknowns)),
            v=np.empty((scenarios, 1, rows)),
            codes=np.empty((scenarios, 1), np.int8),
        )
        solve_activations(reduced, start, allocate_frame(unknowns, rows), solution)
        self._keep(solution.a[:, 0, :muscles], (solution.codes[:, 0] == SOLVED) | (solution.codes[:, 0] == BEYOND_RATE))
        outcomes: Outcomes = OUTCOME_OF_CODE[solution.codes]
        controls = np.empty((scenarios, 1, len(order)))
        controls[..., order] = reduction.controls(solution.a, solution.v, sequence.target)
        return controls, outcomes

    def _solve_with_clarabel(
        self,
        sequence: FrameSequence,
        progress: Progress,  # noqa: ARG002 (one frame)
        workers: int | None,  # noqa: ARG002 (it uses one thread)
    ) -> tuple[Array, Outcomes]:
        lower, upper = widest_bounds(sequence, len(sequence.target))
        muscles = len(sequence.rise)
        lower[:, :muscles], upper[:, :muscles] = self._bounds()
        controls, outcomes = solve_frame_with_clarabel(sequence, 0, (lower, upper))
        is_known = (outcomes == FrameOutcome.SOLVED) | (outcomes == FrameOutcome.BEYOND_ACTIVATION_RATE)
        self._keep(controls[:, :muscles], is_known)
        return controls[:, None], outcomes[:, None]

    def _bounds(self) -> tuple[Array, Array]:
        """Activations (scenarios, muscles) that no and full excitation lead to by now (Thelen 2003)."""
        since = np.minimum(self._now - self._time, LONGEST)[:, None]
        a, (activation, deactivation) = self._activations.clip(0, 1), self._time_constants
        pace = 0.5 + 1.5 * a
        with np.errstate(divide="ignore", invalid="ignore"):  # a time constant of 0 is no limit
            lower = np.fmax(a - since / deactivation * a * pace, 0.0)
            upper = np.fmin(a + since / activation * (1 - a) / pace, 1.0)
        is_known = np.isfinite(self._time)[:, None]
        return np.where(is_known, lower, 0.0), np.where(is_known, upper, 1.0)

    def _keep(self, activations: Array, is_known: NDArray[np.bool_]) -> None:
        self._activations = np.where(is_known[:, None], activations, 0.0)
        self._time = np.where(is_known, self._now, -np.inf)
