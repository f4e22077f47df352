"""Scenarios of a motion that differ in their loads: what the loads change, and the solutions."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from solver.multibody.rotations import each_frame
from solver.redundancy.problem import RedundancyProblem
from solver.redundancy.reachability import is_met
from solver.redundancy.sequence import PROCESSORS, SOLVERS, FrameOutcome, FrameSequence, Outcomes, RunSolver, solve_runs

Array = NDArray[np.float64]
SOLUTIONS_AT_ONCE = 16384  # scenarios × frames of which a worker finds residuals and reactions
CONE_FORCE_SCALE = 1e3  # N; brings the cone's rows to the size of activations


@dataclass(frozen=True, eq=False)
class LoadResponse:
    """Changes by additional loads at x = 0, per scenario and frame.

    acceleration  (scenarios, frames, coordinates) [rad/s², m/s²]
    reaction      (scenarios, frames, 6) moment [N m], force [N] on the scapula in ground
    """

    acceleration: Array
    reaction: Array


@dataclass(frozen=True, eq=False)
class ScenarioSolutions:
    """x (scenarios, frames, controls), NaN where infeasible or not finite, with outcomes and residuals.

    In INFEASIBLE frames residual, reaction and slack are those of the point of least violation, in NOT_FINITE ones NaN.

    outcomes           (scenarios, frames) of FrameOutcome
    equality_residual  (scenarios, frames) largest |A x − b| [rad/s² or m/s²], the unreachable part included
    residual_coordinate  (scenarios, frames) index of the coordinate whose acceleration it is
    reaction           (scenarios, frames, 6) moment [N m], force [N] on the scapula in ground
    cone_slack         (scenarios, frames) s − |v| [N], negative outside; infinite without the glenoid
    """

    controls: Array
    outcomes: NDArray[np.object_]
    equality_residual: Array
    residual_coordinate: NDArray[np.intp]
    reaction: Array
    cone_slack: Array


def solve_redundancy(
    problem: RedundancyProblem,
    loads: LoadResponse | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
    workers: int | None = None,
    solve_run: RunSolver | None = None,
) -> ScenarioSolutions:
    """Solve all frames in order, scenarios independently; progress(done, total) counts frames.

    Scenarios are divided among workers (threads), by default as many as processors; Clarabel uses one. solve_run
    replaces the problem's solver, as for a single frame that starts from the frame before (next_frame.py).
    """
    loads = loads or no_loads(problem)
    sequence = frame_sequence(problem, loads)
    solve_run = solve_run or SOLVERS[problem.solver]
    controls, outcomes = solve_runs(solve_run, sequence, problem.is_finite, progress, workers)
    muscles = controls[..., : len(sequence.rise)]
    muscles.clip(*sequence.widest_activations, out=muscles)
    return scenario_solutions(problem, loads, controls, outcomes, min(len(outcomes), workers or PROCESSORS))


def no_loads(problem: RedundancyProblem) -> LoadResponse:
    """One scenario without additional loads."""
    frames, coordinates = len(problem.time), len(problem.tracked)
    return LoadResponse(np.zeros((1, frames, coordinates)), np.zeros((1, frames, 6)))


def frame_sequence(problem: RedundancyProblem, loads: LoadResponse) -> FrameSequence:
    """The problems of all frames and scenarios as the solvers take them."""
    cone = problem.cone / CONE_FORCE_SCALE
    rise, fall = unlimited = np.full(problem.time_constants.shape, np.inf)
    if problem.has_activation_dynamics:
        is_limited = problem.time_constants > 0.0
        rise, fall = np.divide(problem.interval, problem.time_constants, out=unlimited, where=is_limited)
    return FrameSequence(
        weights=problem.weights,
        matrix=problem.acceleration_matrix,
        target=problem.acceleration_target - loads.acceleration[..., problem.tracked],
        cone_matrix=cone @ problem.reaction_matrix[:, 3:],
        cone_offset=each_frame(cone, (problem.reaction_at_rest + loads.reaction)[..., 3:]),
        rise=rise,
        fall=fall,
        limits=problem.control_limits,
        exponent=problem.exponent,
        activation_limits=problem.activation_limits,
    )


def scenario_solutions(
    problem: RedundancyProblem, loads: LoadResponse, controls: Array, outcomes: Outcomes, workers: int = 1
) -> ScenarioSolutions:
    """Reaction and residuals of x (scenarios, frames, controls) with their outcomes, which are set here: x becomes NaN
    where INFEASIBLE, and the outcome NOT_CONVERGED where x should produce the accelerations and does not.

    Frames are divided among workers (threads), a few at a time, so that what is needed meanwhile takes little memory.
    """
    shape = scenarios, frames = outcomes.shape
    missed, coordinates = np.empty(shape), np.empty(shape, np.intp)
    solutions = ScenarioSolutions(controls, outcomes, missed, coordinates, np.empty((*shape, 6)), np.empty(shape))
    step = max(1, min(SOLUTIONS_AT_ONCE // max(1, scenarios), math.ceil(frames / max(1, workers))))
    parts = [slice(start, start + step) for start in range(0, frames, step)]
    fill = partial(_fill_frames, problem, loads, solutions)
    if workers <= 1:
        for part in parts:
            fill(part)
    else:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(fill, parts))
    return solutions


def _fill_frames(problem: RedundancyProblem, loads: LoadResponse, solutions: ScenarioSolutions, part: slice) -> None:
    controls, outcomes = solutions.controls[:, part], solutions.outcomes[:, part]
    matrix, reaction_matrix = problem.acceleration_matrix[part], problem.reaction_matrix[part]
    target = problem.acceleration_target[part] - loads.acceleration[:, part, problem.tracked]
    size = np.linalg.norm(target, axis=-1)
    residual = np.subtract(each_frame(matrix, controls), target, out=target)
    reaction = problem.reaction_at_rest[part] + loads.reaction[:, part] + each_frame(reaction_matrix, controls)
    ray = each_frame(problem.cone[part], reaction[..., 3:])
    has_cone = problem.cone.shape[1] > 0
    solutions.reaction[:, part] = reaction
    solutions.cone_slack[:, part] = ray[..., 0] - np.hypot(ray[..., 1], ray[..., 2]) if has_cone else np.inf
    controls[outcomes == FrameOutcome.INFEASIBLE] = np.nan
    is_claimed = (outcomes == FrameOutcome.SOLVED) | (outcomes == FrameOutcome.BEYOND_ACTIVATION_RATE)
    outcomes[is_claimed & ~is_met(matrix, residual, size)] = FrameOutcome.NOT_CONVERGED
    greatest = np.abs(residual, out=residual).argmax(axis=-1)
    missed = np.take_along_axis(residual, greatest[..., None], axis=-1)[..., 0]
    solutions.equality_residual[:, part] = missed
    solutions.residual_coordinate[:, part] = np.flatnonzero(problem.tracked)[greatest]
