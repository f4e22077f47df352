"""Interpret a falling edge of the sync line while a trial is armed: end of an earlier capture, or inverted start."""

from __future__ import annotations

from station.bench.pre_roll import LATENESS_S
from station.bench.sync_line import Edge


class FallingEdges:
    """The latest falling edge, and the latest start and stop that the mocap system reported. Times: station seconds."""

    def __init__(self) -> None:
        self._fall: tuple[float, Edge] | None = None
        self._started_s: float | None = None
        self._stopped_s: float | None = None

    def add(self, edge: Edge, now_s: float) -> None:
        self._fall = now_s, edge

    def handle_event(self, kind: str, now_s: float) -> None:
        """Take the kind of an event; only "capture_started" and "capture_stopped" matter."""
        if kind == "capture_started":
            self._started_s = now_s
        elif kind == "capture_stopped":
            self._stopped_s = now_s

    @property
    def unexplained(self) -> Edge | None:
        """The latest falling edge, unless the end of a capture explains it."""
        return self._fall[1] if self._fall and not _coincide(self._fall[0], self._stopped_s) else None

    def inverted_start(self, now_s: float) -> Edge | None:
        """The falling edge that coincided with the start of a capture, once neither can arrive late any more."""
        if self._fall is None or self._started_s is None or not _coincide(self._fall[0], self._started_s):
            return None
        return self._fall[1] if now_s - max(self._fall[0], self._started_s) > LATENESS_S else None


def _coincide(first_s: float, second_s: float | None) -> bool:
    return second_s is not None and abs(first_s - second_s) < LATENESS_S
