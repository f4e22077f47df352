"""What the running trial has shown so far: curves, cue, alarm."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from station.protocol import TrialSpec
from station.session.guide import Ceilings, Cue, Guide

KEPT_POINTS = 1600
"""Of each live curve: half a minute."""
TARE_S = 1.0


@dataclass
class Live:
    """What the running trial has shown so far."""

    spec: TrialSpec
    guide: Guide
    latest: dict[str, Any] = field(default_factory=lambda: {"state": "idle", "sentence": "opening the devices"})
    force: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_POINTS))
    displacement: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_POINTS))
    words: deque[str] = field(default_factory=lambda: deque(maxlen=8))
    alarm: str | None = None
    is_alarm_seen: bool = False
    marks: dict[int, float] = field(default_factory=dict)  # s into the recording, by the number of the mark
    mark_names: dict[int, str] = field(default_factory=dict)
    tare_n: float | None = None

    @property
    def cue(self) -> Cue:
        return self.guide.cue()

    def from_edge(self, points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
        """Points of a curve with their time from the sync edge; before it, from now."""
        kept = list(points)
        edge_s = self.latest.get("edge_s")
        zero_s = kept[-1][0] if edge_s is None and kept else edge_s or 0.0
        return [(round(t - zero_s, 4), value) for t, value in kept]

    @property
    def unseen_alarm(self) -> str | None:
        return None if self.is_alarm_seen else self.alarm

    @property
    def takes_marks(self) -> bool:
        """Before the sync edge there is nothing to point at."""
        return self.latest["state"] in ("recording", "closing")

    def add_mark(self, name: str = "") -> int:
        """The number of a new mark, at this moment."""
        number = len(self.marks) + 1
        self.marks[number] = float(self.latest.get("recorded_s") or 0.0)
        if name:
            self.mark_names[number] = name
        return number

    def tare(self) -> None:
        """The mean force of the last second is what the net force counts from; the recording keeps all of it."""
        if self.force:
            recent = [force for time, force in self.force if time > self.force[-1][0] - TARE_S]
            self.tare_n = sum(recent) / len(recent)

    def take(self, said: dict[str, Any], ceilings: Ceilings) -> bool:
        """One line of telemetry. Returns whether it raised an alarm."""
        self.latest = said
        force = [(t, n) for t, n in said["force"]]
        self.force.extend(force)
        self.displacement.extend((t, d) for t, d in said["displacement"])
        self.words.extend(said["words"])
        if said["state"] in ("armed", "recording"):
            self.guide.take(force, is_recorded=said["state"] == "recording")
        return self._watch(ceilings.broken_by(list(self.force)[-8 - len(force) :]))

    def _watch(self, broken: str | None) -> bool:
        """An alarm stays until somebody has seen it and its cause is gone; then it may be raised again."""
        is_new = broken is not None and self.alarm is None
        if is_new:
            self.alarm = broken
        elif broken is None and self.is_alarm_seen:
            self.alarm, self.is_alarm_seen = None, False
        return is_new
