"""Settings of a connection to QTM, and the note on its capture.

The note identifies the capture that a killed station left running, so that the next station ends this one and no other.

QTM does not report who started a capture. It numbers the frames of a capture from 1, so the latest frame number gives
its duration. A note on the disk holds the start time of our capture until QTM has saved it. One capture runs at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from drivers.device import HostClock

BLOCK_S = 0.05
AGREES_S = 2.0
"""Largest difference between the two durations: delays of the network and of a busy machine. A person cannot stop
our capture at the mocap PC and start another within this time."""

_DIGITS = 20
"""More than a UTC in nanoseconds has."""


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


class CaptureNote:
    """now_ns returns UTC [ns] at the pace of QTM's frames, also in the next process. Without a path no note is kept.

    Write errors are ignored: without the note the operator ends the capture.
    """

    def __init__(self, path: Path | None, now_ns: Callable[[], int]) -> None:
        self._path, self._now_ns = path, now_ns

    @property
    def age_s(self) -> float | None:
        """Time since the start of our capture; None without a note."""
        if self._path is None or not self._path.is_file():
            return None
        try:
            with self._path.open(encoding="ascii") as file:
                return (self._now_ns() - int(file.read(_DIGITS))) * 1e-9
        except (OSError, ValueError):
            return None

    def fits(self, running_s: float) -> bool:
        """Whether a capture with this duration is ours."""
        return self.age_s is not None and abs(self.age_s - running_s) < AGREES_S

    def write(self) -> None:
        """Note that our capture starts now."""
        if self._path is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)  # a link there would have another file written to
                with self._path.open("x", encoding="ascii") as file:
                    file.write(str(self._now_ns()))

    def erase(self) -> None:
        """Remove the note: the capture is saved, or no longer exists."""
        if self._path is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)
