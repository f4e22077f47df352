"""Settings of a connection to QTM."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.capture_note import CaptureNote
from drivers.device import HostClock

BLOCK_S = 0.05


@dataclass(frozen=True)
class QtmSettings:
    """Address, control and its password, required labels, host clock and capture note of a connection to QTM.

    Frames that come within block_s [s of wall time] are one block.
    """

    name: str
    host: str
    port: int
    host_clock: HostClock
    has_control: bool
    password: str
    labels: tuple[str, ...]
    note: CaptureNote
    timeout_scale: float = 1.0
    block_s: float = BLOCK_S

    def timeout_s(self, seconds: float) -> float:
        """Wall time [s] allowed for an answer that is due within `seconds` on an idle machine."""
        return seconds * self.timeout_scale
