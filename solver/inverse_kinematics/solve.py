"""Inverse kinematics: the coordinates whose model markers lie nearest to the observed ones, frame by frame.

The problem is OpenSim's (InverseKinematicsTool, Simbody's Assembler), solved to its optimum; OpenSim stops before it.

    minimise  ½ Σ w_m |p_m(q) − x_m|² / Σ w_m  +  ½ Σ w_k (q_k − v_k)²     over the markers visible in a frame
    so that   points that a constraint joins coincide, coupled coordinates follow, locked ones stay at their values,
              and clamped ones stay in their range

How far marker noise moves the coordinates that inverse kinematics finds.

At the optimum the Lagrangian's gradient vanishes, so observations that change by dx move the posture by dq = S dx with

    S = P⁺ Jᵀ W,   P⁺ = Z (Zᵀ ∇²L Z)⁻¹ Zᵀ,   Z the directions that the constraints leave

and Cov q = Σ_m σ_m² S_m S_mᵀ. The Hessian is exact: with Gauss–Newton's part alone the standard deviations are wrong
by a factor of 3 to 4 where residuals are centimetres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.compiled import compiled, compiled_for_python, compiled_with_allocation
from solver.errors import SolverCode
from solver.inverse_kinematics.gauss_newton import (
    NO_MARKERS,
    SOLVED,
    Bounds,
    IkWorkspace,
    Problem,
    allocate_step,
    solve_frame,
)
from solver.inverse_kinematics.linearise import (
    CoordinatePull,
    LinearisedFrames,
    Targets,
    TrackedMarkers,
    allocate_least_squares,
    build_constraints,
    evaluate_cost,
    evaluate_gap,
    fill_linearised,
)
from solver.inverse_kinematics.pose import allocate_pose, build_skeleton, evaluate_pose, point_in_ground
from solver.model import CoordinateLock, Marker, Model, ModelError
from solver.vectors import norm, read, subtract

Array = NDArray[np.float64]

MOST_ROUNDS = 60
MORE_STARTS, START_SPREAD = 5, 1.0
"""Further postures from which the first frame is sought, and how far their angles are from its start [rad]."""
ASSEMBLY_WEIGHT = 1e-2
"""m²/rad²; about the curvature that markers give a joint, so that steps are judged alike."""
NEARNESS = 1e-6  # m²/rad²; by which an optimum must be lower to count although it is farther away
CLEARLY_LOWER = 1e-7  # m²
TURN, ROUND_OFF = 2.0 * pi, 1e-12


class PostureOutcome(StrEnum):
    """Outcome of a frame."""

    SOLVED = "solved"
    NOT_CONVERGED = "not_converged"
    GAP_OPEN = "gap_open"
    NO_MARKERS = "no_markers"


OUTCOMES = tuple(PostureOutcome)
"""In the order of the codes of gauss_newton.py."""


@dataclass(frozen=True, eq=False)
class TrackingTasks:
    """Markers and coordinates that a posture tracks, with weights.

    markers             of the model, in the order of the observed ones
    weights             (markers,) w_m ≥ 0; only their ratios matter
    coordinate_weights  w_k [m²/rad²] by the name of a coordinate; beside mean squares of millimetres 1e-4 is strong
    coordinate_targets  v_k [rad or m] by name, one value or one of each frame; the coordinate's default where absent
    coordinate_slopes   s_k by name, of a target v_k + s_k q_l that follows another coordinate l, the leader
    """

    markers: tuple[Marker, ...]
    weights: Array
    coordinate_weights: Mapping[str, float] = field(default_factory=dict)
    coordinate_targets: Mapping[str, ArrayLike] = field(default_factory=dict)
    coordinate_slopes: Mapping[str, float] = field(default_factory=dict)
    leader: str = ""


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """Postures that track markers; NaN in a frame with the outcome NO_MARKERS.

    coordinates   q (frames, coordinates) [rad or m]
    residuals     (frames, markers) [m] distance of each marker from its observation, NaN where it is hidden
    gap           (frames,) [m or rad] largest violation of a constraint
    cost          (frames,) [m²]
    multipliers   λ (frames, rows) of the constraints, which the covariance needs
    outcomes      (frames,) of FrameOutcome;  rounds (frames,) iterations
    """

    coordinates: Array
    residuals: Array
    gap: Array
    cost: Array
    multipliers: Array
    outcomes: tuple[PostureOutcome, ...]
    rounds: NDArray[np.int64]

    @property
    def unsolved(self) -> int:
        """Number of frames that are not SOLVED."""
        return sum(outcome is not PostureOutcome.SOLVED for outcome in self.outcomes)


def solve_inverse_kinematics(
    model: Model, observed: Array, tasks: TrackingTasks, start: Array | None = None, most_rounds: int = MOST_ROUNDS
) -> InverseKinematics:
    """Postures of all frames, each sought from the one before; the first from `start` (coordinates,) [rad or m].

    observed (frames, markers, 3) [m] in ground, NaN where a marker is hidden. Without a start the first frame is
    sought from the assembled default posture and from five postures drawn about it; the lowest optimum counts, and of
    nearly equal ones the nearest to the default. A coordinate that no visible marker moves keeps its value. Raises
    ModelError where shapes, names or weights do not fit.
    """
    ensure_fits(observed, tasks)
    starts = spread_starts(model, assemble(model)) if start is None else np.array(start, dtype=np.float64)[None]
    problem = build_problem(model, tasks)
    return _solve(model, problem, observed, build_targets(model, tasks, len(observed)), starts, most_rounds)


def assemble(model: Model, wanted: Array | None = None) -> Array:
    """q (coordinates,) nearest to those wanted, by default the model's own, that meet the constraints [rad or m].

    Nearest in Σ (q − wanted)², as OpenSim assembles. Raises ModelError where no posture meets them.
    """
    wanted = model.default_coordinates if wanted is None else np.array(wanted, dtype=np.float64)
    everywhere = dict.fromkeys(model.coordinate_names, ASSEMBLY_WEIGHT)
    problem = build_problem(model, TrackingTasks((), np.zeros(0), everywhere))
    for starts in (wanted[None], spread_starts(model, wanted)):
        found = _solve(model, problem, np.zeros((1, 0, 3)), wanted[None], starts.copy(), MOST_ROUNDS)
        if found.unsolved == 0:
            break
    else:
        raise ModelError(
            f"the constraints of {model.name} cannot be met near the default posture, {found.gap[0]:.3g} m or rad "
            "remain; check its constraints and locked coordinates",
            SolverCode.CONSTRAINTS_NOT_MET,
        )
    return np.asarray(found.coordinates[0])


def build_problem(model: Model, tasks: TrackingTasks) -> Problem:
    """The tables of the compiled solver."""
    count = len(model.coordinates)
    lowest, highest = np.full(count, -np.inf), np.full(count, np.inf)
    for k, coordinate in enumerate(model.coordinates):
        if coordinate.is_clamped:
            lowest[k], highest[k] = coordinate.range
    is_locked = np.zeros(count, dtype=np.bool_)
    is_locked[[coordinate for coordinate, _ in locked_values(model)]] = True
    leader = model.coordinate_index(tasks.leader) if tasks.leader else 0
    pull = CoordinatePull(np.zeros(count), np.zeros(count), leader)
    for name, weight in tasks.coordinate_weights.items():
        place, slope = model.coordinate_index(name), tasks.coordinate_slopes.get(name, 0.0)
        pull.weight[place], pull.slope[place] = weight, slope
    markers = TrackedMarkers(
        np.array([marker.body for marker in tasks.markers], dtype=np.int64),
        np.array([marker.location for marker in tasks.markers]).reshape(-1, 3),
        np.array(tasks.weights, dtype=np.float64),
    )
    is_angle = np.array([coordinate.motion != "translation" for coordinate in model.coordinates], dtype=np.bool_)
    bounds = Bounds(lowest, highest, is_locked)
    return Problem(build_skeleton(model), markers, build_constraints(model), bounds, pull, is_angle)


def allocate_workspace(model: Model, problem: Problem) -> IkWorkspace:
    markers, count = len(problem.markers.weight), len(model.coordinates)
    system = allocate_least_squares(model, markers, problem.constraints)
    rows = len(system.gap)
    return IkWorkspace(
        allocate_pose(model),
        system,
        allocate_step(count, rows),
        np.zeros(markers),
        np.zeros(count),
        np.zeros(rows),
        np.zeros((count, count)),
        np.zeros(1, dtype=np.bool_),
    )


def ensure_fits(observed: Array, tasks: TrackingTasks) -> None:
    """Raises ModelError where observed (frames, markers, 3), markers and weights do not fit each other."""
    count = len(tasks.markers)
    if observed.ndim != 3 or observed.shape[1:] != (count, 3) or tasks.weights.shape != (count,):
        raise ModelError(
            f"expected observed markers of shape (frames, {count}, 3) and {count} weights, found {observed.shape} and "
            f"{tasks.weights.shape}",
            SolverCode.WRONG_SHAPE,
        )
    weights = np.concatenate([tasks.weights, list(tasks.coordinate_weights.values())])
    if not np.isfinite(weights).all() or weights.min(initial=0.0) < 0.0:
        raise ModelError(
            "weights of markers and coordinates should be finite and not negative; correct the tasks",
            SolverCode.NEGATIVE_WEIGHT,
        )


def locked_values(model: Model) -> Sequence[tuple[int, float]]:
    """Index and value [rad or m] of every locked coordinate."""
    return [(lock.coordinate, lock.value) for lock in model.constraints if isinstance(lock, CoordinateLock)]


def spread_starts(model: Model, start: Array) -> Array:
    """(starts, coordinates): the one given, and angles drawn about it."""
    is_angle = np.array([coordinate.motion != "translation" for coordinate in model.coordinates])
    drawn = np.random.default_rng(0).uniform(-START_SPREAD, START_SPREAD, (MORE_STARTS, len(start)))
    return np.concatenate([start[None], start + is_angle * drawn])


def build_targets(model: Model, tasks: TrackingTasks, frames: int) -> Array:
    """v (frames, coordinates)."""
    targets = np.tile(model.default_coordinates, (frames, 1))
    for name, value in tasks.coordinate_targets.items():
        targets[:, model.coordinate_index(name)] = value
    return targets


def _solve(
    model: Model, problem: Problem, observed: Array, values: Array, starts: Array, most_rounds: int
) -> InverseKinematics:
    for coordinate, value in locked_values(model):
        starts[:, coordinate] = value
    work = allocate_workspace(model, problem)
    frames, markers = observed.shape[:2]
    found = np.zeros((frames, starts.shape[1]))
    multipliers, residuals = np.zeros((frames, len(work.system.gap))), np.zeros((frames, markers))
    gap, cost, outcome = np.zeros(frames), np.zeros(frames), np.zeros((frames, 2), dtype=np.int64)
    results = (found, multipliers, residuals, gap, cost, outcome)
    seen = np.ascontiguousarray(observed, dtype=np.float64)
    solve_postures(problem, seen, np.ascontiguousarray(values), most_rounds, starts, work, results)
    outcomes = tuple(OUTCOMES[code] for code in outcome[:, 0])
    return InverseKinematics(found, residuals, gap, cost, multipliers, outcomes, outcome[:, 1])


@compiled_for_python
def solve_postures(
    problem: Problem,
    observed: Array,
    values: Array,
    most_rounds: int,
    starts: Array,
    work: IkWorkspace,
    results: tuple[Array, Array, Array, Array, Array, NDArray[np.int64]],
) -> None:
    """Fill results: q (frames, coordinates), λ (frames, rows), residual (frames, markers) [m], gap (frames,) [m], cost
    (frames,) [m²], and outcome and rounds (frames, 2).

    observed (frames, markers, 3) and values (frames, coordinates) as solve_frame takes them. A frame begins at the last
    one that was solved. The first, and one that is not solved from there, is sought from every row of starts (starts,
    coordinates). A frame without markers leaves NaN.
    """
    found, multipliers, residual, gap, cost, outcome = results
    q, near, is_first = starts[0].copy(), starts[0].copy(), True
    for frame in range(len(observed)):
        seen, value = observed[frame], values[frame]
        outcome[frame] = solve_frame(problem, seen, value, most_rounds, q, work)
        if outcome[frame, 0] == NO_MARKERS:
            found[frame] = residual[frame] = np.nan
            gap[frame] = cost[frame] = np.nan
            work.has_curvature[0] = False
            continue
        if (is_first and len(starts) > 1) or outcome[frame, 0] != SOLVED:
            _search_starts(problem, seen, value, most_rounds, starts, near, q, work)
            _unwind(problem, seen, value, near, q, work)
            outcome[frame, 0], _ = solve_frame(problem, seen, value, most_rounds, q, work)
        found[frame] = q
        for i in range(len(work.system.gap)):
            multipliers[frame, i] = work.quadratic.multipliers[i]
            gap[frame] = max(gap[frame], abs(work.system.gap[i]))
        cost[frame] = evaluate_cost(problem.markers, Targets(seen, work.share, value, problem.pull), q, work.pose)
        for m in range(len(work.share)):
            point = point_in_ground(work.pose.poses[problem.markers.body[m]], problem.markers.location[m])
            residual[frame, m] = norm(subtract(point, read(seen[m])))
        if outcome[frame, 0] == SOLVED:
            near[:], is_first = q, False
        else:
            q[:] = near


@compiled_with_allocation
def _search_starts(
    problem: Problem,
    seen: Array,
    value: Array,
    most_rounds: int,
    starts: Array,
    near: Array,
    q: Array,
    work: IkWorkspace,
) -> None:
    """Move q to the lowest optimum that it and the starts lead to, of nearly equal ones to the one nearest to `near`.

    It stays where no start leads to an optimum.
    """
    best, held = np.inf, _is_held(work)
    for s in range(-1, len(starts)):
        tried = q.copy() if s < 0 else np.where(held, starts[s], q)
        work.has_curvature[0] = False
        code, _ = solve_frame(problem, seen, value, most_rounds, tried, work)
        worth = evaluate_cost(problem.markers, Targets(seen, work.share, value, problem.pull), tried, work.pose)
        for k in range(len(q)):
            worth += NEARNESS * (tried[k] - near[k]) ** 2
        if code == SOLVED and worth < best - CLEARLY_LOWER:
            best = worth
            q[:] = tried


@compiled_with_allocation
def _is_held(work: IkWorkspace) -> NDArray[np.bool_]:
    """(coordinates,) whether anything depends on a coordinate; after a frame was solved."""
    held = np.zeros(len(work.system.gradient), dtype=np.bool_)
    for k in range(len(held)):
        held[k] = work.system.hessian[k, k] != 0.0 or np.any(work.system.rows[:, k] != 0.0)
    return held


@compiled
def _unwind(problem: Problem, seen: Array, value: Array, near: Array, q: Array, work: IkWorkspace) -> None:
    """Take whole turns off angles that are more than half a turn away from a posture, where no marker moves by it."""
    evaluate_pose(problem.skeleton, q, work.pose)
    before = _merit(problem, seen, value, q, work)
    for k in range(len(q)):
        turns = round((q[k] - near[k]) / TURN)
        wound = q[k]
        q[k] = wound - TURN * turns
        bounds = problem.bounds
        is_within = bounds.lowest[k] <= q[k] <= bounds.highest[k] and not bounds.is_locked[k]
        evaluate_pose(problem.skeleton, q, work.pose)
        if not (problem.is_angle[k] and is_within and _merit(problem, seen, value, q, work) < before + ROUND_OFF):
            q[k] = wound


@compiled
def _merit(problem: Problem, seen: Array, value: Array, q: Array, work: IkWorkspace) -> float:
    """Cost and gap."""
    gap = evaluate_gap(problem.constraints, q, work.pose, work.trial_gap)
    return gap + evaluate_cost(problem.markers, Targets(seen, work.share, value, problem.pull), q, work.pose)


LEAST_CURVATURE = 1e-9  # m²/rad²: a marker with a tenth of the weight, 0.1 mm from the axis
HELD_ABOVE = 1e-4  # square of a coordinate's part in a direction without curvature
NOISE_STEP = 0.030  # s; of the sixth differences that show the noise
NOISE_WEIGHTS = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])
NOISE_GAIN = float(np.sqrt((NOISE_WEIGHTS**2).sum()))  # their standard deviation in white noise of 1
MOST_MEDIANS = 25.0
"""Median sizes of a difference; a greater one is a jump or an exchange. Noise in motion is several times that at
rest."""
LEAST_FRAMES = 2  # sixth differences of a marker from which its noise is estimated


@dataclass(frozen=True, eq=False)
class PostureUncertainty:
    """Uncertainty of the postures from independent marker noise.

    covariance           (frames, coordinates, coordinates) [rad or m]², NaN where a frame has no posture
    standard_deviation   (frames, coordinates) [rad or m]; infinite where no marker holds the coordinate
    is_held              (frames, coordinates) whether the visible markers, tasks or locks determine the coordinate
    """

    covariance: Array
    standard_deviation: Array
    is_held: NDArray[np.bool_]


def posture_uncertainty(
    model: Model, observed: Array, tasks: TrackingTasks, solution: InverseKinematics, noise: ArrayLike
) -> PostureUncertainty:
    """Uncertainty of a solution; noise is the standard deviation of a marker along each axis [m], one for all or
    (markers,). observed and tasks are those that were solved.
    """
    sigma = np.broadcast_to(np.asarray(noise, dtype=np.float64), (len(tasks.markers),))
    if not (np.isfinite(sigma).all() and sigma.min(initial=0.0) >= 0.0):
        raise ModelError("the noise of each marker should be finite and not negative [m]", SolverCode.WRONG_NOISE)
    problem, solved = build_problem(model, tasks), (observed, solution.coordinates, solution.multipliers)
    return uncertainty_of_postures(problem, allocate_workspace(model, problem), solved, [(sigma, 0.0)])[0]


def uncertainty_of_postures(
    problem: Problem, work: IkWorkspace, solved: tuple[Array, ...], causes: Sequence[tuple[Array, float | Array]]
) -> list[PostureUncertainty]:
    """From one or more causes, with the tables of the compiled solver. solved: observed, q and λ (frames, rows) of the
    constraints; a cause is the noise of markers (markers,) [m] and that of targets (coordinates,).
    """
    observed, q, multipliers = solved
    weights = np.where(np.isfinite(observed).all(axis=2), problem.markers.weight, 0.0)
    total = np.cumsum(weights, axis=1)[:, -1:]  # in the order of the solver
    shares = np.divide(weights, total, out=np.zeros_like(weights), where=total > 0.0)
    is_posed = (total[:, 0] > 0.0) if weights.shape[1] else np.full(len(q), problem.pull.weight.max() > 0.0)
    posed = np.where(is_posed[:, None], q, np.nan)
    hessians, _, _, _, rows = linearise_frames(problem, work, posed, (observed, shares), problem.pull, multipliers)
    bounds = problem.bounds
    is_at_bound = ((q <= bounds.lowest) | (q >= bounds.highest)) & ~bounds.is_locked
    response, loose = _response(hessians, rows, bounds.is_locked | is_at_bound)
    is_held = np.diagonal(loose, axis1=1, axis2=2) < HELD_ABOVE
    is_moved = (np.diagonal(hessians, axis1=1, axis2=2) > LEAST_CURVATURE) | (rows != 0.0).any(axis=1)
    is_held &= is_moved | ~is_at_bound  # one that nothing moves may happen to stand at its bound
    found = []
    for sigma, of_targets in causes:
        pull = problem.pull._replace(weight=(problem.pull.weight * of_targets) ** 2)
        spread = linearise_frames(problem, work, posed, (observed, shares**2 * sigma**2), pull).hessian
        covariance = response @ spread @ response
        covariance[np.isnan(q[:, 0])] = np.nan
        variance = np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0)
        found.append(PostureUncertainty(covariance, np.where(is_held, np.sqrt(variance), np.inf), is_held))
    return found


def estimate_marker_noise(observed: Array, interval: float) -> Array:
    """(markers,) standard deviation per axis [m] of white noise, from sixth differences of observed
    (frames, markers, 3). Jumps are left out.

    The differences are taken over steps of about 30 ms, so that they show the noise between 8 and 16 Hz: files are
    often low-pass filtered at 15 to 20 Hz, and neighbouring frames then show a tenth of the noise that matters. Motion
    below 3 Hz hardly enters. interval between frames [s]. NaN for a marker that is not seen for long enough.
    """
    step = max(1, round(NOISE_STEP / interval))
    count = len(observed) - (len(NOISE_WEIGHTS) - 1) * step
    if count < 1:
        return np.full(observed.shape[1], np.nan)
    sixth = sum(weight * observed[k * step : k * step + count] for k, weight in enumerate(NOISE_WEIGHTS))
    noise = [_rms_without_jumps(values[np.isfinite(values)]) for values in np.moveaxis(np.asarray(sixth), 1, 0)]
    return np.asarray(np.array(noise) / NOISE_GAIN)


def _rms_without_jumps(differences: Array) -> float:
    """NaN of too few."""
    if len(differences) < 3 * LEAST_FRAMES:
        return np.nan
    sizes = np.abs(differences)
    return float(np.sqrt(np.mean(sizes[sizes <= MOST_MEDIANS * np.median(sizes)] ** 2)))


def _response(hessians: Array, rows: Array, is_fixed: NDArray[np.bool_]) -> tuple[Array, Array]:
    """P⁺ (frames, coordinates, coordinates), and the projector onto what neither curvature nor constraints hold."""
    free = (~is_fixed).astype(np.float64)
    kept = rows * free[:, None, :]
    identity = np.eye(rows.shape[-1])
    projector = free[:, :, None] * (identity - np.linalg.pinv(kept, rcond=1e-10) @ kept) * free[:, None, :]
    curvatures, directions = np.linalg.eigh(projector @ hessians @ projector)
    is_curved = np.abs(curvatures) > LEAST_CURVATURE
    inverse = np.divide(1.0, curvatures, out=np.zeros_like(curvatures), where=is_curved)
    transposed = np.swapaxes(directions, 1, 2)
    curved = (directions * is_curved[:, None, :]) @ transposed
    return (directions * inverse[:, None, :]) @ transposed, projector - curved


def linearise_frames(
    problem: Problem,
    work: IkWorkspace,
    coordinates: Array,
    weighted: tuple[Array, Array] | None = None,
    pull: CoordinatePull | None = None,
    multipliers: Array | None = None,
) -> LinearisedFrames:
    """About coordinates (frames, coordinates); frames that begin with NaN stay 0.

    weighted     x (frames, markers, 3) and w (frames, markers); None for w = 0
    pull         of the coordinates; None for none.  multipliers λ (frames, rows); None for Gauss–Newton's part alone
    """
    (frames, count), (number,) = coordinates.shape, work.system.gap.shape
    markers = len(problem.markers.weight)
    seen, weights = weighted or (np.zeros((frames, markers, 3)), np.zeros((frames, markers)))
    filled = LinearisedFrames(
        hessian=np.zeros((frames, count, count)),
        gradient=np.zeros((frames, count)),
        points=np.zeros((frames, markers, 3)),
        gap=np.zeros((frames, number)),
        rows=np.zeros((frames, number, count)),
    )
    seen, weights, q = (np.ascontiguousarray(part, dtype=np.float64) for part in (seen, weights, coordinates))
    pull = problem.pull._replace(weight=np.zeros(count)) if pull is None else pull
    curved = np.zeros((0, number)) if multipliers is None else np.ascontiguousarray(multipliers)
    tables = problem.skeleton, problem.markers, problem.constraints
    fill_linearised(tables, (seen, weights, pull), curved, q, work.pose, work.system, filled)
    return filled
