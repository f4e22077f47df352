"""A known mass that a person hangs from the load cell in place of the rig, at rest, by a hook without weight.

Does not imitate: the swing of a mass that was just hung.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g

Floats = NDArray[np.float64]


class HungMass:
    """Known masses on the load cell by time [world s]."""

    def __init__(self) -> None:
        self._times = [-math.inf]
        self._forces = [math.nan]  # [N]; NaN: the rig

    def hang(self, mass_kg: float, now: float) -> None:
        """The mass hangs in place of the rig; 0 is the empty cell."""
        self._change(mass_kg * g, now)

    def take_off(self, now: float) -> None:
        """The rig is back."""
        if not math.isnan(self._forces[-1]):
            self._change(math.nan, now)

    def force(self, t: Floats, rig: Floats) -> Floats:
        """(n,) [N] on the cell at t (n,), where the rig alone would pull with rig (n,)."""
        hung = np.array(self._forces)[np.searchsorted(self._times, t, side="right") - 1]
        return np.where(np.isnan(hung), rig, hung)

    def _change(self, force: float, now: float) -> None:
        self._times.append(now)
        self._forces.append(force)
