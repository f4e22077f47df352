"""Labels of the markers of a stream: an exchange is corrected, and a marker that jumps is left out.

The noise of the markers is measured while they move, from sixth differences as in solve.py.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.marker_fit import MarkerTracks, exchanged_pairs
from solver.inverse_kinematics.solve import NOISE_GAIN, NOISE_STEP, NOISE_WEIGHTS

Array = NDArray[np.float64]

MEMORY = 0.25
"""s; a marker that was hidden for longer has a new track, with the label that it comes with."""
JUMP = 0.05
"""m; no marker on a body leaves its extrapolated place by more between frames at 50 Hz or faster."""
LONGEST_EXTRAPOLATION = 0.05
"""s; over a longer gap a jump cannot be distinguished from motion."""
BACK_WITHIN = 0.03
"""m; a marker that was left out is used again when it is not farther from the model than before by more."""
ORDER = len(NOISE_WEIGHTS) - 1
NOISE_MEMORY = 10.0
"""s; after which an observation has 1/e of its weight."""
ASSUMED, ASSUMED_FRAMES = 5e-4, 5
"""m; the noise that is assumed before markers are seen, and how many frames outweigh it."""
LEAST = 5e-5
"""m; no camera system is taken to be better."""
LARGEST_RATIO = 25.0
"""Mean sizes of a difference; a larger one is a jump."""
UNEVEN = 0.2
"""Part of an interval by which the frames of a difference may be off an even grid."""


@dataclass(frozen=True, eq=False)
class LabelledFrame:
    """positions (markers, 3) [m] with labels as they were before an exchange, NaN for hidden ones and those left out.

    exchanged (pairs of markers);  is_left_out (markers,)
    """

    positions: Array
    exchanged: tuple[tuple[int, int], ...]
    is_left_out: NDArray[np.bool_]


class MarkerLabels:
    """The tracks of the markers."""

    def __init__(self, markers: int) -> None:
        self._count = markers
        self._tracks = MarkerTracks(markers)
        self._frame = -1
        self._seen_at = np.full(markers, -np.inf)
        self._is_left_out = np.zeros(markers, dtype=np.bool_)
        self._usual = np.full(markers, np.inf)
        self._given = np.full((markers, 3), np.nan)

    def take(self, time: float, positions: Array) -> LabelledFrame:
        """The frame at time [s] with the labels put right."""
        self._frame += 1
        self._forget(time)
        expected = self._tracks.expected(self._frame)
        for pair in exchanged_pairs(positions[self._tracks.label_of], expected):
            self._tracks.exchange(*pair)
        label_of = self._tracks.label_of
        places = positions[label_of]
        is_seen = np.asarray(np.isfinite(places).all(axis=1))
        pairs = tuple((i, int(label_of[i])) for i in range(self._count) if label_of[i] > i)
        has_jumped = self._has_jumped(time, places, expected)
        self._given = places
        if 2 * has_jumped.sum() > is_seen.sum():  # not this body, or not its labels
            return LabelledFrame(np.full_like(places, np.nan), pairs, is_seen)
        self._is_left_out |= has_jumped
        for marker in np.flatnonzero(has_jumped).tolist():
            self._tracks.forget(marker)  # a jump is no speed
        self._tracks.add(self._frame, places)
        self._seen_at[is_seen] = time
        kept = np.where(self._is_left_out[:, None] | ~is_seen[:, None], np.nan, places)
        return LabelledFrame(kept, pairs, self._is_left_out & is_seen)

    def compare(self, points: Array) -> None:
        """Judge the markers that are left out by the model's points (markers, 3) [m] in this frame's posture."""
        with np.errstate(invalid="ignore"):
            away = np.linalg.norm(self._given - points, axis=1)
            self._is_left_out &= ~(away < self._usual + BACK_WITHIN)
        used = np.isfinite(away) & ~self._is_left_out
        self._usual[used] = away[used]

    def _forget(self, time: float) -> None:
        """Forget tracks of markers that were hidden for long; an exchange ends with the track of one of its markers."""
        is_old = time - self._seen_at > MEMORY
        self._is_left_out &= ~is_old
        label_of = self._tracks.label_of
        for marker in np.flatnonzero(is_old).tolist():
            while (other := int(label_of[marker])) != marker:  # all labels that were exchanged with it, in turn
                label_of[marker], label_of[other] = label_of[other], other
                self._tracks.forget(other)
            self._tracks.forget(marker)

    def _has_jumped(self, time: float, places: Array, expected: Array) -> NDArray[np.bool_]:
        """(markers,) only of those that were seen so recently that motion is no explanation."""
        with np.errstate(invalid="ignore"):
            is_far = np.linalg.norm(places - expected, axis=1) > JUMP
        is_recent = (time - self._seen_at < LONGEST_EXTRAPOLATION) & self._tracks.is_extrapolated(self._frame)
        return np.asarray(is_far & is_recent)


class RunningMarkerNoise:
    """Standard deviation of the white noise of each marker, from the frames so far."""

    def __init__(self, markers: int) -> None:
        self._frames: deque[tuple[float, Array]] = deque()
        self._sum = np.full(markers, ASSUMED_FRAMES * ASSUMED**2)
        self._count = np.full(markers, float(ASSUMED_FRAMES))

    @property
    def standard_deviation(self) -> Array:
        """(markers,) along each axis [m]."""
        deviation: Array = np.sqrt(self._sum / self._count)
        return np.maximum(deviation, LEAST)

    def add(self, time: float, positions: Array) -> None:
        """Take a frame, positions (markers, 3) [m] with NaN where hidden; frames off an even grid do not count."""
        self._frames.append((time, positions))
        interval = self._interval()
        step = max(1, round(NOISE_STEP / interval)) if interval else 1
        while len(self._frames) > ORDER * step + 1:
            self._frames.popleft()
        if len(self._frames) <= ORDER * step:
            return
        chosen = [self._frames[k * step] for k in range(ORDER + 1)]
        times = np.array([moment for moment, _ in chosen])
        grid = times[-1] - step * interval * np.arange(ORDER, -1, -1)
        if np.abs(times - grid).max() > UNEVEN * interval:
            return
        difference = np.tensordot(NOISE_WEIGHTS / NOISE_GAIN, np.array([places for _, places in chosen]), 1)
        square = (difference**2).mean(axis=1)
        with np.errstate(invalid="ignore"):
            counts = square <= LARGEST_RATIO**2 * self._sum / self._count  # False for NaN
        kept = np.exp(-interval / NOISE_MEMORY)
        self._sum[counts] = kept * self._sum[counts] + square[counts]
        self._count[counts] = kept * self._count[counts] + 1.0

    def _interval(self) -> float:
        """Shortest of the last intervals [s]; 0 before there are any."""
        times = [time for time, _ in list(self._frames)[-5:]]
        return min((later - before for before, later in pairwise(times)), default=0.0)
