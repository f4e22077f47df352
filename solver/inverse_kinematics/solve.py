"""Inverse kinematics: the coordinates whose model markers lie nearest to the observed ones, frame by frame.

The problem is OpenSim's (InverseKinematicsTool, Simbody's Assembler), solved to its optimum; OpenSim stops before it.

    minimise  ½ Σ w_m |p_m(q) − x_m|² / Σ w_m  +  ½ Σ w_k (q_k − v_k)²     over the markers visible in a frame
    so that   points that a constraint joins coincide, coupled coordinates follow, locked ones stay at their values,
              and clamped ones stay in their range
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import SolverCode
from solver.inverse_kinematics.frame import IkWorkspace, Problem
from solver.inverse_kinematics.linearise import TrackedMarkers, allocate_least_squares, constraints_of
from solver.inverse_kinematics.skeleton import allocate_pose, skeleton_of
from solver.inverse_kinematics.step import Bounds, allocate_step
from solver.model import CoordinateLock, Marker, Model, ModelError

Array = NDArray[np.float64]

MOST_ROUNDS = 60
MORE_STARTS, START_SPREAD = 5, 1.0
"""Further postures from which the first frame is sought, and how far their angles are from its start [rad]."""
ASSEMBLY_WEIGHT = 1e-2
"""m²/rad²; about the curvature that markers give a joint, so that steps are judged alike."""


class PostureOutcome(StrEnum):
    """What became of a frame."""

    SOLVED = "solved"
    NOT_CONVERGED = "not_converged"
    GAP_OPEN = "gap_open"
    NO_MARKERS = "no_markers"


OUTCOMES = (PostureOutcome.SOLVED, PostureOutcome.NOT_CONVERGED, PostureOutcome.GAP_OPEN, PostureOutcome.NO_MARKERS)
"""In the order of frame.py's codes."""


@dataclass(frozen=True, eq=False)
class TrackingTasks:
    """Markers and coordinates that a posture tracks, with weights.

    markers             of the model, in the order of the observed ones
    weights             (markers,) w_m ≥ 0; only their ratios matter
    coordinate_weights  w_k [m²/rad²] by the name of a coordinate; beside mean squares of millimetres 1e-4 is strong
    coordinate_targets  v_k [rad or m] by name, one value or one of each frame; the coordinate's default where absent
    """

    markers: tuple[Marker, ...]
    weights: Array
    coordinate_weights: Mapping[str, float] = field(default_factory=dict)
    coordinate_targets: Mapping[str, ArrayLike] = field(default_factory=dict)


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
    model: Model,
    observed: Array,
    tasks: TrackingTasks,
    start: Array | None = None,
    most_rounds: int = MOST_ROUNDS,
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
    return _solve(model, problem, observed, targets_of(model, tasks, len(observed)), starts, most_rounds)


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
    posture: Array = found.coordinates[0]
    return posture


def build_problem(model: Model, tasks: TrackingTasks) -> Problem:
    """The tables of the compiled solver."""
    count = len(model.coordinates)
    lowest, highest = np.full(count, -np.inf), np.full(count, np.inf)
    for k, coordinate in enumerate(model.coordinates):
        if coordinate.is_clamped:
            lowest[k], highest[k] = coordinate.range
    is_locked = np.zeros(count, dtype=np.bool_)
    is_locked[[coordinate for coordinate, _ in locked_values(model)]] = True
    pull = np.zeros(count)
    for name, weight in tasks.coordinate_weights.items():
        pull[model.coordinate_index(name)] = weight
    markers = TrackedMarkers(
        np.array([marker.body for marker in tasks.markers], dtype=np.int64),
        np.array([marker.location for marker in tasks.markers]).reshape(-1, 3),
        np.array(tasks.weights, dtype=np.float64),
    )
    is_angle = np.array([coordinate.motion != "translation" for coordinate in model.coordinates], dtype=np.bool_)
    bounds = Bounds(lowest, highest, is_locked)
    return Problem(skeleton_of(model), markers, constraints_of(model), bounds, pull, is_angle)


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


def targets_of(model: Model, tasks: TrackingTasks, frames: int) -> Array:
    """v (frames, coordinates)."""
    targets = np.tile(model.default_coordinates, (frames, 1))
    for name, value in tasks.coordinate_targets.items():
        targets[:, model.coordinate_index(name)] = value
    return targets


def _solve(
    model: Model, problem: Problem, observed: Array, values: Array, starts: Array, most_rounds: int
) -> InverseKinematics:
    from solver.inverse_kinematics.sequence import solve_frames  # the compiler behind it takes a while to import

    for coordinate, value in locked_values(model):
        starts[:, coordinate] = value
    work = allocate_workspace(model, problem)
    frames, markers = observed.shape[:2]
    found = np.zeros((frames, starts.shape[1]))
    multipliers, residuals = np.zeros((frames, len(work.system.gap))), np.zeros((frames, markers))
    gap, cost, outcome = np.zeros(frames), np.zeros(frames), np.zeros((frames, 2), dtype=np.int64)
    results = (found, multipliers, residuals, gap, cost, outcome)
    seen = np.ascontiguousarray(observed, dtype=np.float64)
    solve_frames(problem, seen, np.ascontiguousarray(values), most_rounds, starts, work, results)
    outcomes = tuple(OUTCOMES[code] for code in outcome[:, 0])
    return InverseKinematics(found, residuals, gap, cost, multipliers, outcomes, outcome[:, 1])
