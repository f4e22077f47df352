"""Inverse kinematics frame by frame, each from the posture of the frame before, with the covariance of the posture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.gauss_newton import IkWorkspace, Problem
from solver.inverse_kinematics.posture_uncertainty import uncertainty_of_postures
from solver.inverse_kinematics.solve import (
    MOST_ROUNDS,
    OUTCOMES,
    PostureOutcome,
    TrackingTasks,
    allocate_workspace,
    assemble,
    build_problem,
    ensure_fits,
    locked_values,
    spread_starts,
    targets_of,
)
from solver.model import Model
from solver.personalisation.estimate import within_ranges

Array = NDArray[np.float64]

LEAST_SOFT_TISSUE = 1e-3
"""m; of a marker, where the first posture is searched for."""
LEAST_TIME_BETWEEN_SEARCHES = 0.25
"""s; a search that failed is not repeated in every frame, because it takes as long as ten frames."""


@dataclass(frozen=True, eq=False)
class FramePosture:
    """Posture that tracks the markers of one frame; NaN unless outcome is SOLVED.

    coordinates (coordinates,) q [rad or m];  points (markers, 3) where the model has them, in ground [m]
    covariance  (coordinates, coordinates) from the markers' noise, soft_tissue_covariance from the skin that moves over
                the bone;  is_held (coordinates,) whether markers, tasks or locks determine it
    """

    outcome: PostureOutcome
    coordinates: Array
    points: Array
    covariance: Array
    soft_tissue_covariance: Array
    is_held: NDArray[np.bool_]


class PostureTracker:
    """Inverse kinematics of a stream; tables and memory are allocated once.

    A motion starts from the most probable posture within the ranges of the joints (within_ranges), because markers fit
    a hanging arm nearly as well with a negative elevation. soft_tissue (markers,) is the standard deviation of the skin
    under each marker along each axis [m].
    """

    def __init__(self, model: Model, tasks: TrackingTasks, soft_tissue: Array) -> None:
        ensure_fits(np.zeros((1, len(tasks.markers), 3)), tasks)
        self._markers, self._soft_tissue = tasks.markers, soft_tissue
        weights = np.where(tasks.weights > 0.0, np.maximum(soft_tissue, LEAST_SOFT_TISSUE) ** -2.0, 0.0)
        limited, usual = within_ranges(model, replace(tasks, weights=weights))
        self._search, self._tracking = _FrameProblem.of(limited, usual), _FrameProblem.of(model, tasks)
        self._locks = locked_values(model)
        self._spread = self._with_locks(spread_starts(model, assemble(model)))
        self._last = self._spread[0]
        self._searched_at = -np.inf

    def solve(self, time: float, observed: Array, noise: Array, *, is_start: bool) -> FramePosture:
        """observed (markers, 3) [m], NaN where hidden; noise (markers,) [m]; is_start searches from many postures."""
        may_search = time - self._searched_at >= LEAST_TIME_BETWEEN_SEARCHES
        if is_start and may_search:
            found, multipliers, outcome = self._searched(observed)
        else:
            found, multipliers, outcome = self._solve(self._tracking, observed, self._last[None].copy())
        if outcome not in (PostureOutcome.SOLVED, PostureOutcome.NO_MARKERS) and may_search:
            self._searched_at = time
            if not is_start:
                found, multipliers, outcome = self._searched(observed)
        count = len(found)
        if outcome is not PostureOutcome.SOLVED:
            nothing = np.full((count, count), np.nan)
            return FramePosture(
                outcome, nothing[0], np.full_like(observed, np.nan), nothing, nothing, np.zeros(count, dtype=np.bool_)
            )
        self._last = found
        problem, work = self._tracking.problem, self._tracking.work
        stated, soft_tissue = (
            uncertainty_of_postures(problem, work, observed[None], found[None], multipliers[None], sigma)
            for sigma in (noise, self._soft_tissue)
        )
        held = stated.is_held[0]
        return FramePosture(outcome, found, self._points(), stated.covariance[0], soft_tissue.covariance[0], held)

    def _searched(self, observed: Array) -> tuple[Array, Array, PostureOutcome]:
        """From the most probable posture; if that finds none, from the last posture and many others."""
        starts = np.concatenate([self._last[None], self._spread])
        usual = self._solve(self._search, observed, starts.copy())[0]
        found = self._solve(self._tracking, observed, usual[None])
        return found if found[2] is PostureOutcome.SOLVED else self._solve(self._tracking, observed, starts)

    def _solve(self, frame: _FrameProblem, observed: Array, starts: Array) -> tuple[Array, Array, PostureOutcome]:
        from solver.inverse_kinematics.solve import solve_postures  # the compiler behind it takes a while to import

        count, rows, markers = starts.shape[1], len(frame.work.system.gap), len(observed)
        found, multipliers, residuals = np.zeros((1, count)), np.zeros((1, rows)), np.zeros((1, markers))
        outcome = np.zeros((1, 2), dtype=np.int64)
        results = (found, multipliers, residuals, np.zeros(1), np.zeros(1), outcome)
        seen = np.ascontiguousarray(observed[None], dtype=np.float64)
        solve_postures(frame.problem, seen, frame.values, MOST_ROUNDS, starts, frame.work, results)
        return found[0], multipliers[0], OUTCOMES[outcome[0, 0]]

    def _points(self) -> Array:
        """(markers, 3) places of the model's markers [m] in the posture that was evaluated last."""
        poses = self._tracking.work.pose.poses
        return np.array([poses["origin"][m.body] + poses["rotation"][m.body] @ m.location for m in self._markers])

    def _with_locks(self, starts: Array) -> Array:
        for coordinate, value in self._locks:
            starts[:, coordinate] = value
        return starts


@dataclass(frozen=True, eq=False)
class _FrameProblem:
    """Tables, targets (1, coordinates) and memory of inverse kinematics of one frame."""

    problem: Problem
    values: Array
    work: IkWorkspace

    @classmethod
    def of(cls, model: Model, tasks: TrackingTasks) -> _FrameProblem:
        problem = build_problem(model, tasks)
        return cls(problem, targets_of(model, tasks, 1), allocate_workspace(model, problem))
