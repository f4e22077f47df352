"""Guide the operator through a trial: the next step is recognised from the signal itself.

A guide takes the force [N], or the elevation of the wearer's arm [deg], as it arrives, in station seconds. It gives one
instruction at a time, how steady the signal is, and how long it must still be held. It has no effect on the recording.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from documents.message import Figures, Message
from fitting.wearer.wearer_trial import CycleDetector
from recordings.manifest import TestKind, TrialCondition
from recordings.standard_gravity import g
from station.body_config import BodySection
from station.config import ProtocolSection
from station.messages.bench_messages import CueCode

WINDOW_S = 1.0
"""Window of the force that decides whether it is steady."""
STEADY_SLOPE_N_PER_S = 1.5
STEADY_SD_N = 0.6
REST_BLOCKS = 5
"""Blocks of the window: a body sways at a few hertz; faster changes are the noise of the amplifier."""
STEADY_SD_SHARE = 0.015
"""Allowed standard deviation as a fraction of the force: a hanging weight sways with the body."""
LEVEL_N, LEVEL_SHARE = 3.0, 0.08
"""Allowed deviation of a level from its weights: friction at a pulley is some percent."""
WRONG_LEVEL_S = 3.0
REST_S = 2.0
EMPTY_HOLD_S = 4.0
"""Migration is measured from the empty hook, so that it is held for as long as a load."""
SWING_WINDOW_S = 4.0
LEAST_SWING_N = 2.0
LEAST_SWING_HZ = 0.3
STILL_S = 1.0
STILL_DEG = 4.0
"""Range of the elevation over STILL_S in quiet standing: markers that move by 20 mm on an upper arm of 0.3 m."""
TREND_S, TREND_DEG = 0.5, 4.0
"""The arm rises or falls at more than 8 deg/s, beyond the movement of markers on the skin."""


class RestState(StrEnum):
    """Steadiness of the signal."""

    WAITING = "no force yet"
    NO_ELEVATION = "no elevation yet"
    MOVING = "moving"
    SETTLING = "still settling"
    STEADY = "steady"
    SWINGING = "swinging"


@dataclass(frozen=True)
class Cue:
    """The current instruction. left_s counts down while something must last; step counts from 0 to steps."""

    message: Message[CueCode]
    rest: RestState
    step: int
    steps: int
    left_s: float | None = None
    target_n: float | None = None
    is_done: bool = False

    @property
    def sentence(self) -> str:
        return str(self.message)


class Guide(Protocol):
    @property
    def stages(self) -> tuple[str, ...]:
        """The names of the steps, from 0 on; empty if their number is unknown."""
        ...

    def update(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        """Take the force, (time s, newtons) in order; force before the recording only gives the initial level."""
        ...

    def cue(self) -> Cue: ...


def guide_for(test: TestKind, protocol: ProtocolSection) -> Guide:
    if test == "static" and protocol.step_masses_kg:
        return StaticGuide(protocol.step_masses_kg, protocol.hold_s)
    if test == "static":
        return FreeStaticGuide(protocol.hold_s)
    return BounceGuide(protocol.swing_s) if test == "bounce" else SwingGuide(protocol.swing_s)


class RecentSignal:
    """The points (time s, value) of the last window_s seconds."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._points: deque[tuple[float, float]] = deque()

    def add(self, time: float, value: float) -> None:
        self._points.append((time, value))
        while self._points[-1][0] - self._points[0][0] > self._window_s:
            self._points.popleft()


class RecentForce(RecentSignal):
    """Statistics of a force [N]."""

    @property
    def mean(self) -> float:
        return float(np.mean([force for _, force in self._points]))

    def rest(self) -> RestState:
        if len(self._points) < 5 or self._points[-1][0] - self._points[0][0] < 0.7 * self._window_s:
            return RestState.WAITING
        time, force = np.array(self._points).T  # in NumPy's fastest calls: it runs at every point of the telemetry
        time, level = time - time.mean(), float(force.mean())
        slope = float(time @ force / (time @ time))
        size, longer = divmod(len(time), REST_BLOCKS)
        starts = [block * size + min(block, longer) for block in range(REST_BLOCKS)]
        spread = float(np.std(np.add.reduceat(force - level - slope * time, starts) / np.diff([*starts, len(time)])))
        if spread > max(STEADY_SD_N, STEADY_SD_SHARE * abs(level)):
            return RestState.MOVING
        return RestState.STEADY if abs(slope) < STEADY_SLOPE_N_PER_S else RestState.SETTLING

    def swing(self) -> tuple[float, float]:
        """Frequency [Hz] and amplitude [N] of the oscillation about the mean, from its upward crossings.

        A crossing counts if it rises from half an amplitude below to half an amplitude above; noise does not.
        """
        if len(self._points) < 10:
            return 0.0, 0.0
        time, force = np.array(self._points).T
        about = force - force.mean()
        amplitude = float(np.std(about) * np.sqrt(2))
        side = np.sign(about) * (np.abs(about) > amplitude / 2)
        decided = np.flatnonzero(side)
        up = decided[1:][np.diff(side[decided]) > 0]
        frequency = (len(up) - 1) / (time[up[-1]] - time[up[0]]) if len(up) > 1 else 0.0
        return float(frequency), amplitude


class StaticGuide:
    """Static test with known weights: added one by one, every level held, then removed one by one."""

    def __init__(self, step_masses_kg: Sequence[float], hold_s: float) -> None:
        steps = [mass * g for mass in step_masses_kg]
        rising = np.cumsum([0.0, *steps])
        self._masses_kg = tuple(step_masses_kg)
        self._levels = [*rising, *rising[-2::-1]]  # N above the empty hook
        self._hold_s = hold_s
        self._force = RecentForce(WINDOW_S)
        self._empty: float | None = None  # N, the force of the empty hook
        self._step = 0
        self._held_since: float | None = None
        self._wrong_since: float | None = None
        self._now = 0.0
        loads = range(1, len(steps) + 1)
        self.stages = ("empty", *(f"+{load}" for load in loads), *(f"\u2212{load}" for load in reversed(loads)))

    def update(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        for time, force in points:
            self._force.add(time, force)
            self._now = time
            if is_recorded:
                self._advance()
            elif self._force.rest() is RestState.STEADY:  # the first weight may hang before the first telemetry
                self._empty = self._force.mean

    def cue(self) -> Cue:
        rest, steps = self._force.rest(), len(self._levels)
        if self._step == steps:
            return Cue(Message(CueCode.STATIC_DONE), rest, steps, steps, is_done=True)
        target = self._target()
        left = self._needed_s() - (self._now - self._held_since) if self._held_since is not None else self._needed_s()
        message = self._wrong_level() or self._instruction(target)
        return Cue(message, rest, self._step, steps, max(left, 0.0), target)

    def _advance(self) -> None:
        """Take one more point: decide whether the level is held, and for how long."""
        if self._step == len(self._levels):
            return
        rest, level = self._force.rest(), self._force.mean
        if rest is not RestState.STEADY:
            self._held_since = self._wrong_since = None
        elif self._is_ahead() or (self._step and not self._is_at(self._step)):
            self._step += self._is_ahead()
            self._held_since = None
            self._wrong_since = self._now if self._wrong_since is None else self._wrong_since
        else:
            self._wrong_since = None
            self._held_since = self._now if self._held_since is None else self._held_since
            if self._now - self._held_since >= self._needed_s():
                self._empty = self._empty if self._step else level
                self._step, self._held_since = self._step + 1, None

    def _is_at(self, step: int) -> bool:
        """Whether the force is that of the weights of this step; False before the empty hook was measured."""
        if self._empty is None or step >= len(self._levels):
            return False
        target = self._empty + float(self._levels[step])
        return abs(self._force.mean - target) < max(LEVEL_N, LEVEL_SHARE * abs(target))

    def _is_ahead(self) -> bool:
        """Whether the operator is one step ahead; during unloading the same level also occurs one step earlier."""
        return self._is_at(self._step + 1) and not self._is_at(self._step - 1)

    def _needed_s(self) -> float:
        """Duration of steady force; the force is known to be steady only after one window."""
        return (self._hold_s if self._step else EMPTY_HOLD_S) - WINDOW_S

    def _target(self) -> float | None:
        return None if self._empty is None else self._empty + float(self._levels[self._step])

    def _wrong_level(self) -> Message[CueCode] | None:
        """A steady force that differs from the target for WRONG_LEVEL_S."""
        target = self._target()
        if not self._step or self._wrong_since is None or target is None:
            return None
        if self._now - self._wrong_since < WRONG_LEVEL_S:
            return None
        change = float(self._levels[self._step] - self._levels[self._step - 1])
        if abs(self._force.mean - (target - change)) < LEVEL_N:
            return None  # the weight of this step was not added or removed yet
        return Message(CueCode.WRONG_FORCE, {"force_n": self._force.mean, "target_n": target})

    def _instruction(self, target: float | None) -> Message[CueCode]:
        if not self._step or target is None:
            return Message(CueCode.EMPTY_HOOK)
        weights = (len(self._levels) - 1) // 2
        is_added = self._step <= weights
        weight = self._step if is_added else 2 * weights + 1 - self._step
        figures: Figures = {"weight": weight, "weights": weights, "mass_kg": self._masses_kg[weight - 1]}
        code = CueCode.ADD_WEIGHT if is_added else CueCode.REMOVE_WEIGHT
        return Message(code, {**figures, "target_n": max(target, 0.0), "hold_s": self._hold_s})


class FreeStaticGuide:
    """Static test with unknown weights: counts the levels that were held."""

    stages = ()

    def __init__(self, hold_s: float) -> None:
        self._hold_s = hold_s
        self._force = RecentForce(WINDOW_S)
        self._levels: list[float] = []
        self._held_since: float | None = None
        self._now = 0.0

    def update(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        for time, force in points:
            self._now = time
            self._force.add(time, force)
            if not is_recorded or self._force.rest() is not RestState.STEADY:
                self._held_since = None
            elif self._held_since is None:
                self._held_since = time
            elif time - self._held_since >= self._hold_s and self._is_new():
                self._levels.append(self._force.mean)

    def cue(self) -> Cue:
        rest, held = self._force.rest(), len(self._levels)
        if self._held_since is not None and self._is_new():
            left = max(0.0, self._hold_s - (self._now - self._held_since))
            return Cue(Message(CueCode.HOLD, {"force_n": self._force.mean}), rest, held, held, left)
        if not held:
            return Cue(Message(CueCode.FIRST_LEVEL, {"hold_s": self._hold_s}), rest, held, held)
        return Cue(Message(CueCode.NEXT_LEVEL, {"levels": held, "hold_s": self._hold_s}), rest, held, held)

    def _is_new(self) -> bool:
        """Whether the level differs from the last one held."""
        return not self._levels or abs(self._force.mean - self._levels[-1]) > LEVEL_N


class SwingGuide:
    """A spring that is pulled about once a second for swing_s: the dynamic test."""

    stages: tuple[str, ...] = ("stand still", "swing", "rest")
    still, start = CueCode.STAND_STILL, CueCode.PULL_SPRING

    def __init__(self, swing_s: float) -> None:
        self._swing_s = swing_s
        self._force, self._still = RecentForce(SWING_WINDOW_S), RecentForce(WINDOW_S)
        self._swung_s = self._rested_s = 0.0
        self._now: float | None = None

    def update(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        for time, force in points:
            passed = 0.0 if self._now is None or not is_recorded else time - self._now
            self._now = time
            self._force.add(time, force)
            self._still.add(time, force)
            if self._is_swinging():
                self._swung_s += passed
            elif self._still.rest() is RestState.STEADY:
                self._rested_s += passed

    def cue(self) -> Cue:
        rest, (frequency, amplitude) = self._still.rest(), self._force.swing()
        if self._swung_s >= self._swing_s:
            if rest is RestState.STEADY and not self._is_swinging():
                return Cue(Message(CueCode.SWING_DONE), rest, 3, 3, is_done=True)
            return Cue(Message(CueCode.LET_REST), rest, 2, 3)
        left = self._swing_s - self._swung_s
        if self._is_swinging():
            message = Message(CueCode.KEEP_SWINGING, {"frequency_hz": frequency, "amplitude_n": amplitude})
            return Cue(message, RestState.SWINGING, 1, 3, left)
        if self._rested_s < REST_S and not self._swung_s:
            return Cue(Message(self.still), rest, 0, 3, REST_S - self._rested_s)
        return Cue(Message(self.start), rest, 1, 3, left)

    def _is_swinging(self) -> bool:
        frequency, amplitude = self._force.swing()
        return amplitude > LEAST_SWING_N and frequency > LEAST_SWING_HZ


class BounceGuide(SwingGuide):
    """The known mass that bounces on its spring, without a wearer: the calibration."""

    stages = ("hang still", "bounce", "rest")
    still, start = CueCode.HANG_STILL, CueCode.BOUNCE


def wearer_guide(condition: TrialCondition | None, body: BodySection, *, is_pose: bool) -> Guide:
    if is_pose:
        return PoseGuide(body.pose_s)
    if condition == "mvc":
        return UncountedGuide(Message(CueCode.CONTRACT))
    if not body.arm:
        return UncountedGuide(Message(CueCode.MOVE_UNCOUNTED, {"cycles": body.cycles}))
    return MotionGuide(body.cycles)


class RecentElevation(RecentSignal):
    """Trend and range of an elevation [deg]."""

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
        self._recent = RecentElevation(STILL_S)
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
        self._recent, self._detector = RecentElevation(STILL_S), CycleDetector()
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
        self._message, self._recent = message, RecentElevation(STILL_S)

    def update(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:  # noqa: ARG002
        for time, angle in points:
            self._recent.add(time, angle)

    def cue(self) -> Cue:
        return Cue(self._message, self._recent.rest(), 0, 0)
