"""Guide the operator through a pose or a motion of the wearer by the elevation of the arm.

The points of these guides are elevations [deg] at station seconds; those of the guides of cuffs are forces.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from fitting.wearer.wearer_trial import CycleDetector
from recordings.manifest import TrialCondition
from station.body_config import BodySection
from station.messages.codes import CueCode
from station.messages.message import Figures, Message
from station.session.guide import Cue, Guide, RestState

STILL_S = 1.0
STILL_DEG = 4.0
"""Range of the elevation over STILL_S in quiet standing: markers that move by 20 mm on an upper arm of 0.3 m."""
TREND_S, TREND_DEG = 0.5, 4.0
"""The arm rises or falls at more than 8 deg/s, beyond the movement of markers on the skin."""


def wearer_guide(condition: TrialCondition | None, body: BodySection, *, is_pose: bool) -> Guide:
    if is_pose:
        return PoseGuide(body.pose_s)
    if condition == "mvc":
        return UncountedGuide(Message(CueCode.CONTRACT))
    if not body.arm:
        return UncountedGuide(Message(CueCode.MOVE_UNCOUNTED, {"cycles": body.cycles}))
    return MotionGuide(body.cycles)


class RecentElevation:
    """The elevation of the last STILL_S."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, float]] = deque()

    def add(self, time: float, angle: float) -> None:
        self._points.append((time, angle))
        while self._points[-1][0] - self._points[0][0] > STILL_S:
            self._points.popleft()

    def trend(self) -> int:
        """1 while the arm rises by more than TREND_DEG in TREND_S, -1 while it falls, otherwise 0."""
        if not self._points:
            return 0
        now, angle = self._points[-1]
        before = next(past for time, past in self._points if time >= now - TREND_S)
        return int(angle - before > TREND_DEG) - int(before - angle > TREND_DEG)

    def rest(self) -> RestState:
        if not self._points:
            return RestState.NO_ELEVATION
        angles = [angle for _, angle in self._points]
        return RestState.STEADY if max(angles) - min(angles) < STILL_DEG else RestState.MOVING


class PoseGuide:
    """A static pose of pose_s seconds of recording."""

    stages = ("hold",)

    def __init__(self, pose_s: float) -> None:
        self._pose_s = pose_s
        self._recent = RecentElevation()
        self._first: float | None = None  # s, of the recording
        self._now = 0.0

    def update(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        for time, angle in points:
            self._recent.add(time, angle)
            self._now = time
            if is_recorded and self._first is None:
                self._first = time

    def cue(self) -> Cue:
        held = 0.0 if self._first is None else self._now - self._first
        if held >= self._pose_s:
            return Cue(Message(CueCode.POSE_DONE), self._recent.rest(), 1, 1, is_done=True)
        left = None if self._first is None else self._pose_s - held
        return Cue(Message(CueCode.HOLD_POSE), self._recent.rest(), 0, 1, left)


class MotionGuide:
    """A number of arm cycles, each a step; recognised by the turning points of the elevation.

    The detector recognises a turning point 25 deg after it. An instruction lasts until the arm has followed it: to
    raise the arm until it stops rising, to lower it until it stops falling.
    """

    def __init__(self, cycles: int) -> None:
        self._cycles = cycles
        self._recent, self._detector = RecentElevation(), CycleDetector()
        self.stages = tuple(f"cycle {number}" for number in range(1, cycles + 1))
        self._is_at_top = False  # the present raise has ended
        self._is_lowering = False  # the last cycle is counted, and the arm still falls

    def update(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        for time, angle in points:
            self._recent.add(time, angle)
            if is_recorded:
                self._count(time, angle)

    def _count(self, time: float, angle: float) -> None:
        counted = len(self._detector.turns)
        self._detector.update((time,), (float(np.radians(angle)),))
        trend = self._recent.trend()
        self._is_at_top = self._detector.is_raised and (self._is_at_top or trend <= 0)
        self._is_lowering = len(self._detector.turns) > counted or (self._is_lowering and trend < 0)

    def cue(self) -> Cue:
        done, rest = len(self._detector.turns) - self._is_lowering, self._recent.rest()
        figures: Figures = {"cycle": done + 1, "cycles": self._cycles}
        if done >= self._cycles:
            return Cue(Message(CueCode.MOTION_DONE, figures), rest, self._cycles, self._cycles, is_done=True)
        code = CueCode.LOWER_ARM if self._is_at_top or self._is_lowering else CueCode.RAISE_ARM
        return Cue(Message(code, figures), rest, done, self._cycles)


class UncountedGuide:
    """One instruction for the whole trial; the operator decides on its end."""

    stages = ()

    def __init__(self, message: Message[CueCode]) -> None:
        self._message, self._recent = message, RecentElevation()

    def update(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:  # noqa: ARG002
        for time, angle in points:
            self._recent.add(time, angle)

    def cue(self) -> Cue:
        return Cue(self._message, self._recent.rest(), 0, 0)
