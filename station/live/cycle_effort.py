"""Effort per arm cycle, and the best rest length of the motion so far."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fitting.wearer.arm_cycles import CycleDetector
from solver.suit.curve_minimum import find_minimum
from station.live.published import NAN, LiveBest, LiveRecent

Array = NDArray[np.float64]

RECENT_CYCLES = 3
LEAST_RAISE = 0.5
"""Of the highest raise so far; lower ones are attempts, as in find_cycles."""
LONGEST_CYCLE_S = 60.0
LEAST_LENGTHS = 3
SLACK = "slack"


class CycleEffort:
    """Mean effort of every scenario from one peak of the arm to the next; efforts are over that of the slack suit."""

    def __init__(self, scenarios: Sequence[str]) -> None:
        self._names = tuple(scenarios)
        self._detector = CycleDetector()
        self._frames: deque[tuple[float, Array]] = deque()
        self._turns = 0
        self.cycles: list[Array] = []

    def add(self, time_s: float, elevation: float, effort: Mapping[str, float]) -> bool:
        """Take a frame; returns whether a cycle has ended. Efforts are NaN where a scenario has no solution."""
        self._frames.append((time_s, np.array([effort.get(name, np.nan) for name in self._names])))
        while self._frames[0][0] < time_s - LONGEST_CYCLE_S:
            self._frames.popleft()
        self._detector.update([time_s], [elevation])
        turns = self._detector.turns
        if len(turns) == self._turns:
            return False
        self._turns = len(turns)
        return len(turns) > 1 and self._end_cycle(turns[-2], turns[-1])

    def restart(self) -> None:
        """Forget the cycles: they were with another rest length."""
        self.cycles.clear()
        self._frames.clear()

    def recent(self) -> LiveRecent | None:
        """Of the last cycles; None before the first has ended."""
        if not self.cycles:
            return None
        recent = self.cycles[-RECENT_CYCLES:]
        mean = np.mean(recent, axis=0)
        return LiveRecent(len(recent), {name: float(value) for name, value in zip(self._names, mean, strict=True)})

    def best(self, rest_lengths: Mapping[str, float]) -> LiveBest | None:
        """Over these scenarios, which differ in their rest length only; None for fewer than three or no cycle."""
        by_length = {length: name for name, length in rest_lengths.items()}
        lengths = np.array(sorted(by_length))
        names = [by_length[length] for length in lengths.tolist()]
        if len(lengths) < LEAST_LENGTHS or not self.cycles:
            return None
        costs = np.array(self.cycles)[:, [self._names.index(name) for name in names]]
        pooled = find_minimum(lengths, costs.mean(axis=0))
        if pooled.edge:
            end = -1 if pooled.edge > 0 else 0
            return LiveBest(float(lengths[end]), NAN, float(costs.mean(axis=0)[end]), len(costs), pooled.edge)
        minima = [_lowest(lengths, cost) for cost in costs]
        spread = float(np.std(minima, ddof=1)) if len(minima) > 1 else NAN
        return LiveBest(pooled.rest_length, spread, pooled.cost, len(costs))

    def _end_cycle(self, before: tuple[float, ...], last: tuple[float, ...]) -> bool:
        """Keep the mean of the cycle between two peaks, if every scenario has a solution in it."""
        raises = [peak - valley for _, valley, _, peak in self._detector.turns]
        if min(raises[-2:]) < LEAST_RAISE * max(raises):
            return False
        inside = [effort for time_s, effort in self._frames if before[2] <= time_s < last[2]]
        if not inside:
            return False
        solved = np.array([effort for effort in inside if np.isfinite(effort).all()])
        if len(solved) < 0.5 * len(inside):
            return False
        mean = solved.mean(axis=0)
        self.cycles.append(mean / mean[self._names.index(SLACK)])
        return True


def _lowest(lengths: Array, cost: Array) -> float:
    """Best rest length of one cycle [m]; at the edge the one that was tried there."""
    found = find_minimum(lengths, cost)
    return float(lengths[np.argmin(cost)]) if found.edge else found.rest_length
