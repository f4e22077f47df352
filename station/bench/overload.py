"""Signs that the station's computer is too slow for its devices: what it took too late, and what it did not take."""

from __future__ import annotations

from recordings.samples import Event, Item, Loss

OVERWRITTEN = ("overrun", "queue_overflow")
"""Causes of a Loss that only a reader who comes too late has."""
LATE_S = 1.0
"""Station seconds from a sample's arrival at the driver to its recording; usual are 0.02."""


class Overload:
    """Judges each item of a trial that is recorded."""

    def __init__(self) -> None:
        self._overwritten = 0
        self._latest_s = 0.0
        self._was_told = False

    def feed(self, item: Item, now_ns: int) -> str:
        """The first sign of an overload as a sentence, else ""."""
        if isinstance(item, Loss) and item.cause in OVERWRITTEN:
            self._overwritten += item.count
        elif not isinstance(item, Event):
            self._latest_s = max(self._latest_s, (now_ns - item.host_time_ns) * 1e-9)
        if self._was_told or not self.sentence:
            return ""
        self._was_told = True
        return self.sentence

    @property
    def sentence(self) -> str:
        """What an overload cost so far; "" where there was none."""
        costs = []
        if self._overwritten:
            costs.append(f"{self._overwritten} samples were overwritten before it read them")
        if self._latest_s > LATE_S:
            costs.append(f"samples waited {self._latest_s:.1f} s until it recorded them")
        if not costs:
            return ""
        return f"this computer is too slow: {' and '.join(costs)}; close other programs, or take a faster one"
