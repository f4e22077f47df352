"""Detect that the station's computer is too slow for its devices: late reads and overwritten samples."""

from __future__ import annotations

from recordings.samples import Event, Item, Loss
from station.messages.codes import TrialCode
from station.messages.message import Message

OVERWRITTEN = ("overrun", "queue_overflow")
"""Causes of a Loss that only a late reader produces."""
LATE_S = 1.0
"""Station seconds from the arrival of a sample at the driver to its recording; usually 0.02."""


class OverloadMonitor:
    """Checks every recorded item of a trial."""

    def __init__(self) -> None:
        self._overwritten = 0
        self._longest_wait_s = 0.0
        self._is_reported = False

    def update(self, item: Item, now_ns: int) -> tuple[Message[TrialCode], ...]:
        """The messages of the first overload of the trial; empty before and afterwards."""
        if isinstance(item, Loss) and item.cause in OVERWRITTEN:
            self._overwritten += item.count
        elif not isinstance(item, Event):
            self._longest_wait_s = max(self._longest_wait_s, (now_ns - item.host_time_ns) * 1e-9)
        messages = self.messages
        if self._is_reported or not messages:
            return ()
        self._is_reported = True
        return messages

    @property
    def messages(self) -> tuple[Message[TrialCode], ...]:
        """The cost of the overload so far; empty if there was none."""
        found = []
        if self._overwritten:
            found.append(Message(TrialCode.OVERWRITTEN, {"samples": self._overwritten}))
        if self._longest_wait_s > LATE_S:
            found.append(Message(TrialCode.LATE, {"late_s": self._longest_wait_s}))
        return tuple(found)
