"""The muscle-redundancy problem: load sharing among the muscles, frame by frame (Belli et al. 2023, "RMR").

With x = (activations a of the muscles, controls r of the actuators), in each frame

    minimise  Σ w aᵖ + Σ w r²   subject to   A x = q̈ − q̈₀,   lower ≤ x ≤ upper,   F₀ + A_F x in the glenoid's cone

with p = 2; q̈₀ and F₀ are accelerations and glenohumeral reaction at x = 0. The effort is (10), the constraints are
(11) of the source study (docs/architecture.md). Bounds follow the activation dynamics from one frame to the next. A has
rank 14 in 17 rows: the acromioclavicular constraint determines three combinations of accelerations, which no muscle
changes. The projection of q̈ − q̈₀ onto the column space of A is satisfied; the rest is reported per frame as the
equality residual.

With A x = b in each frame, b splits into its projection onto the column space of A, which a solution satisfies, and a
rest that no x produces. The residual of a solution is orthogonal to all columns of A, or a control could reduce it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Model, ModelError
from solver.multibody.rotations import each_frame
from solver.redundancy.glenoid import cone_rows, glenoid_cone
from solver.redundancy.mechanics import Mechanics
from solver.redundancy.redundancy_options import (
    Exponent,
    RedundancyOptions,
    Solver,
    activation_limits,
    effort_weights,
    tracked_coordinates,
)
from solver.redundancy.sequence import PROCESSORS, SOLVERS, FrameOutcome, FrameSequence, Outcomes, RunSolver, solve_runs

Array = NDArray[np.float64]
SOLUTIONS_AT_ONCE = 16384  # scenarios × frames of which a worker finds residuals and reactions
CONE_FORCE_SCALE = 1e3  # N; brings the cone's rows to the size of activations
ROUND_OFF = 1e-9  # of the frame's longest column
UNMET_LIMIT = 1e-6  # of 1 + |b|, in rad/s² or m/s²
FRAMES_AT_ONCE = 100  # bounds the memory of many scenarios


@dataclass(frozen=True, eq=False)
class RedundancyProblem:
    """The matrices of every frame; loads and bounds are left open, so one problem serves many scenarios.

    time            (frames,) [s];  interval [s] over which activations may change
    weights         (controls,);  reserves come after the muscles
    time_constants  (2, muscles) of activation and deactivation [s]; 0 without activation dynamics
    acceleration_matrix  A (frames, tracked, controls);  acceleration_target  q̈ − q̈₀ (frames, tracked) [rad/s², m/s²]
    tracked         (coordinates,) whether the acceleration is tracked: not of free ones, nor where a lock or a coupler
                    determines it
    reaction_matrix A_F (frames, 6, controls);  reaction_at_rest  F₀ (frames, 6) moment [N m], force [N] in ground
    cone            (frames, k, 3) rows that turn the force into (s, v); k = 3, or 0 without the glenoid
    solver, exponent  as in RedundancyOptions
    control_limits  (2, actuators) least and greatest control; None is no limits
    has_activation_dynamics  False where every frame is solved by itself
    activation_limits  (2, muscles) least and greatest activation; None is 0 and 1
    """

    time: Array
    interval: float
    weights: Array
    time_constants: Array
    acceleration_matrix: Array
    acceleration_target: Array
    tracked: NDArray[np.bool_]
    reaction_matrix: Array
    reaction_at_rest: Array
    cone: Array
    solver: Solver = "interior_point"
    control_limits: Array | None = None
    exponent: Exponent = 2
    has_activation_dynamics: bool = True
    activation_limits: Array | None = None

    def effort_of(self, controls: Array) -> Array:
        """Terms of the effort of x (…, controls), or of its muscles alone: w aᵖ, then w r² of the actuators; (10)."""
        terms: Array = self.weights[: controls.shape[-1]] * controls**2
        if self.exponent == 3:
            muscles = self.time_constants.shape[1]
            terms[..., :muscles] *= controls[..., :muscles]
        return terms

    @property
    def is_finite(self) -> NDArray[np.bool_]:
        """(frames,) False where the model has no finite accelerations, and nothing is solved."""
        known = np.concatenate([self.acceleration_target, self.reaction_at_rest], axis=-1)
        is_finite: NDArray[np.bool_] = np.isfinite(known).all(axis=-1)
        return is_finite


def build_redundancy(model: Model, mechanics: Mechanics, options: RedundancyOptions) -> RedundancyProblem:
    """Build the problem of all frames, without loads. ModelError for a model without muscles, or for unknown names.

    Columns of an actuator that are round-off, as on a locked coordinate, are set to zero; its control is 0 there.
    """
    if not model.muscles:
        raise ModelError(f"the model {model.name} should have muscles and has none; use another", SolverCode.NO_MUSCLES)
    kinematics, maps = mechanics.kinematics, mechanics.maps
    tracked = tracked_coordinates(model, options)
    matrix, reaction_matrix = maps.acceleration_per_control, maps.reaction_per_control
    if not tracked.all():  # else not a copy
        matrix = matrix[:, tracked]
    is_idle = idle_controls(matrix, reaction_matrix)
    is_idle[:, : len(model.muscles)] = False
    if is_idle.any():
        matrix, reaction_matrix = (np.where(is_idle[:, None], 0.0, part) for part in (matrix, reaction_matrix))
    cone = np.zeros((len(kinematics.time), 0, 3))
    if options.has_glenoid_cone:
        glenoid = glenoid_cone(model, options.glenoid_aspect, options.joint)
        cone = cone_rows(glenoid, mechanics.state.rotation_to_ground[:, glenoid.body])
    return RedundancyProblem(
        time=kinematics.time,
        interval=kinematics.interval,
        weights=effort_weights(model, options),
        time_constants=np.array(
            [
                [muscle.activation_time_constant for muscle in model.muscles],
                [muscle.deactivation_time_constant for muscle in model.muscles],
            ]
        ),
        acceleration_matrix=matrix,
        acceleration_target=(kinematics.accelerations - maps.acceleration_at_rest)[:, tracked],
        tracked=tracked,
        reaction_matrix=reaction_matrix,
        reaction_at_rest=maps.reaction_at_rest,
        cone=cone,
        solver=options.solver,
        control_limits=np.array([[actuator.min_control, actuator.max_control] for actuator in model.actuators])
        .reshape(-1, 2)
        .T,
        exponent=options.exponent,
        has_activation_dynamics=options.has_activation_dynamics,
        activation_limits=activation_limits(model) if options.has_muscle_limits else None,
    )


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


def idle_controls(matrix: Array, reaction_matrix: Array) -> NDArray[np.bool_]:
    """(frames, controls) whose columns of A (frames, rows, controls) and of the reaction's A_F are round-off.

    The actuator of a locked coordinate is one: the lock takes its force.
    """
    is_idle: NDArray[np.bool_] = np.logical_and(*(_is_round_off(part) for part in (matrix, reaction_matrix)))
    return is_idle


def is_met(matrix: Array, residual: Array, size: Array) -> NDArray[np.bool_]:
    """(scenarios, frames) whether no x reduces the residual A x − b (scenarios, frames, rows); size is |b|."""
    lengths = np.sqrt(_squares(matrix))
    shares = 1.0 / np.where(lengths > 0, lengths, 1.0)
    unmet = np.empty(residual.shape[:2])
    for start in range(0, len(matrix), FRAMES_AT_ONCE):
        part = slice(start, start + FRAMES_AT_ONCE)
        products = np.swapaxes(matrix[part], 1, 2) @ residual[:, part].transpose(1, 2, 0)
        products *= shares[part, :, None]
        unmet[:, part] = np.abs(products, out=products).max(axis=1, initial=0.0).T
    met: NDArray[np.bool_] = unmet <= UNMET_LIMIT * (1.0 + size)
    return met


def _is_round_off(matrix: Array) -> NDArray[np.bool_]:
    squares = _squares(matrix)
    is_short: NDArray[np.bool_] = squares <= ROUND_OFF**2 * squares.max(axis=1, keepdims=True, initial=0.0)
    return is_short


def _squares(matrix: Array) -> Array:
    """Squared lengths (frames, controls) of the columns, without an intermediate array."""
    squares: Array = np.einsum("fij,fij->fj", matrix, matrix)
    return squares
