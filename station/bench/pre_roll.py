"""Samples from before the sync edge: kept in memory while armed, cut to two seconds at the edge."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from recordings.samples import Item, Loss, Samples

PRE_ROLL_S = 2.0
"""Station seconds kept from before the edge."""
LATENESS_S = 1.0
"""Station seconds by which samples of one device may arrive after those of another; the pre-roll is longer by it."""


class PreRoll:
    """The items of the last few seconds, in the order of arrival."""

    def __init__(self, is_of_daq: Callable[[str], bool] = lambda stream: stream != "/markers") -> None:
        """is_of_daq: whether a stream, by name, is on the clock of the sync line."""
        self._items: deque[Item] = deque()
        self._is_of_daq = is_of_daq

    def append(self, item: Item) -> None:
        """Keep the item, and drop those that are too old."""
        self._items.append(item)
        oldest_ns = item.host_time_ns - int((PRE_ROLL_S + LATENESS_S) * 1e9)
        while self._items and self._items[0].host_time_ns < oldest_ns:
            self._items.popleft()

    def drop_before(self, fall_device_ns: int) -> None:
        """The sync line fell: earlier samples of the DAQ belong to an earlier capture."""
        kept = ((_from(item, fall_device_ns) if self._has_daq_time(item) else item) for item in self._items)
        self._items = deque(item for item in kept if item is not None)

    def drop_frames(self) -> None:
        """The frames so far are from an earlier capture or a preview; their numbers are unrelated to this capture."""
        self._items = deque(
            item for item in self._items if not (isinstance(item, Samples | Loss) and item.stream == "/markers")
        )

    def take_from(self, edge_device_ns: int) -> list[Item]:
        """Remove and return the items: force and sync from 2 s before the edge, and all of the other streams."""
        first_ns = edge_device_ns - int(PRE_ROLL_S * 1e9)
        kept = [item for item in self._items if not (self._has_daq_time(item) and _ends_before(item, first_ns))]
        self._items.clear()
        return kept

    def _has_daq_time(self, item: Item) -> bool:
        return isinstance(item, Samples | Loss) and self._is_of_daq(item.stream)


def _from(item: Item, device_time_ns: int) -> Item | None:
    """The part of a DAQ block from this device time on, None if there is none; other items unchanged."""
    if isinstance(item, Loss):
        return item if item.last_device_time_ns >= device_time_ns else None
    if not isinstance(item, Samples):
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
    """Whether a block of the DAQ ends before this device time; False for all other items."""
    if not isinstance(item, Samples):
        return False
    return len(item.device_time_ns) > 0 and int(item.device_time_ns[-1]) < device_time_ns
