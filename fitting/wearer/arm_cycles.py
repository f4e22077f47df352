"""Elevation of the arm from four markers, and the cycles of raising and lowering it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEAST_SWING = float(np.radians(25.0))
"""A smaller reversal [rad] is part of the movement that it interrupts."""
LEAST_SHARE = 0.5
"""Smallest raise of a cycle over the largest one of the trial; smaller ones are attempts, or the hand at the face."""
REST_SHARE = 0.1
"""Part of a rise or fall below which the arm is at rest."""


def elevation(shoulder: Floats, elbow: Floats, upper: Floats, lower: Floats) -> Floats:
    """(frames,) angle [rad] between the upper arm and the trunk, from markers (frames, 3) in any unit and frame.

    0 for an arm along the trunk, π for an arm overhead; NaN where a marker is missing. Like the thoracohumeral
    elevation of the ISB (G. Wu et al., J. Biomech. 38(5):981-992, 2005) it does not depend on the tilt of the trunk.
    """
    arm, trunk = elbow - shoulder, lower - upper
    with np.errstate(invalid="ignore"):
        across = np.linalg.norm(np.cross(arm, trunk), axis=1)
        return np.asarray(np.arctan2(across, np.sum(arm * trunk, axis=1)))


def elevation_of(markers: Floats, labels: Sequence[str], arm: Sequence[str], trunk: Sequence[str]) -> Floats | None:
    """Elevation (frames,) [rad] from markers (frames, labels, 3); None if a label is not declared or not recorded."""
    wanted = (*arm, *trunk)
    if len(wanted) != 4 or not set(wanted) <= set(labels):
        return None
    return elevation(*(markers[:, labels.index(label)].astype(np.float64) for label in wanted))


@dataclass(frozen=True)
class ArmCycle:
    """One raise of the arm and back: start, peak and end [s]; lowest elevation before it and highest in it [rad]."""

    start: float
    peak: float
    end: float
    lowest: float
    highest: float


class CycleDetector:
    """Online detection of cycles by turning points of the elevation that are at least LEAST_SWING apart.

    turns: time [s] and elevation [rad] of the minimum before every completed cycle, and of its maximum. A cycle is
    complete once the arm has fallen by LEAST_SWING from its maximum.
    """

    def __init__(self) -> None:
        self.turns: list[tuple[float, float, float, float]] = []
        self._valley: tuple[float, float] | None = None
        self._peak: tuple[float, float] | None = None  # of the present raise

    @property
    def is_raised(self) -> bool:
        """Whether a raise has begun and the arm is not down again."""
        return self._peak is not None

    def update(self, times: Iterable[float], elevations: Iterable[float]) -> None:
        """Add elevations [rad] at increasing times [s]; NaN is ignored."""
        for time, angle in zip(times, elevations, strict=True):
            if np.isfinite(angle):
                self._add(float(time), float(angle))

    def _add(self, time: float, angle: float) -> None:
        if self._valley is None or (self._peak is None and angle <= self._valley[1]):
            self._valley = time, angle
        elif self._peak is None:
            self._peak = (time, angle) if angle - self._valley[1] >= LEAST_SWING else None
        elif angle > self._peak[1]:
            self._peak = time, angle
        elif self._peak[1] - angle >= LEAST_SWING:
            self.turns.append((*self._valley, *self._peak))
            self._valley, self._peak = (time, angle), None


def find_cycles(time: Floats, angle: Floats) -> tuple[ArmCycle, ...]:
    """Cycles of a trial from the elevation (frames,) [rad] at time (frames,) [s]; low raises are left out.

    A cycle starts at the end of the lowest tenth of its rise, and ends at the start of the lowest tenth of its fall.
    """
    detector = CycleDetector()
    detector.update(time, angle)
    rises = [peak - valley for _, valley, _, peak in detector.turns]
    highest, bounds = max(rises, default=0.0), [*(turn[0] for turn in detector.turns[1:]), float(time[-1])]
    return tuple(
        _cycle(time, angle, turn, until)
        for turn, rise, until in zip(detector.turns, rises, bounds, strict=False)
        if rise >= LEAST_SHARE * highest
    )


def _cycle(time: Floats, angle: Floats, turn: tuple[float, float, float, float], until: float) -> ArmCycle:
    """The cycle of a turn; the arm is down again before `until` [s]."""
    valley_time, valley, peak_time, peak = turn
    rising = (time >= valley_time) & (time <= peak_time) & (angle < valley + REST_SHARE * (peak - valley))
    falling = (time >= peak_time) & (time <= until)
    after = float(np.nanmin(angle[falling]))
    down = time[falling & (angle <= after + REST_SHARE * (peak - after))]
    return ArmCycle(float(time[rising][-1]), peak_time, float(down[0]), valley, peak)
