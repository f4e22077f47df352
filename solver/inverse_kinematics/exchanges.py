"""Markers whose labels are exchanged for a while, from their trajectories alone.

Where two labels are exchanged, each marker appears where the other was about to be. Places are extrapolated from the
last two frames, and over a gap they stay where they were last seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAR, FAR = 0.35, 0.65
"""Parts of the distance between two markers: an exchanged marker is nearer to the other's place than NEAR, and farther
from its own than FAR."""
LEAST_DISTANCE = 0.02
"""m; markers that are closer together cannot be distinguished by position."""
LONGEST_EXTRAPOLATION = 3
"""Frames."""


@dataclass(frozen=True)
class Exchange:
    """Indices of two markers whose labels are exchanged in the frames from start to stop, stop excluded."""

    markers: tuple[int, int]
    start: int
    stop: int


def find_exchanges(observed: Array) -> tuple[Exchange, ...]:
    """Exchanges in a trial, observed (frames, markers, 3) [m], NaN where hidden.

    Labels are taken to be right in the longer part of the trial: one that stays exchanged to the end for more than
    half of the frames was exchanged before.
    """
    frames, count = observed.shape[:2]
    tracks = MarkerTracks(count)
    begun: dict[tuple[int, int], int] = {}
    found = []
    for frame in range(frames):
        seen = observed[frame, tracks.label_of]
        for pair in exchanged_pairs(seen, tracks.expected(frame)):
            labels = tuple(sorted(int(tracks.label_of[marker]) for marker in pair))
            tracks.exchange(*pair)
            start = begun.pop((labels[0], labels[1]), None)
            if start is None:
                begun[labels[0], labels[1]] = frame
            else:
                found.append(Exchange((labels[0], labels[1]), start, frame))
        tracks.add(frame, observed[frame, tracks.label_of])
    for markers, start in begun.items():
        found.append(Exchange(markers, start, frames) if start > frames / 2 else Exchange(markers, 0, start))
    return tuple(sorted(found, key=lambda exchange: exchange.start))


class MarkerTracks:
    """Places of markers whatever their labels: label_of (markers,), and the last two places of each."""

    def __init__(self, count: int) -> None:
        self.label_of = np.arange(count)
        self._last, self._before = np.full((2, count, 3), np.nan)
        self._frame = np.zeros(count, dtype=np.int64)

    def expected(self, frame: int) -> Array:
        """(markers, 3), NaN before a marker was seen."""
        steps = np.where(self.is_extrapolated(frame), frame - self._frame, 0)[:, None]
        return np.asarray(self._last + steps * np.nan_to_num(self._last - self._before))

    def is_extrapolated(self, frame: int) -> NDArray[np.bool_]:
        """(markers,) whether the last two places are known and recent."""
        return np.asarray((frame - self._frame <= LONGEST_EXTRAPOLATION) & np.isfinite(self._before[:, 0]))

    def exchange(self, one: int, other: int) -> None:
        self.label_of[[one, other]] = self.label_of[[other, one]]

    def forget(self, marker: int) -> None:
        """Take the next place of a marker as its first."""
        self._last[marker] = self._before[marker] = np.nan

    def add(self, frame: int, places: Array) -> None:
        is_seen = np.isfinite(places).all(axis=1)
        follows = is_seen & (self._frame == frame - 1) & np.isfinite(self._last[:, 0])
        self._before[is_seen] = np.where(follows[is_seen, None], self._last[is_seen], np.nan)
        self._last[is_seen] = places[is_seen]
        self._frame[is_seen] = frame


def exchanged_pairs(seen: Array, expected: Array) -> list[tuple[int, int]]:
    """Pairs of markers that appear in each other's places; seen and expected (markers, 3)."""
    with np.errstate(invalid="ignore"):
        away = np.linalg.norm(seen[:, None] - expected[None], axis=2)
        apart = np.linalg.norm(expected[:, None] - expected[None], axis=2)
        own = np.diagonal(away)
        is_exchanged = (away < NEAR * apart) & (NEAR * apart > away.T) & (apart > LEAST_DISTANCE)
        is_exchanged &= (own[:, None] > FAR * apart) & (own[None] > FAR * apart)
    pairs = np.argwhere(np.triu(is_exchanged, 1))
    return [(int(one), int(other)) for one, other in pairs]
