"""Solve the redundancy problem of all frames and scenarios: in blocks of a motion, or frame by frame as they come.

Frames are solved in order, because bounds of the activations follow from those of the frame before. The solution of
frames as they come (FrameByFrame) is that of solve_redundancy over the same frames. After a gap the bounds grow with
the true interval; after a frame without a solution they are the widest.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.multibody.postures import each_frame
from solver.redundancy.conic import solve_frame_with_clarabel
from solver.redundancy.problem import (
    OUTCOME_OF_CODE,
    Codes,
    FrameOutcome,
    LoadResponse,
    Outcomes,
    RedundancyProblem,
    WarmStart,
    are_solved,
    column_squares,
)

if TYPE_CHECKING:
    from solver.redundancy.convex_frames import ConvexFrames

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]
SolveFrame = Callable[[RedundancyProblem, Array], tuple[Array, Outcomes]]
RunSolver = Callable[[RedundancyProblem, Progress, "int | None"], tuple[Array, Outcomes]]

FRAMES_AT_ONCE = 100  # between two reports of progress; their reduced rows stay in the cache
SOLUTIONS_AT_ONCE = 16384  # scenarios × frames of which a worker finds residuals and reactions
UNMET_LIMIT = 1e-6  # of 1 + |b|, in rad/s² or m/s²
PROCESSORS = os.cpu_count() or 1
LONGEST = 10.0
"""s; after which every activation between 0 and 1 can be reached."""


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
    replaces the problem's solver, as for a single frame that starts from the frame before (FrameByFrame).
    """
    is_finite, problem = problem.is_finite, problem.with_loads(loads) if loads else problem
    controls, outcomes = solve_runs(solve_run or SOLVERS[problem.solver], problem, is_finite, progress, workers)
    muscles = controls[..., : problem.muscles]
    muscles.clip(*problem.widest_activations, out=muscles)
    return scenario_solutions(problem, controls, outcomes, min(len(outcomes), workers or PROCESSORS))


class FrameByFrame:
    """Activations of the last solved frame of every scenario, and the solver's guess for the next one."""

    def __init__(self, scenarios: int, muscles: int) -> None:
        self._activations = np.zeros((scenarios, muscles))
        self._time = np.full(scenarios, -np.inf)
        self._blocks = BlockSolver()
        self._convex: ConvexFrames | None = None

    def solve(self, problem: RedundancyProblem, loads: LoadResponse | None = None) -> ScenarioSolutions:
        """Solve a problem of one frame, at its time [s], later than that of the frame before, for all scenarios."""
        return solve_redundancy(problem, loads, workers=1, solve_run=lambda one, *_: self._solve(one))

    def forget(self, scenario: int) -> None:
        """Start a scenario anew: its activations may be anything in the next frame."""
        self._time[scenario] = -np.inf

    def _solve(self, problem: RedundancyProblem) -> tuple[Array, Outcomes]:
        now, solve = float(problem.time[0]), self._solve_compiled
        interval = np.minimum(now - self._time, LONGEST)[:, None]
        bounds = problem.reachable(self._activations, np.isfinite(self._time), interval)
        if problem.solver == "clarabel":
            solve = solve_frame_with_clarabel
        elif problem.cost is not None:
            self._convex = self._convex or _convex_frames(len(bounds))
            solve = self._convex.solve
        controls, outcomes = solve(problem, bounds)
        is_known = are_solved(outcomes)
        self._activations = np.where(is_known[:, None], controls[:, : problem.muscles], 0.0)
        self._time = np.where(is_known, now, -np.inf)
        return controls[:, None], outcomes[:, None]

    def _solve_compiled(self, problem: RedundancyProblem, bounds: Array) -> tuple[Array, Outcomes]:
        for blocks in (self._blocks, BlockSolver()):  # a new one where the structure is not that of the frame before
            found = blocks.solve(problem, bounds)
            if found is not None:
                self._blocks = blocks
                return found[0][:, 0], found[1][:, 0]
        return solve_frame_with_clarabel(problem, bounds)


def solve_runs(
    solve_run: RunSolver,
    problem: RedundancyProblem,
    is_finite: NDArray[np.bool_],
    progress: Progress,
    workers: int | None = None,
) -> tuple[Array, Outcomes]:
    """x and outcomes of solve_run in each run of finite frames; the others are left out: NaN, NOT_FINITE.

    After such a frame activations start anywhere in their range, as after any frame that is not solved.
    """
    if is_finite.all():
        return solve_run(problem, progress, workers)
    scenarios, frames = problem.target.shape[:2]
    controls = np.full((scenarios, frames, len(problem.weights)), np.nan)
    outcomes = np.empty((scenarios, frames), dtype=object)
    outcomes.fill(FrameOutcome.NOT_FINITE)  # np.full would leave plain strings
    edges = np.flatnonzero(np.diff(is_finite, prepend=False, append=False))
    for start, end in edges.reshape(-1, 2).tolist():
        run, count = slice(start, end), partial(_count_from, progress, start, frames)
        controls[:, run], outcomes[:, run] = solve_run(problem.cut(run), count, workers)
    return controls, outcomes


def solve_sequence(
    problem: RedundancyProblem, progress: Progress, workers: int | None = None
) -> tuple[Array, Outcomes]:
    """x (scenarios, frames, controls) and outcomes; x is the point of least violation where INFEASIBLE.

    By the compiled solver, or by Clarabel if the problem does not have the structure that it needs (reducible above,
    reduce_frames in reduction.py).
    """
    if problem.cost is not None:
        return solve_in_turn(problem, _convex_frames(len(problem.target)).solve, progress)
    reducible = problem.reducible()
    if reducible is None:
        return solve_sequence_with_clarabel(problem, progress)
    scenarios, frames = problem.target.shape[:2]
    controls = np.empty((scenarios, frames, len(problem.weights)))
    codes = np.empty((scenarios, frames), dtype=np.int8)
    workers = min(scenarios, workers or PROCESSORS)
    solver = BlockSolver(workers)
    progress(0, frames)
    with ThreadPoolExecutor(workers) as pool:
        spread = pool.map if workers > 1 else map  # a single scenario needs no thread
        for start in range(0, frames, FRAMES_AT_ONCE):
            block = slice(start, min(start + FRAMES_AT_ONCE, frames))
            if not solver.fill(reducible.cut(block), controls[:, block], codes[:, block], spread):
                return solve_sequence_with_clarabel(problem, progress)
            progress(block.stop, frames)
    outcomes: Outcomes = OUTCOME_OF_CODE[codes]
    return controls, outcomes


class BlockSolver:
    """The compiled solver for consecutive blocks of a sequence: each starts from the solutions of the block before.

    Scenarios are divided among workers, each with its warm start.
    """

    def __init__(self, workers: int = 1) -> None:
        self._shares = [slice(i, None, workers) for i in range(workers)]
        self._starts: list[WarmStart] = []
        self._first: tuple[Array, int] | None = None

    def solve(self, problem: RedundancyProblem, bounds: Array | None = None) -> tuple[Array, Outcomes] | None:
        """x (scenarios, frames, controls) and outcomes of a block; None where fill returns False, or it is not
        reducible.
        """
        reducible, shape = problem.reducible(), problem.target.shape[:2]
        controls, codes = np.empty((*shape, len(problem.weights))), np.empty(shape, dtype=np.int8)
        if reducible is None or not self.fill(reducible, controls, codes, bounds=bounds):
            return None
        return controls, OUTCOME_OF_CODE[codes]

    def fill(
        self,
        block: RedundancyProblem,
        controls: Array,
        codes: Codes,
        spread: Callable[..., Iterable[None]] = map,
        bounds: Array | None = None,
    ) -> bool:
        """Fill x (scenarios, frames, controls) and codes (scenarios, frames) of a reducible block; `spread` maps over
        the workers. False if the block does not have the structure that reduction.py needs, or that of those before.

        bounds (scenarios, 2, muscles) replace those of the first frame that follow from the block before.
        """
        from solver.redundancy.frames import solve_frames  # the compiler behind them takes long to import
        from solver.redundancy.reduction import reduce_frames

        weights, rank = self._first or (block.weights, None)
        reduction = reduce_frames(block, rank) if np.array_equal(block.weights, weights) else None
        if reduction is None:
            return False
        if self._first is None:  # anywhere within the widest bounds, without a guess of the multipliers
            self._first, rows = (weights, reduction.rank), reduction.rows.shape[1]
            sizes = [len(block.target[share]) for share in self._shares]
            self._starts = [
                WarmStart(np.tile(block.rates.widest, (size, 1, 1)), np.zeros((size, rows))) for size in sizes
            ]

        def fill_share(share: slice, start: WarmStart) -> None:
            part = block.scenario(share)
            if bounds is not None:
                start.bounds[:, :, : bounds.shape[2]] = bounds[share]
            solution = solve_frames(reduction, reduction.targets(part.target, part.cone_offset), part.rates, start)
            controls[share], codes[share] = reduction.x(solution.a, solution.v, part.target), solution.codes

        list(spread(fill_share, self._shares, self._starts))
        return True


def solve_sequence_with_clarabel(
    problem: RedundancyProblem,
    progress: Progress,
    workers: int | None = None,  # noqa: ARG001 (it uses one thread)
) -> tuple[Array, Outcomes]:
    """solve_sequence by Clarabel: the reference, slower by two orders of magnitude."""
    return solve_in_turn(problem, solve_frame_with_clarabel, progress)


def solve_in_turn(problem: RedundancyProblem, solve: SolveFrame, progress: Progress) -> tuple[Array, Outcomes]:
    """x (scenarios, frames, controls) and outcomes, frame by frame, all scenarios of a frame at once."""
    scenarios, frames = problem.target.shape[:2]
    controls = np.empty((scenarios, frames, len(problem.weights)))
    outcomes = np.empty((scenarios, frames), dtype=object)
    bounds = np.tile(problem.widest_activations, (scenarios, 1, 1))
    progress(0, frames)
    for frame in range(frames):
        controls[:, frame], outcomes[:, frame] = solve(problem.cut(slice(frame, frame + 1)), bounds)
        bounds = problem.reachable(controls[:, frame, : problem.muscles], are_solved(outcomes[:, frame]))
        progress(frame + 1, frames)
    return controls, outcomes


def _convex_frames(scenarios: int) -> ConvexFrames:
    from solver.redundancy.convex_frames import ConvexFrames  # the compiler behind it takes long to import

    return ConvexFrames(scenarios)


def _count_from(progress: Progress, start: int, frames: int, done: int, _: int) -> None:
    progress(start + done, frames)


SOLVERS: Mapping[str, RunSolver] = {"interior_point": solve_sequence, "clarabel": solve_sequence_with_clarabel}
"""By the name of RedundancyOptions.solver."""


def scenario_solutions(
    problem: RedundancyProblem, controls: Array, outcomes: Outcomes, workers: int = 1
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
    fill = partial(_fill_frames, problem, solutions)
    if workers <= 1:
        for part in parts:
            fill(part)
    else:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(fill, parts))
    return solutions


def _fill_frames(problem: RedundancyProblem, solutions: ScenarioSolutions, part: slice) -> None:
    controls, outcomes = solutions.controls[:, part], solutions.outcomes[:, part]
    matrix, target = problem.matrix[part], problem.target[:, part]
    size, residual = np.linalg.norm(target, axis=-1), each_frame(matrix, controls)
    residual -= target
    reaction = problem.reaction_at_rest[:, part] + each_frame(problem.reaction_matrix[part], controls)
    ray = each_frame(problem.cone[part], reaction[..., 3:])
    has_cone = problem.cone.shape[1] > 0
    solutions.reaction[:, part] = reaction
    solutions.cone_slack[:, part] = ray[..., 0] - np.hypot(ray[..., 1], ray[..., 2]) if has_cone else np.inf
    controls[outcomes == FrameOutcome.INFEASIBLE] = np.nan
    outcomes[are_solved(outcomes) & ~meets_accelerations(matrix, residual, size)] = FrameOutcome.NOT_CONVERGED
    greatest = np.abs(residual, out=residual).argmax(axis=-1)
    missed = np.take_along_axis(residual, greatest[..., None], axis=-1)[..., 0]
    solutions.equality_residual[:, part] = missed
    solutions.residual_coordinate[:, part] = np.flatnonzero(problem.tracked)[greatest]


def meets_accelerations(matrix: Array, residual: Array, size: Array) -> NDArray[np.bool_]:
    """(scenarios, frames) whether no x reduces the residual A x − b (scenarios, frames, rows); size is |b|."""
    lengths = np.sqrt(column_squares(matrix))
    shares = 1.0 / np.where(lengths > 0, lengths, 1.0)
    unmet = np.empty(residual.shape[:2])
    for start in range(0, len(matrix), FRAMES_AT_ONCE):
        part = slice(start, start + FRAMES_AT_ONCE)
        products = np.swapaxes(matrix[part], 1, 2) @ residual[:, part].transpose(1, 2, 0)
        products *= shares[part, :, None]
        unmet[:, part] = np.abs(products, out=products).max(axis=1, initial=0.0).T
    return np.asarray(unmet <= UNMET_LIMIT * (1.0 + size))
