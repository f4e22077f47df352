"""What the hands do next, recognised from the force itself.

A guide is handed the force as it comes, in station seconds and newtons, and says at any moment one thing to do, how far
the body is from rest, and how long it still has to last. It decides nothing: whoever ignores it records as well.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np
from scipy.constants import g

from recordings.manifest import TestKind
from station.config import ProtocolSection, StationConfig

WINDOW_S = 1.0
"""The force of so many last seconds tells whether it rests."""
STEADY_SLOPE_N_PER_S = 1.5
STEADY_SD_N = 0.6
REST_BLOCKS = 5
"""Of the window: a body sways at a few hertz, and what is quicker is the noise of an amplifier."""
STEADY_SD_SHARE = 0.015
"""A hanging weight sways with the body; this much of the force may come and go."""
LEVEL_N, LEVEL_SHARE = 3.0, 0.08
"""How far a level may be from what its weights give: the rope's friction at a pulley is some percent."""
ELSEWHERE_S = 3.0
REST_S = 2.0
EMPTY_HOLD_S = 4.0
"""Migration counts from the empty hook, so that it is held for as long as a fit needs a load to be held."""
SWING_WINDOW_S = 4.0
LEAST_SWING_N = 2.0


class Rest(StrEnum):
    """How far the body is from rest, by the force."""

    WAITING = "no force yet"
    MOVING = "moving"
    SETTLING = "still settling"
    STEADY = "steady"
    SWINGING = "swinging"


@dataclass(frozen=True)
class Cue:
    """What to do now. left_s counts down where something must last; step counts from 0 to steps."""

    sentence: str
    rest: Rest
    step: int
    steps: int
    left_s: float | None = None
    target_n: float | None = None
    is_done: bool = False


class Guide(Protocol):
    @property
    def stages(self) -> tuple[str, ...]:
        """The names of a cue's steps, from 0 on; empty where nobody said what is to come."""
        ...

    def take(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        """Force as it came: (time s, newtons), in order; what came before the recording tells only how it was then."""
        ...

    def cue(self) -> Cue: ...


def guide_for(test: TestKind, protocol: ProtocolSection) -> Guide:
    if test == "static" and protocol.step_masses_kg:
        return StaticGuide(protocol.step_masses_kg, protocol.hold_s)
    if test == "static":
        return FreeStaticGuide(protocol.hold_s)
    return SwingGuide("bounce the weight" if test == "bounce" else "pull the spring", protocol.swing_s)


def ceilings_of(config: StationConfig) -> Ceilings:
    cell = config.load_cell
    return Ceilings(config.force_ceiling_n, config.safety.force_rate_ceiling_n_per_s, cell.capacity_n)


class RecentForce:
    """The force of the last seconds, and what can be said of it."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._points: deque[tuple[float, float]] = deque()

    def add(self, time: float, force: float) -> None:
        self._points.append((time, force))
        while self._points[-1][0] - self._points[0][0] > self._window_s:
            self._points.popleft()

    @property
    def mean(self) -> float:
        return float(np.mean([force for _, force in self._points]))

    def rest(self) -> Rest:
        if len(self._points) < 5 or self._points[-1][0] - self._points[0][0] < 0.7 * self._window_s:
            return Rest.WAITING
        time, force = np.array(self._points).T
        slope, level = np.polyfit(time - time.mean(), force, 1)
        blocks = np.array_split(force - slope * (time - time.mean()) - level, REST_BLOCKS)
        spread = float(np.std([block.mean() for block in blocks]))
        if spread > max(STEADY_SD_N, STEADY_SD_SHARE * abs(level)):
            return Rest.MOVING
        return Rest.STEADY if abs(slope) < STEADY_SLOPE_N_PER_S else Rest.SETTLING

    def swing(self) -> tuple[float, float]:
        """Frequency [Hz] and amplitude [N] of what swings about the window's mean, from its upward crossings.

        A crossing counts that came from half an amplitude below and goes as far above: noise about the mean does not.
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
    """Weights put on one by one, each level held, then taken off one by one, each level held again."""

    def __init__(self, step_masses_kg: Sequence[float], hold_s: float) -> None:
        steps = [mass * g for mass in step_masses_kg]
        rising = np.cumsum([0.0, *steps])
        self._levels = [*rising, *rising[-2::-1]]  # N above the empty hook
        self._hold_s = hold_s
        self._force = RecentForce(WINDOW_S)
        self._empty: float | None = None  # N, what the empty hook pulls
        self._step = 0
        self._held_since: float | None = None
        self._elsewhere_since: float | None = None
        self._now = 0.0
        loads = range(1, len(steps) + 1)
        self.stages = ("empty", *(f"+{load}" for load in loads), *(f"\u2212{load}" for load in reversed(loads)))

    def take(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        for time, force in points:
            self._force.add(time, force)
            self._now = time
            if is_recorded:
                self._follow()
            elif self._force.rest() is Rest.STEADY:  # in case the hands are quicker than the first telemetry
                self._empty = self._force.mean

    def cue(self) -> Cue:
        rest, steps = self._force.rest(), len(self._levels)
        if self._step == steps:
            return Cue("all weights are off and held: end the capture", rest, steps, steps, is_done=True)
        target = self._target()
        left = self._needed_s() - (self._now - self._held_since) if self._held_since is not None else self._needed_s()
        sentence = self._elsewhere() or self._order(target)
        return Cue(sentence, rest, self._step, steps, max(left, 0.0), target)

    def _follow(self) -> None:
        """One point more: does the level count as held, and for how long?"""
        if self._step == len(self._levels):
            return
        rest, level = self._force.rest(), self._force.mean
        if rest is not Rest.STEADY:
            self._held_since = self._elsewhere_since = None
        elif self._is_ahead() or (self._step and not self._is_at(self._step)):
            self._step += self._is_ahead()
            self._held_since = None
            self._elsewhere_since = self._now if self._elsewhere_since is None else self._elsewhere_since
        else:
            self._elsewhere_since = None
            self._held_since = self._now if self._held_since is None else self._held_since
            if self._now - self._held_since >= self._needed_s():
                self._empty = self._empty if self._step else level
                self._step, self._held_since = self._step + 1, None

    def _is_at(self, step: int) -> bool:
        """Whether the force is what the step's weights give, once the empty hook was weighed."""
        if self._empty is None or step >= len(self._levels):
            return False
        target = self._empty + float(self._levels[step])
        return abs(self._force.mean - target) < max(LEVEL_N, LEVEL_SHARE * abs(target))

    def _is_ahead(self) -> bool:
        """Whether the hands were quicker than the guide; on the way down a level looks like one of the way up."""
        return self._is_at(self._step + 1) and not self._is_at(self._step - 1)

    def _needed_s(self) -> float:
        """Of steady force; that it is steady is known after a window of it."""
        return (self._hold_s if self._step else EMPTY_HOLD_S) - WINDOW_S

    def _target(self) -> float | None:
        return None if self._empty is None else self._empty + float(self._levels[self._step])

    def _elsewhere(self) -> str | None:
        """The sentence for a force that rests where it should not."""
        target = self._target()
        if (
            not self._step
            or self._elsewhere_since is None
            or target is None
            or self._now - self._elsewhere_since < ELSEWHERE_S
        ):
            return None
        if abs(self._force.mean - (target - self._change())) < LEVEL_N:
            return None  # the weight of this step is not in play yet
        return f"{self._force.mean:.1f} N instead of {target:.1f} N: the right weight? Does the rope run free?"

    def _change(self) -> float:
        return float(self._levels[self._step] - self._levels[self._step - 1])

    def _order(self, target: float | None) -> str:
        if not self._step or target is None:
            return "leave the hook empty and stand still"
        weights = (len(self._levels) - 1) // 2
        if self._step <= weights:
            return f"add weight {self._step} of {weights}: {target:.0f} N, hold {self._hold_s:g} s"
        off = 2 * weights + 1 - self._step
        return f"take weight {off} off: {max(target, 0.0):.0f} N, hold {self._hold_s:g} s"


class FreeStaticGuide:
    """Weights whose masses nobody has told: counts the levels that were held."""

    stages = ()

    def __init__(self, hold_s: float) -> None:
        self._hold_s = hold_s
        self._force = RecentForce(WINDOW_S)
        self._levels: list[float] = []
        self._held_since: float | None = None
        self._now = 0.0

    def take(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        for time, force in points:
            self._now = time
            self._force.add(time, force)
            if not is_recorded or self._force.rest() is not Rest.STEADY:
                self._held_since = None
            elif self._held_since is None:
                self._held_since = time
            elif time - self._held_since >= self._hold_s and self._is_new():
                self._levels.append(self._force.mean)

    def cue(self) -> Cue:
        rest, held = self._force.rest(), len(self._levels)
        if self._held_since is not None and self._is_new():
            left = max(0.0, self._hold_s - (self._now - self._held_since))
            return Cue(f"hold it at {self._force.mean:.0f} N", rest, held, held, left)
        counted = f"{held} level{'' if held == 1 else 's'} held: " if held else ""
        return Cue(f"{counted}add a weight or take one off, and hold it for {self._hold_s:g} s", rest, held, held)

    def _is_new(self) -> bool:
        """Whether the level is another than the one held last."""
        return not self._levels or abs(self._force.mean - self._levels[-1]) > LEVEL_N


class SwingGuide:
    """A weight on a spring that swings for some time, for the dynamic test and for the bounce calibration."""

    stages = ("stand still", "swing", "rest")

    def __init__(self, what: str, swing_s: float) -> None:
        self._what, self._swing_s = what, swing_s
        self._force, self._still = RecentForce(SWING_WINDOW_S), RecentForce(WINDOW_S)
        self._swung_s = self._rested_s = 0.0
        self._now: float | None = None

    def take(self, points: Iterable[tuple[float, float]], *, is_recorded: bool = True) -> None:
        for time, force in points:
            passed = 0.0 if self._now is None or not is_recorded else time - self._now
            self._now = time
            self._force.add(time, force)
            self._still.add(time, force)
            if self._is_swinging():
                self._swung_s += passed
            elif self._still.rest() is Rest.STEADY:
                self._rested_s += passed

    def cue(self) -> Cue:
        rest, (frequency, amplitude) = self._still.rest(), self._force.swing()
        if self._swung_s >= self._swing_s:
            if rest is Rest.STEADY and not self._is_swinging():
                return Cue("it rests: end the capture", rest, 3, 3, is_done=True)
            return Cue("let it come to rest", rest, 2, 3)
        left = self._swing_s - self._swung_s
        if self._is_swinging():
            words = f"keep it swinging: {frequency:.2f} Hz, ±{amplitude:.0f} N"
            return Cue(words, Rest.SWINGING, 1, 3, left)
        if self._rested_s < REST_S and not self._swung_s:
            return Cue("stand still", rest, 0, 3, REST_S - self._rested_s)
        return Cue(f"{self._what}, about once a second", rest, 1, 3, left)

    def _is_swinging(self) -> bool:
        frequency, amplitude = self._force.swing()
        return amplitude > LEAST_SWING_N and frequency > 0.3


@dataclass(frozen=True)
class Ceilings:
    """What a cuff on a person may never see: newtons, and newtons a second over a tenth of one.

    capacity_n is the load cell's own: beyond it, in either direction, its calibration may be lost.
    """

    force_n: float
    rate_n_per_s: float
    capacity_n: float = math.inf

    def broken_by(self, points: Sequence[tuple[float, float]]) -> str | None:
        """The sentence for the stop, None while all is well."""
        for time, force in points:
            if abs(force) > self.capacity_n:
                return (
                    f"STOP: overload, {force:.0f} N on a load cell of {self.capacity_n:.0f} N; unload the rope and "
                    "check its calibration"
                )
            if force > self.force_n:
                return f"STOP: {force:.0f} N at the cuff, at most {self.force_n:.0f} N are allowed; unload the rope"
            before = [earlier for earlier in points if 0.05 <= time - earlier[0] <= 0.2]
            if before and (force - before[-1][1]) / (time - before[-1][0]) > self.rate_n_per_s:
                return (
                    f"STOP: the force rose by more than {self.rate_n_per_s:.0f} N a second; unload the rope and "
                    "look at cuff and skin"
                )
        return None
