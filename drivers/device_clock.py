"""Bounds on the clock of a device: a sample is not taken after it arrived."""

from __future__ import annotations

TOLERANCE_S = 1.0
"""By which a reading may lie ahead of the earlier ones. The first samples of a device may have waited for so long."""


class DeviceClock:
    """Compares readings of a device's clock [s] with the times of their arrival [ns] on the host's clock.

    A jump ahead of the host's clock is one of the device's clock. No time has passed then, so no sample was lost.
    """

    def __init__(self) -> None:
        self._ahead_s: float | None = None  # most that a reading was ahead of its arrival; negative for a delay

    def is_possible(self, reading_s: float, host_time_ns: int) -> bool:
        """Whether so much time can have passed for the device."""
        return self._ahead_s is None or reading_s - host_time_ns * 1e-9 <= self._ahead_s + TOLERANCE_S

    def add(self, reading_s: float, host_time_ns: int) -> None:
        ahead_s = reading_s - host_time_ns * 1e-9
        self._ahead_s = ahead_s if self._ahead_s is None else max(self._ahead_s, ahead_s)

    def restart(self) -> None:
        """The device's clock was set."""
        self._ahead_s = None
