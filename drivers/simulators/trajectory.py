"""The computed motion of the cuff: the last minutes, on the integrator's grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.cuff_physics import STEP_S

Floats = NDArray[np.float64]


class Trajectory:
    """A ring of (displacement [m], slip [m], load [N]) per step; row n belongs to the world time n × STEP_S."""

    def __init__(self, kept_s: float) -> None:
        self._ring = np.zeros((int(kept_s / STEP_S), 3))
        self._first = self._end = 0

    @property
    def end(self) -> int:
        """The step after the last one known."""
        return self._end

    def hold_until(self, step: int) -> None:
        """The state stays constant until `step`, the step of the next row. Earlier rows are kept."""
        held = min(step - self._end, len(self._ring))
        last = self._ring[(self._end - 1) % len(self._ring)].copy()
        self._end = step - held
        self.append(np.broadcast_to(last, (held, 3)))

    def append(self, rows: Floats) -> None:
        """Continues by rows (n, 3)."""
        self._ring[np.arange(self._end, self._end + len(rows)) % len(self._ring)] = rows
        self._end += len(rows)
        self._first = max(self._first, self._end - len(self._ring))

    def at(self, t: Floats) -> Floats:
        """(n, 3) at the times t (n,) [s], linear between steps; outside what is kept, its first or last row."""
        place = np.clip(t / STEP_S, self._first, self._end - 1)
        step = np.floor(place).astype(np.int64)
        before = self._ring[step % len(self._ring)]
        after = self._ring[np.minimum(step + 1, self._end - 1) % len(self._ring)]
        rows: Floats = before + (place - step)[:, None] * (after - before)
        return rows
