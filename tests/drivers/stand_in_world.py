"""The few methods of the World that the electrical simulators use, with voltages a test can reckon with."""

import threading

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.faults import Faults
from drivers.simulators.world_clock import WorldClock

Array = NDArray[np.float64]


class _Nobody:
    """Follows the clock, so that it moves."""

    def step(self, now: float) -> None: ...

    def find_slow_client(self) -> None: ...

    def drop_slow_client(self) -> None: ...


class StandInWorld:
    """Amplifier at 1 V + 10 mV per second, EMG at 1 V and 2 V, sync line high from edge_s on.

    is_standing: time moves by advance() only.
    """

    def __init__(self, speed: float = 50.0, is_standing: bool = False) -> None:
        self.clock = WorldClock(None if is_standing else speed)
        self.edge_s = np.inf
        self.flows = threading.Event()  # cleared, the amplifier's wire does not answer: a device that hangs
        self.flows.set()
        self.faults = Faults(self.now)
        if not is_standing:
            self.clock.follow(_Nobody())

    @property
    def speed(self) -> float | None:
        return self.clock.speed

    def now(self) -> float:
        return self.clock.now()

    def utc_ns(self) -> int:
        """The host's clock of this world."""
        return 1_750_000_000_000_000_000 + int(self.now() * 1e9)

    def advance(self, seconds: float) -> None:
        speed, self.clock.speed = self.clock.speed, None  # at once, whatever the pace
        self.clock.advance(seconds)
        self.clock.speed = speed

    def amplifier_voltage(self, t: Array) -> Array:
        self.flows.wait(10)
        return 1.0 + 0.01 * t

    def emg_voltage(self, channel: str, t: Array) -> Array:
        return np.full_like(t, {"deltoid": 1.0, "trapezius": 2.0}[channel])

    def sync_voltage(self, t: Array) -> Array:
        return np.where(t >= self.edge_s, 5.0, 0.0)

    def cell_force(self, t: Array) -> Array:
        return np.full_like(t, 100.0)
