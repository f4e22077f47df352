"""Clocks: station time, which a simulated bench or a replay may control, wall time for watchdogs, times of arrival."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from recordings.samples import Samples


class Clock(Protocol):
    """Station time is the time of the bench: wall time on a real bench, simulated time on a simulated one.

    timeout_scale multiplies the wall-clock time-outs of drivers; above 1 if a busy machine simulates the devices.
    """

    timeout_scale: float

    def utc_ns(self) -> int:
        """UTC in station time [ns], the time of arrival in recordings."""
        ...

    def wall_utc_ns(self) -> int:
        """UTC in wall time [ns], for the order of trials, also if station time runs faster than wall time."""
        ...

    def station_s(self) -> float:
        """Station time [s] from an arbitrary origin, for durations and time-outs of configuration and protocol."""
        ...

    def wall_s(self) -> float:
        """Wall time [s] from an arbitrary origin, for watchdogs and flushing."""
        ...


@runtime_checkable
class SteppedClock(Clock, Protocol):
    """A clock that advances in steps, after the station has handled all items."""

    def step(self, ports: Sequence[int] = ()) -> Mapping[int, int | None]:
        """Advance by one step, once the bench knows the connections from these local ports.

        Returns the number of bytes that the bench has sent, by local port; None for a closed connection. Raises
        DeviceLost if the bench has ended.
        """
        ...

    def pending_devices(self) -> int:
        """Number of devices whose reply needs more station time. Raises DeviceLost as step() does."""
        ...


class RealClock:
    """UTC read once and continued by the performance counter; a step of the system clock does not affect a recording.

    On Windows, time.monotonic advances in steps of 16 ms before Python 3.13.
    """

    def __init__(self, timeout_scale: float = 1.0) -> None:
        self.timeout_scale = timeout_scale
        self._start_utc_ns = time.time_ns()
        self._start_ns = time.perf_counter_ns()

    def utc_ns(self) -> int:
        return self._start_utc_ns + time.perf_counter_ns() - self._start_ns

    def wall_utc_ns(self) -> int:
        return self.utc_ns()

    def station_s(self) -> float:
        return self.wall_s()

    def wall_s(self) -> float:
        return (time.perf_counter_ns() - self._start_ns) * 1e-9


class ManualClock:
    """A clock that advances on request, for tests and replays; step() advances it by step_s."""

    timeout_scale = 1.0

    def __init__(self, utc_ns: int = 1_750_000_000_000_000_000, step_s: float = 0.05) -> None:
        self._station_s = 0.0
        self._step_s = step_s
        self._start_utc_ns = utc_ns

    def advance(self, seconds: float) -> None:
        self._station_s += seconds

    def step(self, ports: Sequence[int] = ()) -> Mapping[int, int | None]:  # noqa: ARG002  (no bytes were sent)
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


class ArrivalClock:
    """Host time of the samples of one stream, by the block with the least delay so far.

    The delay of the device remains, some milliseconds; the offline fit uses the sync edges instead. With a backlog the
    last sample lies in the past although blocks keep arriving.
    """

    def __init__(self) -> None:
        self.offset_ns = sys.maxsize  # host time less device time

    def update(self, samples: Samples) -> NDArray[np.int64]:
        """UTC [ns] (n,) of a block of at least one sample."""
        self.offset_ns = min(self.offset_ns, samples.host_time_ns - int(samples.device_time_ns[-1]))
        return samples.device_time_ns + self.offset_ns
