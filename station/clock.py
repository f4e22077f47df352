"""The station's clocks: station time, which a simulated bench or a replay may move, and the wall's for watchdogs."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable


class Clock(Protocol):
    """Station seconds are those of the bench: the wall's on a real one, the world's on a simulated one.

    timeout_scale multiplies the wall-clock time-outs of drivers: above 1 where a busy machine simulates the devices.
    """

    timeout_scale: float

    def utc_ns(self) -> int:
        """UTC of the station [ns]: what recordings carry as arrival time."""
        ...

    def wall_utc_ns(self) -> int:
        """UTC on the wall [ns]: which trial came first, also across processes whose station time runs fast."""
        ...

    def station_s(self) -> float:
        """Station seconds since some fixed moment: durations and time-outs of the configuration and the protocol."""
        ...

    def wall_s(self) -> float:
        """Wall seconds since some fixed moment: watchdogs and flushing."""
        ...


@runtime_checkable
class SteppedClock(Clock, Protocol):
    """A clock that stands still until the station has handled everything, and moves in steps."""

    def step(self, ports: Sequence[int] = ()) -> Mapping[int, int | None]:
        """Moves on by one step, once the bench knows the connections from these local ports.

        Returns how many bytes the bench has sent on each connection, by its local port; None where it closed one.
        Raises DeviceLost where the bench is gone.
        """
        ...

    def pending_devices(self) -> int:
        """How many devices owe a reply that comes only as time goes on. Raises DeviceLost as step()."""
        ...


class RealClock:
    """UTC read once, carried on by the monotonic clock: a step of the system's clock cannot tear a recording."""

    timeout_scale = 1.0

    def __init__(self) -> None:
        self._start_utc_ns = time.time_ns()
        self._start_ns = time.monotonic_ns()

    def utc_ns(self) -> int:
        return self._start_utc_ns + time.monotonic_ns() - self._start_ns

    def wall_utc_ns(self) -> int:
        return self.utc_ns()

    def station_s(self) -> float:
        return self.wall_s()

    def wall_s(self) -> float:
        return (time.monotonic_ns() - self._start_ns) * 1e-9


class ManualClock:
    """A clock that stands until it is told to advance, for tests and replays; step() advances it by step_s."""

    timeout_scale = 1.0

    def __init__(self, utc_ns: int = 1_750_000_000_000_000_000, step_s: float = 0.05) -> None:
        self._station_s = 0.0
        self._step_s = step_s
        self._start_utc_ns = utc_ns

    def advance(self, seconds: float) -> None:
        self._station_s += seconds

    def step(self, ports: Sequence[int] = ()) -> Mapping[int, int | None]:  # noqa: ARG002  (nobody has sent anything)
        self.advance(self._step_s)
        return {}

    def pending_devices(self) -> int:
        return 0

    def utc_ns(self) -> int:
        return self._start_utc_ns + round(self._station_s * 1e9)

    def wall_utc_ns(self) -> int:
        return self.utc_ns()

    def station_s(self) -> float:
        return self._station_s

    def wall_s(self) -> float:
        return self._station_s
