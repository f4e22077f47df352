"""The fall of the sync line while a trial is armed: an earlier capture's end, or an inverted line's start."""

from __future__ import annotations

from station.bench.pre_roll import LATENESS_S
from station.bench.sync_line import Edge

ARMED = "armed, waiting for the sync edge"
ALREADY_CAPTURING = "armed, and the sync line is high: stop the running capture, or check the line's polarity"


class Falls:
    """The latest fall, and the mocap system's latest word on its captures. All times are station seconds."""

    def __init__(self) -> None:
        self._fall: tuple[float, Edge] | None = None
        self._started_s: float | None = None
        self._stopped_s: float | None = None

    def note_fall(self, edge: Edge, now_s: float) -> None:
        self._fall = now_s, edge

    def note_capture(self, kind: str, now_s: float) -> None:
        """Takes the kind of an event; "capture_started" and "capture_stopped" matter."""
        if kind == "capture_started":
            self._started_s = now_s
        elif kind == "capture_stopped":
            self._stopped_s = now_s

    @property
    def unexplained(self) -> Edge | None:
        """The latest fall, unless a capture that stopped explains it."""
        return self._fall[1] if self._fall and not _are_together(self._fall[0], self._stopped_s) else None

    def inverted_start(self, now_s: float) -> Edge | None:
        """The fall that came together with the start of a capture, once neither can be late any more."""
        if self._fall is None or self._started_s is None or not _are_together(self._fall[0], self._started_s):
            return None
        return self._fall[1] if now_s - max(self._fall[0], self._started_s) > LATENESS_S else None


def _are_together(first_s: float, second_s: float | None) -> bool:
    return second_s is not None and abs(first_s - second_s) < LATENESS_S
