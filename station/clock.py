"""The station's two clocks: station time, which simulations may run faster, and wall time for watchdogs."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Station seconds scale with the speed of the world; wall seconds are those on the operator's wrist."""

    speed: float

    def utc_ns(self) -> int:
        """UTC of the station [ns]: what recordings carry as arrival time."""
        ...

    def wall_utc_ns(self) -> int:
        """UTC on the wall [ns]: which trial came first, also across processes whose station time runs fast."""
        ...

    def station_s(self) -> float:
        """Station seconds since some fixed moment: durations of the configuration and the protocol."""
        ...

    def wall_s(self) -> float:
        """Wall seconds since some fixed moment: watchdogs and flushing."""
        ...


class RealClock:
    """UTC read once, carried on by the monotonic clock: a step of the system's clock cannot tear a recording.

    speed > 1 lets station time run faster than the wall, for simulated worlds of the same speed.
    """

    def __init__(self, speed: float = 1.0) -> None:
        if not speed > 0:
            raise ValueError(f"the clock's speed is {speed:g}, expected a number above 0")
        self.speed = speed
        self._start_utc_ns = time.time_ns()
        self._start_ns = time.monotonic_ns()

    def utc_ns(self) -> int:
        return self._start_utc_ns + int((time.monotonic_ns() - self._start_ns) * self.speed)

    def wall_utc_ns(self) -> int:
        return self._start_utc_ns + time.monotonic_ns() - self._start_ns

    def station_s(self) -> float:
        return self.wall_s() * self.speed

    def wall_s(self) -> float:
        return (time.monotonic_ns() - self._start_ns) * 1e-9


class ManualClock:
    """A clock that stands until it is told to advance, for tests."""

    def __init__(self, speed: float = 1.0, utc_ns: int = 1_750_000_000_000_000_000) -> None:
        self.speed = speed
        self._wall_s = 0.0
        self._start_utc_ns = utc_ns

    def advance(self, wall_s: float) -> None:
        self._wall_s += wall_s

    def utc_ns(self) -> int:
        return self._start_utc_ns + round(self.station_s() * 1e9)

    def wall_utc_ns(self) -> int:
        return self._start_utc_ns + round(self._wall_s * 1e9)

    def station_s(self) -> float:
        return self._wall_s * self.speed

    def wall_s(self) -> float:
        return self._wall_s
