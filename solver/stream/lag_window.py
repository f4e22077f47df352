"""Inverse kinematics frame by frame, each from the posture of the frame before, with the covariance of the posture.

The frames of the last lag: postures frame by frame become smoothed positions, speeds and accelerations.

The jerk of the markers is taken to be white, so that of a coordinate is too, with the intensity of the markers' jerk
times the square of the coordinate's sensitivity to them. Its noise has the same sensitivity, so that the noise ratio of
every coordinate is that of the markers: the intensity of their jerk over their noise, which is measured.

smooth_window is the fixed-lag smoother of such coordinates. Per coordinate the Kalman filter runs over the frames of
the window, and the smoother of Bryson and Frazier back to its first frame (Durbin, Koopman, Time Series Analysis by
State Space Methods, 2012, ch. 4.3 and 4.4; for a fixed lag Anderson, Moore, Optimal Filtering, 1979, ch. 7). Intervals
between frames may differ.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.inverse_kinematics.gauss_newton import IkWorkspace, Problem
from solver.inverse_kinematics.marker_fit import LONGEST_GAP, PostureErrors
from solver.inverse_kinematics.smoother import START_SD, advance, go_back, observe, smoothed_state, transition, update
from solver.inverse_kinematics.solve import (
    MOST_ROUNDS,
    OUTCOMES,
    PostureOutcome,
    TrackingTasks,
    allocate_workspace,
    assemble,
    build_problem,
    build_targets,
    ensure_fits,
    locked_values,
    spread_starts,
    uncertainty_of_postures,
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
    a hanging arm nearly as well with a negative elevation.
    """

    def __init__(self, model: Model, tasks: TrackingTasks, errors: PostureErrors) -> None:
        ensure_fits(np.zeros((1, len(tasks.markers), 3)), tasks)
        self._markers, self._errors = tasks.markers, errors
        size = np.maximum(np.hypot(*errors.markers), LEAST_SOFT_TISSUE)
        weights = np.where(tasks.weights > 0.0, size**-2.0, 0.0)
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
        of_skin = self._errors.at(work.pose.poses["rotation"])
        solved = observed[None], found[None], multipliers[None]
        stated, soft_tissue = uncertainty_of_postures(problem, work, solved, [(noise, 0.0), of_skin])
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
        return cls(problem, build_targets(model, tasks, 1), allocate_workspace(model, problem))


JERK_INTENSITY = 0.07
"""m²/s⁵; of a marker, along each axis. At 100 Hz and 0.4 mm of noise the smoother halves 3 Hz, as the published filter
does; the frequency goes with the sixth root."""
LOST_SD = 0.3
"""rad or m; a coordinate that lost its hold is held weakly at its last posture, and neither drifts nor jumps."""
LEAST_SD = 1e-5
"""rad or m; of a posture, for coordinates that constraints or tasks determine exactly."""
LEAST_SENSITIVITY = 1e-4
"""(rad/m)² or 1"""
TIME_TOLERANCE = 1e-3
"""s; by which a frame may be younger than the lag."""
MEMORY = 1000
"""Frames; over which the sensitivity of the coordinates is averaged."""
INTERVALS = 9
"""Intervals between frames of which the median counts."""
USUAL_INTERVAL = 0.01
"""s; of a stream of one frame."""


@dataclass(frozen=True, eq=False)
class SmoothedState:
    """state (3, coordinates) q, q̇, q̈, and their standard deviations, infinite if not determined."""

    state: Array
    standard_deviations: Array


@dataclass(frozen=True, eq=False)
class _Entry:
    """A frame: step and drive (3, 3) as in Window; values and variances (coordinates,), NaN without a posture; restarts
    (coordinates,) which start anew; is_held (coordinates,) in the latest posture.
    """

    time: float
    step: Array
    drive: Array
    values: Array
    variances: Array
    restarts: NDArray[np.bool_]
    is_held: NDArray[np.bool_]
    has_posture: bool


class LagWindow:
    """Frames are added at one end and popped, smoothed by all that follow, at the other."""

    def __init__(self, coordinates: int) -> None:
        self._count = coordinates
        self._entries: deque[_Entry] = deque()
        start = np.tile(np.diag(np.square(START_SD[:3])), (coordinates, 1, 1))
        self._state = FilterState(np.zeros((coordinates, 3)), start)
        self._sensitivity = np.zeros(coordinates)
        self._sensitive_frames = np.zeros(coordinates, dtype=np.int64)
        self._is_held = np.zeros(coordinates, dtype=np.bool_)
        self._held_at = np.full(coordinates, -np.inf)
        self._posture_at = self.last_time = -np.inf
        self._has_begun = False
        self._intervals: deque[float] = deque(maxlen=INTERVALS)

    @property
    def interval(self) -> float:
        """Usual time between frames [s]."""
        return sorted(self._intervals)[len(self._intervals) // 2] if self._intervals else USUAL_INTERVAL

    def is_lost(self, time: float) -> bool:
        """Whether the last posture is so old that the next one begins a new motion."""
        return time - self._posture_at > LONGEST_GAP

    def add(self, time: float, posture: FramePosture, noise: float) -> NDArray[np.bool_]:
        """Add the posture of a frame, with the noise of the markers [m].

        Returns (coordinates,) those that were determined before and are not now.
        """
        step = time - self.last_time if np.isfinite(self.last_time) else 0.0
        if 0 < step < LONGEST_GAP:
            self._intervals.append(step)
        has_posture = posture.outcome is PostureOutcome.SOLVED
        restarts = np.zeros(self._count, dtype=np.bool_)
        values, variances = np.full((2, self._count), np.nan)
        if has_posture:
            self._is_held = posture.is_held
            begins = self.is_lost(time)
            is_found_again = posture.is_held & (time - self._held_at > LONGEST_GAP)
            restarts = is_found_again | begins
            values = posture.coordinates
            variance = np.maximum(np.diagonal(posture.covariance), LEAST_SD**2)
            variances = np.where(posture.is_held, variance, LOST_SD**2)
            self._learn(variance / noise**2, posture.is_held)
        lost: NDArray[np.bool_] = ~posture.is_held & np.isfinite(self._held_at) & has_posture
        self._entries.append(
            _Entry(time, *transition(3, step), values, variances, restarts, self._is_held, has_posture)
        )
        self.last_time = time
        if has_posture:
            self._posture_at = time
            self._held_at[posture.is_held] = time
        return lost

    def is_ready(self, lag: float) -> bool:
        """Whether the first frame is as old as the lag."""
        return bool(self._entries) and self.last_time - self._entries[0].time >= lag - TIME_TOLERANCE

    def pop(self) -> SmoothedState | None:
        """Remove the first frame; None where no posture of it or around it determines its state."""

        entries = list(self._entries)
        first = entries[0]
        smoothed, spread = np.zeros((2, self._count, 3))
        window = Window(
            np.array([entry.values for entry in entries]),
            np.array([entry.variances for entry in entries]),
            np.array([entry.step for entry in entries]),
            np.array([entry.drive for entry in entries]),
            np.array([entry.restarts for entry in entries]),
        )
        intensity = JERK_INTENSITY * np.maximum(self._sensitivity, LEAST_SENSITIVITY)
        smooth_window(window, intensity, self._state, smoothed, spread)
        self._entries.popleft()
        if not self._is_determined(entries):
            return None
        deviations = np.where(first.is_held, np.sqrt(np.maximum(spread.T, 0.0)), np.inf)
        return SmoothedState(smoothed.T.copy(), deviations)

    def _learn(self, sensitivity: Array, is_held: NDArray[np.bool_]) -> None:
        """Average the square of the sensitivity (coordinates,) to marker noise over the frames that determine it."""
        self._sensitive_frames = np.minimum(self._sensitive_frames + is_held, MEMORY)
        share = is_held / np.maximum(self._sensitive_frames, 1)
        self._sensitivity += share * (sensitivity - self._sensitivity)

    def _is_determined(self, entries: list[_Entry]) -> bool:
        if entries[0].has_posture:
            self._has_begun = True
            return True
        later = next((entry for entry in entries if entry.has_posture), None)
        return self._has_begun and later is not None and not later.restarts.all()


class _Filtered(NamedTuple):
    """A coordinate in every frame, before its observation: ahead (frames, 3), covariances (frames, 3, 3), and gains
    (frames, 3), errors (frames, 2) of the observation: observed less predicted, and its variance, 0 for none.
    """

    ahead: Array
    covariances: Array
    gains: Array
    errors: Array


@compiled_for_python
def smooth_window(window: Window, intensity: Array, state: FilterState, smoothed: Array, spread: Array) -> None:
    """Fill smoothed and spread (coordinates, 3), state and variances of the window's first frame given all its frames.

    intensity (coordinates,) of the jerk [rad²/s⁵ or m²/s⁵]. state is that before the window's first frame, and becomes
    that after it.
    """
    values, variances, steps, drives, restarts = window
    frames, count = values.shape
    filtered = _Filtered(np.zeros((frames, 3)), np.zeros((frames, 3, 3)), np.zeros((frames, 3)), np.zeros((frames, 2)))
    ahead, covs, gains, errors = filtered
    mean, cov, other, r, N = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
    for k in range(count):
        mean[:], cov[:] = state.means[k], state.covariances[k]
        last = frames
        for i in range(frames):
            if restarts[i, k]:
                if i > 0:
                    last = i
                    break
                _restart(values[i, k], mean, cov)
            else:
                advance(steps[i], intensity[k] * drives[i], mean, cov, other)
            ahead[i], covs[i], errors[i] = mean, cov, 0.0
            if np.isfinite(values[i, k]):
                errors[i, 0], errors[i, 1] = values[i, k] - mean[0], cov[0, 0] + variances[i, k]
                update(errors[i, 0], errors[i, 1], mean, cov, gains[i], other)
            if i == 0:
                state.means[k], state.covariances[k] = mean, cov
        r[:], N[:] = 0.0, 0.0
        for i in range(last - 1, 0, -1):
            observe(gains[i], errors[i], r, N, other)
            go_back(steps[i], r, N, other)
        observe(gains[0], errors[0], r, N, other)
        smoothed_state(ahead[0], covs[0], r, N, smoothed[k], spread[k])


@compiled
def _restart(value: float, mean: Array, cov: Array) -> None:
    cov[:] = 0.0
    mean[:] = 0.0
    for i in range(3):
        cov[i, i] = START_SD[i] ** 2
    if np.isfinite(value):
        mean[0] = value


class Window(NamedTuple):
    """Frames from the first that was not given out to the latest.

    values, variances (frames, coordinates) of the postures, NaN where there is none
    steps, drives  (frames, 3, 3) transition from the frame before, that of the first from the state, and the covariance
                   that it adds per unit of intensity
    restarts  (frames, coordinates) where a coordinate starts anew
    """

    values: Array
    variances: Array
    steps: Array
    drives: Array
    restarts: NDArray[np.bool_]


class FilterState(NamedTuple):
    """means (coordinates, 3) of q, q̇, q̈ and covariances (coordinates, 3, 3) after a frame, given those before it."""

    means: Array
    covariances: Array
