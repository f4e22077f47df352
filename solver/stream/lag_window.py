"""The frames of the last lag: postures frame by frame become smoothed positions, speeds and accelerations.

The jerk of the markers is taken to be white, so that of a coordinate is too, with the intensity of the markers' jerk
times the square of the coordinate's sensitivity to them. Its noise has the same sensitivity, so that the noise ratio of
every coordinate is that of the markers: the intensity of their jerk over their noise, which is measured.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.gaps import LONGEST_GAP
from solver.inverse_kinematics.solve import PostureOutcome
from solver.stream.filter_state import START_SD, FilterState, Window
from solver.stream.frame_posture import FramePosture

Array = NDArray[np.float64]

JERK_INTENSITY = 0.07
"""m²/s⁵; of a marker, along each axis. At 100 Hz and 0.4 mm of noise the smoother halves 3 Hz, as the published filter
does; the frequency goes with the sixth root."""
LOST_SD = 0.3
"""rad or m; a coordinate that lost its hold is drawn weakly to its last posture, and neither drifts nor jumps."""
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
    """state (3, coordinates) q, q̇, q̈, and their standard deviations, infinite for what is not determined."""

    state: Array
    standard_deviations: Array


@dataclass(frozen=True, eq=False)
class _Entry:
    """A frame: values and variances (coordinates,), NaN without a posture; restarts (coordinates,) which start anew;
    is_held (coordinates,) in the latest posture.
    """

    time: float
    step: float
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
        start = np.tile(np.diag(np.square(START_SD)), (coordinates, 1, 1))
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
        self._entries.append(_Entry(time, step, values, variances, restarts, self._is_held, has_posture))
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
        from solver.stream.fixed_lag import smooth_window  # the compiler behind it takes a while to import

        entries = list(self._entries)
        first = entries[0]
        smoothed, spread = np.zeros((2, self._count, 3))
        window = Window(
            np.array([entry.values for entry in entries]),
            np.array([entry.variances for entry in entries]),
            np.array([entry.step for entry in entries]),
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
