"""The few methods of the World that the electrical simulators use, with voltages a test can reckon with."""

from __future__ import annotations

import threading
import time

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.faults import Faults

Array = NDArray[np.float64]


class StandInWorld:
    """Amplifier at 1 V + 10 mV per second, sync line high from edge_s on; is_standing: time moves by advance() only."""

    def __init__(self, speed: float = 50.0, is_standing: bool = False) -> None:
        self.speed = speed
        self.edge_s = np.inf
        self.flows = threading.Event()  # cleared, the amplifier's wire answers nobody: a device that hangs
        self.flows.set()
        self.faults = Faults(self.now)
        self._is_standing = is_standing
        self._skipped_s = 0.0
        self._wall_start_s = time.monotonic()

    def now(self) -> float:
        wall_s = 0.0 if self._is_standing else time.monotonic() - self._wall_start_s
        return self._skipped_s + wall_s * self.speed

    def utc_ns(self) -> int:
        """The host's clock of this world."""
        return 1_750_000_000_000_000_000 + int(self.now() * 1e9)

    def advance(self, seconds: float) -> None:
        self._skipped_s += seconds

    def amplifier_voltage(self, t: Array) -> Array:
        self.flows.wait(10)
        return 1.0 + 0.01 * t

    def sync_voltage(self, t: Array) -> Array:
        return np.where(t >= self.edge_s, 5.0, 0.0)

    def cell_force(self, t: Array) -> Array:
        return np.full_like(t, 100.0)
