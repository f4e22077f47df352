"""What came before the sync edge: kept in memory while armed, and cut to two seconds when the edge comes."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from recordings.samples import Item, Loss, Samples

PRE_ROLL_S = 2.0
"""Station seconds kept from before the edge."""
LATENESS_S = 1.0
"""Station seconds by which one device's samples may arrive after another's; the pre-roll waits that much longer."""


class PreRoll:
    """The items of the last few seconds, in the order of arrival."""

    def __init__(self) -> None:
        self._items: deque[Item] = deque()

    def keep(self, item: Item) -> None:
        """Takes one more, and forgets what is too old to matter."""
        self._items.append(item)
        oldest_ns = item.host_time_ns - int((PRE_ROLL_S + LATENESS_S) * 1e9)
        while self._items and self._items[0].host_time_ns < oldest_ns:
            self._items.popleft()

    def forget_before(self, fall_device_ns: int) -> None:
        """The sync line fell: what the DAQ sent before belongs to an earlier capture."""
        self._items = deque(kept for item in self._items if (kept := _from(item, fall_device_ns)) is not None)

    def forget_frames(self) -> None:
        """The frames so far are an earlier capture's, or a preview's: their numbers have nothing to do with ours."""
        self._items = deque(
            item for item in self._items if not (isinstance(item, Samples | Loss) and item.stream == "/markers")
        )

    def cut(self, edge_device_ns: int) -> list[Item]:
        """Hands over force and sync from 2 s before the edge on, and of the other streams all that was kept."""
        first_ns = edge_device_ns - int(PRE_ROLL_S * 1e9)
        kept = [item for item in self._items if not _ends_before(item, first_ns)]
        self._items.clear()
        return kept


def _from(item: Item, device_time_ns: int) -> Item | None:
    """The part of a block from the DAQ from a moment of its clock on, None where there is none; other items whole."""
    if isinstance(item, Loss) and item.stream != "/markers":
        return item if item.last_device_time_ns >= device_time_ns else None
    if not isinstance(item, Samples) or item.stream == "/markers":
        return item
    first = int(np.searchsorted(item.device_time_ns, device_time_ns))
    if first == 0 or first == len(item.device_time_ns):
        return item if first == 0 else None
    return replace(
        item,
        sample_numbers=item.sample_numbers[first:],
        device_time_ns=item.device_time_ns[first:],
        values=item.values[first:],
    )


def _ends_before(item: Item, device_time_ns: int) -> bool:
    """Whether a block from the DAQ lies wholly before a moment of its clock; only DAQ blocks can tell."""
    if not isinstance(item, Samples) or item.stream == "/markers":
        return False
    return len(item.device_time_ns) > 0 and int(item.device_time_ns[-1]) < device_time_ns
