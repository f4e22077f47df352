"""Solve the redundancy problem frame by frame; activation bounds follow from the activations of the previous frame.

    minimise  Σ w aᵖ + Σ w r²   subject to   A x = b,   lower ≤ a ≤ upper,   C x + c in the cone {(s, v): s ≥ |v|}

x = (activations a of the muscles, controls r of the actuators), p is 2 or 3. A x = b is restricted to the range of
A; the part of b that no x produces is left out. Bounds follow first-order activation dynamics with the pace 0.5 + 1.5 a
(Thelen 2003).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.redundancy.conic import ConicOutcome, ConicProblem, least_violation, solve_conic
from solver.redundancy.reduced_problem import (
    BEYOND_RATE,
    INFEASIBLE,
    NOT_CONVERGED,
    SOLVED,
    Codes,
    SequenceSolution,
    WarmStart,
)

if TYPE_CHECKING:
    from solver.redundancy.reduction import Reduction

Array = NDArray[np.float64]
Outcomes = NDArray[np.object_]
Progress = Callable[[int, int], None]
RunSolver = Callable[["FrameSequence", Progress, "int | None"], tuple[Array, Outcomes]]

RANK_TOLERANCE = 1e-9
FRAMES_AT_ONCE = 100  # between two reports of progress; their reduced rows stay in the cache
PROCESSORS = os.cpu_count() or 1


class FrameOutcome(StrEnum):
    """Outcome of a frame; everything but SOLVED is counted and shown.

    BEYOND_ACTIVATION_RATE  activations cannot change fast enough since the previous frame; solved without that limit
    INFEASIBLE              no activations between 0 and 1 and controls within their limits give the accelerations and
                            keep the joint reaction inside the glenoid; the point of least violation is given
    NOT_CONVERGED           the solver stopped before its residuals were small; its last point is given
    NOT_FINITE              the model has no finite accelerations in this posture, or a muscle with an elastic tendon no
                            finite force; the frame is left out
    """

    SOLVED = "solved"
    BEYOND_ACTIVATION_RATE = "beyond_activation_rate"
    INFEASIBLE = "infeasible"
    NOT_CONVERGED = "not_converged"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True, eq=False)
class FrameSequence:
    """The problems of all frames of all scenarios. Scenarios have A, C and w in common, b and c their own.

    weights     w (controls,);  matrix A (frames, tracked, controls);  target b (scenarios, frames, tracked)
    cone_matrix C (frames, k, controls);  cone_offset c (scenarios, frames, k); k = 3, or 0 where there is no cone;
                both scaled so that 1e-8 is small
    rise, fall  (muscles,) interval between frames over the time constants of activation and deactivation; infinite
                for muscles without activation dynamics
    limits      (2, actuators) least and greatest control, infinite without a limit; None for no limits
    exponent    p of the activations
    activation_limits  (2, muscles) least and greatest activation; None for 0 and 1
    """

    weights: Array
    matrix: Array
    target: Array
    cone_matrix: Array
    cone_offset: Array
    rise: Array
    fall: Array
    limits: Array | None = None
    exponent: int = 2
    activation_limits: Array | None = None

    @property
    def widest_activations(self) -> Array:
        """(2, muscles)."""
        if self.activation_limits is not None:
            return self.activation_limits
        return np.repeat([[0.0], [1.0]], len(self.rise), axis=1)

    @property
    def has_limits(self) -> bool:
        """Whether an actuator has a limit."""
        return self.limits is not None and bool(np.isfinite(self.limits).any())

    def cut(self, frames: slice) -> FrameSequence:
        """These frames alone."""
        return replace(
            self,
            matrix=self.matrix[frames],
            target=self.target[:, frames],
            cone_matrix=self.cone_matrix[frames],
            cone_offset=self.cone_offset[:, frames],
        )


def solve_runs(
    solve_run: RunSolver, sequence: FrameSequence, is_finite: NDArray[np.bool_], progress: Progress, workers: int | None
) -> tuple[Array, Outcomes]:
    """x and outcomes of solve_run in each run of finite frames; the others are left out: NaN, NOT_FINITE.

    After such a frame activations start anywhere in their range, as after any frame that is not solved.
    """
    if is_finite.all():
        return solve_run(sequence, progress, workers)
    scenarios, frames = sequence.target.shape[:2]
    controls = np.full((scenarios, frames, len(sequence.weights)), np.nan)
    outcomes = np.empty((scenarios, frames), dtype=object)
    outcomes.fill(FrameOutcome.NOT_FINITE)  # np.full would leave plain strings
    edges = np.flatnonzero(np.diff(is_finite, prepend=False, append=False))
    for start, end in edges.reshape(-1, 2).tolist():
        run, count = slice(start, end), partial(_count_from, progress, start, frames)
        controls[:, run], outcomes[:, run] = solve_run(sequence.cut(run), count, workers)
    return controls, outcomes


def solve_sequence(sequence: FrameSequence, progress: Progress, workers: int | None = None) -> tuple[Array, Outcomes]:
    """x (scenarios, frames, controls) and outcomes; x is the point of least violation where INFEASIBLE.

    By the compiled solver, or by Clarabel if the problem does not have the structure that reduction.py needs, as with
    actuators that are limited on one side.
    """
    if sequence.has_limits:
        return _solve_limited(sequence, progress, workers)
    sequence = replace(sequence, weights=determined(sequence.weights, sequence.matrix, sequence.cone_matrix))
    scenarios, frames = sequence.target.shape[:2]
    controls = np.empty((scenarios, frames, len(sequence.weights)))
    codes = np.empty((scenarios, frames), dtype=np.int8)
    workers = min(scenarios, workers or PROCESSORS)
    solver = BlockSolver(workers)
    progress(0, frames)
    with ThreadPoolExecutor(workers) as pool:
        spread = pool.map if workers > 1 else map  # a single scenario needs no thread
        for start in range(0, frames, FRAMES_AT_ONCE):
            block = slice(start, min(start + FRAMES_AT_ONCE, frames))
            if not solver.solve(sequence.cut(block), controls[:, block], codes[:, block], spread):
                return solve_sequence_with_clarabel(sequence, progress)
            progress(block.stop, frames)
    outcomes: Outcomes = OUTCOME_OF_CODE[codes]
    return controls, outcomes


class BlockSolver:
    """The compiled solver for consecutive blocks of a sequence: each starts from the solutions of the block before.

    Scenarios are divided among workers, each with its warm start.
    """

    def __init__(self, workers: int = 1) -> None:
        self._shares = [_Share(slice(i, None, workers)) for i in range(workers)]
        self._rank: int | None = None

    def solve(self, block: FrameSequence, controls: Array, codes: Codes, spread: Callable[..., Iterable[None]]) -> bool:
        """Fill x (scenarios, frames, controls) and codes (scenarios, frames); `spread` maps over the workers.

        False if the block does not have the structure that reduction.py needs, or that of the blocks before.
        """
        from solver.redundancy.reduction import reduce_frames  # the compiler behind it takes long to import

        reduction = reduce_frames(
            block.weights, len(block.rise), block.matrix, block.cone_matrix, block.exponent, self._rank
        )
        if reduction is None:
            return False
        self._rank = reduction.rank
        list(spread(lambda share: share.solve(block, reduction, controls, codes), self._shares))
        return True


def solve_sequence_with_clarabel(
    sequence: FrameSequence,
    progress: Progress,
    workers: int | None = None,  # noqa: ARG001 (it uses one thread)
) -> tuple[Array, Outcomes]:
    """solve_sequence by Clarabel, frame by frame: the reference, slower by two orders of magnitude."""
    scenarios, frames = sequence.target.shape[:2]
    controls = np.empty((scenarios, frames, len(sequence.weights)))
    outcomes = np.empty((scenarios, frames), dtype=object)
    bounds = widest_bounds(sequence, scenarios)
    progress(0, frames)
    for frame in range(frames):
        controls[:, frame], outcomes[:, frame] = solve_frame_with_clarabel(sequence, frame, bounds)
        bounds = reachable_bounds(sequence, controls[:, frame], outcomes[:, frame])
        progress(frame + 1, frames)
    return controls, outcomes


def solve_frame_with_clarabel(
    sequence: FrameSequence, frame: int, bounds: tuple[Array, Array]
) -> tuple[Array, Outcomes]:
    """x (scenarios, controls) and outcomes (scenarios,) within bounds, lower and upper (scenarios, controls)."""
    rows, to_rows = _reachable_rows(sequence.matrix[frame])
    problem = ConicProblem(
        weights=determined(sequence.weights, sequence.matrix[[frame]], sequence.cone_matrix[[frame]]),
        equality_matrix=rows,
        equality_target=sequence.target[:, frame] @ to_rows.T,
        lower=bounds[0],
        upper=bounds[1],
        cone_matrix=sequence.cone_matrix[frame],
        cone_offset=sequence.cone_offset[:, frame],
        cubed=len(sequence.rise) if sequence.exponent == 3 else 0,
    )
    return _solve_frame(problem, widest_bounds(sequence, len(sequence.target)))


def with_bounded_actuators(sequence: FrameSequence) -> tuple[FrameSequence, NDArray[np.int64]] | None:
    """The sequence without limits: actuators that have two are bounded as activations without dynamics, and follow the
    muscles in the order (controls,) of its controls. None where only Clarabel solves it.

    The effort of an activation has the exponent of all, that of a control is a square: with cubes Clarabel solves.
    """
    muscles, limits = len(sequence.rise), np.asarray(sequence.limits)
    is_limited = np.isfinite(limits)
    is_bounded = is_limited.all(axis=0)
    is_fit = is_bounded & (limits[0] < limits[1]) | ~is_limited.any(axis=0)
    if sequence.exponent != 2 or not is_fit.all():
        return None
    actuators = muscles + np.concatenate([np.flatnonzero(is_bounded), np.flatnonzero(~is_bounded)])
    order = np.concatenate([np.arange(muscles), actuators])
    without_dynamics = np.full(int(is_bounded.sum()), np.inf)
    ordered = replace(
        sequence,
        weights=sequence.weights[order],
        matrix=sequence.matrix[:, :, order],
        cone_matrix=sequence.cone_matrix[:, :, order],
        rise=np.concatenate([sequence.rise, without_dynamics]),
        fall=np.concatenate([sequence.fall, without_dynamics]),
        limits=None,
        activation_limits=np.concatenate([sequence.widest_activations, limits[:, is_bounded]], axis=1),
    )
    return ordered, order


def _solve_limited(sequence: FrameSequence, progress: Progress, workers: int | None) -> tuple[Array, Outcomes]:
    bounded = with_bounded_actuators(sequence)
    if bounded is None:
        return solve_sequence_with_clarabel(sequence, progress)
    ordered, order = bounded
    found, outcomes = solve_sequence(ordered, progress, workers)
    controls = np.empty_like(found)
    controls[..., order] = found
    return controls, outcomes


class _Share:
    """The scenarios of one worker and their warm start."""

    def __init__(self, scenarios: slice) -> None:
        self._scenarios = scenarios
        self._start: WarmStart | None = None

    def solve(self, block: FrameSequence, reduction: Reduction, controls: Array, codes: Codes) -> None:
        from solver.redundancy.frames import solve_activations
        from solver.redundancy.interior_point import allocate_frame

        b, c, widest = block.target[self._scenarios], block.cone_offset[self._scenarios], block.widest_activations
        problem = reduction.problem(b, c, block.rise, block.fall, widest)
        muscles, (scenarios, frames, rows) = len(problem.q), problem.t.shape
        if self._start is None:
            self._start = WarmStart(np.tile(widest, (scenarios, 1, 1)), np.zeros((scenarios, rows)))
        solution = SequenceSolution(
            a=np.empty((scenarios, frames, muscles)),
            v=np.empty((scenarios, frames, rows)),
            codes=np.empty((scenarios, frames), np.int8),
        )
        solve_activations(problem, self._start, allocate_frame(muscles, rows), solution)
        codes[self._scenarios] = solution.codes
        controls[self._scenarios] = reduction.controls(solution.a, solution.v, b)


OUTCOME_OF_CODE = np.empty(4, dtype=object)
OUTCOME_OF_CODE[[SOLVED, INFEASIBLE, NOT_CONVERGED, BEYOND_RATE]] = [
    FrameOutcome.SOLVED,
    FrameOutcome.INFEASIBLE,
    FrameOutcome.NOT_CONVERGED,
    FrameOutcome.BEYOND_ACTIVATION_RATE,
]


def _count_from(progress: Progress, start: int, frames: int, done: int, _: int) -> None:
    progress(start + done, frames)


def determined(weights: Array, matrix: Array, cone_matrix: Array) -> Array:
    """w, but 1 for a control without effect in these frames: without a weight its value would be undetermined."""
    is_moving = matrix[:1].any(axis=(0, 1)) | cone_matrix[:1].any(axis=(0, 1))
    if not is_moving.all():  # in the first frame, as usual
        is_moving = matrix.any(axis=(0, 1)) | cone_matrix.any(axis=(0, 1))
    return np.where(is_moving, weights, np.maximum(weights, 1.0))


def _reachable_rows(matrix: Array) -> tuple[Array, Array]:
    """With A = U S Vᵀ (rows, controls), Vᵀ (rank, controls) and S⁻¹ Uᵀ (rank, rows): A x = b is Vᵀ x = S⁻¹ Uᵀ b."""
    left, sizes, right = np.linalg.svd(matrix, full_matrices=False)
    rank = int((sizes > RANK_TOLERANCE * sizes[0]).sum())
    return right[:rank], (left[:, :rank] / sizes[:rank]).T


def widest_bounds(sequence: FrameSequence, scenarios: int) -> tuple[Array, Array]:
    muscles, controls = len(sequence.rise), len(sequence.weights)
    lower, upper = np.full((scenarios, controls), -np.inf), np.full((scenarios, controls), np.inf)
    lower[:, :muscles], upper[:, :muscles] = sequence.widest_activations
    if sequence.limits is not None:
        lower[:, muscles:], upper[:, muscles:] = sequence.limits
    return lower, upper


def reachable_bounds(sequence: FrameSequence, controls: Array, outcomes: Outcomes) -> tuple[Array, Array]:
    """Bounds of activations after one interval at full or no excitation; the widest after an unsolved frame."""
    lower, upper = widest_bounds(sequence, len(controls))
    muscles, (least, greatest) = len(sequence.rise), sequence.widest_activations
    a = controls[:, :muscles].clip(0, 1)
    pace = 0.5 + 1.5 * a
    is_known = np.array([outcome in _KNOWN for outcome in outcomes])[:, None]
    with np.errstate(invalid="ignore"):  # infinity times zero, of a muscle without activation dynamics, is no limit
        slowest, fastest = a - sequence.fall * a * pace, a + sequence.rise * (1 - a) / pace
    lower[:, :muscles] = np.where(is_known, np.fmax(slowest, least), least)
    upper[:, :muscles] = np.where(is_known, np.fmin(fastest, greatest), greatest)
    return lower, upper


_KNOWN = {FrameOutcome.SOLVED, FrameOutcome.BEYOND_ACTIVATION_RATE}


def _solve_frame(problem: ConicProblem, widest: tuple[Array, Array]) -> tuple[Array, Outcomes]:
    """Solve a frame; if only the activation rate makes it infeasible, solve without that limit and record it."""
    solution = solve_conic(problem)
    controls, outcomes = solution.x, np.array([_FRAME_OUTCOME[outcome] for outcome in solution.outcomes], dtype=object)
    infeasible = np.flatnonzero(outcomes == FrameOutcome.INFEASIBLE)
    if not len(infeasible):
        return controls, outcomes
    unlimited = replace(
        problem,
        equality_target=problem.equality_target[infeasible],
        lower=widest[0][infeasible],
        upper=widest[1][infeasible],
        cone_offset=problem.cone_offset[infeasible],
    )
    again = solve_conic(unlimited)
    controls[infeasible] = again.x
    for i, outcome in zip(infeasible, again.outcomes, strict=True):
        is_solved = outcome is ConicOutcome.SOLVED
        outcomes[i] = FrameOutcome.BEYOND_ACTIVATION_RATE if is_solved else _FRAME_OUTCOME[outcome]
    remaining = np.flatnonzero(outcomes == FrameOutcome.INFEASIBLE)
    if len(remaining):
        found = controls[infeasible]
        controls[infeasible] = np.where(np.isnan(found), least_violation(unlimited), found)
    return controls, outcomes


_FRAME_OUTCOME = {
    ConicOutcome.SOLVED: FrameOutcome.SOLVED,
    ConicOutcome.INFEASIBLE: FrameOutcome.INFEASIBLE,
    ConicOutcome.NOT_CONVERGED: FrameOutcome.NOT_CONVERGED,
}

SOLVERS: Mapping[str, RunSolver] = {"interior_point": solve_sequence, "clarabel": solve_sequence_with_clarabel}
"""By the name of RedundancyOptions.solver."""
