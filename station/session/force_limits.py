"""Limits of force and force rate on a cuff that a person wears; exceeding one raises an alarm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from station.config import StationConfig
from station.messages.codes import AlarmCode
from station.messages.message import Message

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
