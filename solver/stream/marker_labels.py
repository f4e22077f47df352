"""Labels of the markers of a stream: an exchange is corrected, and a marker that jumps is left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.exchanges import MarkerTracks, exchanged_pairs

Array = NDArray[np.float64]

MEMORY = 0.25
"""s; a marker that was hidden for longer has a new track, with the label that it comes with."""
JUMP = 0.05
"""m; no marker on a body leaves its extrapolated place by more between frames at 50 Hz or faster."""
LONGEST_EXTRAPOLATION = 0.05
"""s; over a longer gap a jump cannot be distinguished from motion."""
BACK_WITHIN = 0.03
"""m; a marker that was left out is used again when it is not farther from the model than before by more."""


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
