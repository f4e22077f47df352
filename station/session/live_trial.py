"""The running trial as views show it: curves, cue, alarm, marks.

Limits of force and force rate hold for a cuff that a person wears; exceeding one raises an alarm.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from station.config import StationConfig
from station.messages.codes import AlarmCode, TrialCode
from station.messages.message import Message
from station.protocol import BODY_TESTS, TrialSpec
from station.session.guide import Cue, Guide

KEPT_POINTS = 1600
"""Points of each live curve: half a minute."""
TARE_S = 1.0


def _opening() -> dict[str, Any]:
    message = Message(TrialCode.OPENING)
    return {"state": "idle", "codes": [message.code.value], "sentence": str(message), "problems": ""}


@dataclass
class LiveTrial:
    """Telemetry of the running trial; latest is its last line (station/session/trial_daemon.py)."""

    spec: TrialSpec
    guide: Guide
    latest: dict[str, Any] = field(default_factory=_opening)
    force: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_POINTS))
    displacement: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_POINTS))
    elevation: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_POINTS))
    emg: dict[str, deque[tuple[float, float]]] = field(default_factory=dict)  # RMS [µV], by channel
    mvc_uv: Mapping[str, float] = field(default_factory=dict)  # largest RMS of each channel in the MVC trial
    events: deque[str] = field(default_factory=lambda: deque(maxlen=8))
    alarm: Message[AlarmCode] | None = None
    is_alarm_seen: bool = False
    marks: dict[int, float] = field(default_factory=dict)  # s into the recording, by the number of the mark
    mark_names: dict[int, str] = field(default_factory=dict)
    tare_n: float | None = None

    @property
    def is_of_wearer(self) -> bool:
        """Whether it is a pose or a motion, guided and drawn by the elevation of the arm."""
        return self.spec.test in BODY_TESTS

    @property
    def motion(self) -> deque[tuple[float, float]]:
        """Elevation of the wearer's arm [deg] or displacement of the cuff [mm]."""
        return self.elevation if self.is_of_wearer else self.displacement

    @property
    def shown_emg(self) -> dict[str, list[tuple[float, float]]]:
        """RMS over time [% of its MVC] of every channel that has one; without an MVC trial [µV] of all."""
        shown = self.mvc_uv or self.emg
        return {
            channel: [(t, uv / self.mvc_uv[channel] * 100 if self.mvc_uv else uv) for t, uv in points]
            for channel, points in self.emg.items()
            if channel in shown
        }

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
    def unseen_alarm(self) -> Message[AlarmCode] | None:
        return None if self.is_alarm_seen else self.alarm

    @property
    def takes_marks(self) -> bool:
        """Marks refer to the recording, which begins at the sync edge."""
        return self.latest["state"] in ("recording", "closing")

    def add_mark(self, name: str = "") -> int:
        """Add a mark at this moment and return its number."""
        number = len(self.marks) + 1
        self.marks[number] = float(self.latest.get("recorded_s") or 0.0)
        if name:
            self.mark_names[number] = name
        return number

    def tare(self) -> None:
        """Count the net force from the mean of the last second; the recording keeps the raw force."""
        if self.force:
            recent = [force for time, force in self.force if time > self.force[-1][0] - TARE_S]
            self.tare_n = sum(recent) / len(recent)

    def update(self, telemetry: dict[str, Any], limits: ForceLimits) -> bool:
        """Take one line of telemetry. Returns whether it raised an alarm."""
        self.latest = telemetry
        force = [(t, n) for t, n in telemetry["force"]]
        self.force.extend(force)
        self.displacement.extend((t, d) for t, d in telemetry["displacement"])
        elevation = [(t, angle) for t, angle in telemetry["elevation"]]
        self.elevation.extend(elevation)
        for channel, rms_uv in telemetry.get("emg_uv", {}).items() if self.force else ():
            self.emg.setdefault(channel, deque(maxlen=KEPT_POINTS)).append((self.force[-1][0], rms_uv))
        self.events.extend(telemetry["events"])
        if telemetry["state"] in ("armed", "recording"):
            points = elevation if self.is_of_wearer else force
            self.guide.update(points, is_recorded=telemetry["state"] == "recording")
        return self._update_alarm(limits.check(list(self.force)[-8 - len(force) :]))

    def _update_alarm(self, alarm: Message[AlarmCode] | None) -> bool:
        """An alarm stays until the operator has seen it and its cause is gone; then it may be raised again."""
        is_new = alarm is not None and self.alarm is None
        if is_new:
            self.alarm = alarm
        elif alarm is None and self.is_alarm_seen:
            self.alarm, self.is_alarm_seen = None, False
        return is_new


RATE_SPAN_S = (0.05, 0.2)
"""Distance in time of the two points that give a force rate."""


@dataclass(frozen=True)
class ForceLimits:
    """Newtons, and newtons per second over a tenth of a second.

    capacity_n is that of the load cell: beyond it, in either direction, its calibration may be lost.
    """

    force_n: float
    rate_n_per_s: float
    capacity_n: float = math.inf

    def check(self, points: Sequence[tuple[float, float]]) -> Message[AlarmCode] | None:
        """The alarm for the first (time s, newtons) beyond a limit; None if there is none."""
        for time, force in points:
            if abs(force) > self.capacity_n:
                return Message(AlarmCode.OVERLOAD, {"force_n": force, "capacity_n": self.capacity_n})
            if force > self.force_n:
                return Message(AlarmCode.FORCE, {"force_n": force, "limit_n": self.force_n})
            before = [earlier for earlier in points if RATE_SPAN_S[0] <= time - earlier[0] <= RATE_SPAN_S[1]]
            if before and (force - before[-1][1]) / (time - before[-1][0]) > self.rate_n_per_s:
                return Message(AlarmCode.FORCE_RATE, {"limit_n_per_s": self.rate_n_per_s})
        return None


def force_limits(config: StationConfig) -> ForceLimits:
    cell = config.load_cell
    return ForceLimits(config.force_ceiling_n, config.safety.force_rate_ceiling_n_per_s, cell.capacity_n)
