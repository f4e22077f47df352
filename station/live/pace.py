"""What is left out when the computer is too slow: first the muscles of some frames, then whole frames."""

from __future__ import annotations

MOST_LATENCY_S = 0.025
"""From the arrival of a frame to the start of its solution; above it the muscles are solved in fewer frames."""
DROP_LATENCY_S = 0.1
"""Above it frames are dropped until the newest one."""
LARGEST_EVERY = 16
SLOW_DOWN_S, SPEED_UP_S = 0.3, 3.0
"""Least time between two changes of pace: the effect of a change must show before the next."""


class Pace:
    """Muscles are solved in one of every `every` frames. All times are seconds of one clock, which the caller reads."""

    def __init__(self) -> None:
        self.every = 1
        self.dropped = 0
        self._frames = 0
        self._changed_s = self._dropped_s = float("-inf")
        self._late_s = float("-inf")

    def drops(self, now_s: float, latency_s: float, *, is_newest: bool) -> bool:
        """Whether to drop a frame that has waited so long."""
        if latency_s <= DROP_LATENCY_S or is_newest:
            return False
        self.dropped, self._dropped_s = self.dropped + 1, now_s
        return True

    def has_dropped_lately(self, now_s: float) -> bool:
        return now_s - self._dropped_s < SPEED_UP_S

    def solves_muscles(self, now_s: float, latency_s: float) -> bool:
        """Whether to solve the muscles of the next frame."""
        if latency_s > MOST_LATENCY_S:
            self._late_s = now_s
            if now_s - self._changed_s >= SLOW_DOWN_S and self.every < LARGEST_EVERY:
                self.every, self._changed_s = 2 * self.every, now_s
        elif self.every > 1 and now_s - max(self._changed_s, self._late_s) >= SPEED_UP_S:
            self.every, self._changed_s = self.every // 2, now_s
        self._frames += 1
        return self._frames % self.every == 0
