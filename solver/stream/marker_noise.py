"""Noise of the markers, measured while they move: sixth differences, as in inverse_kinematics/uncertainty.py."""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import comb

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ORDER, STEP = 6, 0.030
"""Order of the differences, and their step [s]."""
MEMORY = 10.0
"""s; after which an observation has 1/e of its weight."""
ASSUMED, ASSUMED_FRAMES = 5e-4, 5
"""m; the noise that is assumed before markers are seen, and how many frames outweigh it."""
LEAST = 5e-5
"""m; no camera system is taken to be better."""
LARGEST_RATIO = 25.0
"""Mean sizes of a difference; a larger one is a jump."""
UNEVEN = 0.2
"""Part of an interval by which the frames of a difference may be off an even grid."""


class RunningMarkerNoise:
    """Standard deviation of the white noise of each marker, from the frames so far."""

    def __init__(self, markers: int) -> None:
        weights = np.array([(-1.0) ** k * comb(ORDER, k) for k in range(ORDER + 1)])
        self._weights = weights / np.sqrt((weights**2).sum())
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
        step = max(1, round(STEP / interval)) if interval else 1
        while len(self._frames) > ORDER * step + 1:
            self._frames.popleft()
        if len(self._frames) <= ORDER * step:
            return
        chosen = [self._frames[k * step] for k in range(ORDER + 1)]
        times = np.array([moment for moment, _ in chosen])
        grid = times[-1] - step * interval * np.arange(ORDER, -1, -1)
        if np.abs(times - grid).max() > UNEVEN * interval:
            return
        difference = np.tensordot(self._weights, np.array([places for _, places in chosen]), 1)
        square = (difference**2).mean(axis=1)
        with np.errstate(invalid="ignore"):
            counts = square <= LARGEST_RATIO**2 * self._sum / self._count  # False for NaN
        kept = np.exp(-interval / MEMORY)
        self._sum[counts] = kept * self._sum[counts] + square[counts]
        self._count[counts] = kept * self._count[counts] + 1.0

    def _interval(self) -> float:
        """Shortest of the last intervals [s]; 0 before there are any."""
        times = [time for time, _ in list(self._frames)[-5:]]
        return min((later - before for before, later in pairwise(times)), default=0.0)
