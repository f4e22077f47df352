"""Queue between the thread of a connection and the thread that reads the device."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from drivers.errors import DeviceCode, DeviceLost
from recordings.samples import Event, Item, Loss, Samples


class Inbox:
    """At most longest_queue samples and events; consecutive blocks beyond that become one Loss.

    end() closes the queue with the error that take() raises once it is empty.
    """

    def __init__(self, longest_queue: int) -> None:
        self._longest_queue = longest_queue
        self._changed = threading.Condition()
        self._items: deque[Item] = deque()
        self._held = 0
        self._last_time_ns = 0  # of the last sample that was admitted
        self._end: tuple[str, DeviceCode] | None = None

    def put(self, items: Sequence[Item]) -> None:
        with self._changed:
            for item in items:
                self._put(item)
            self._changed.notify_all()

    def end(self, sentence: str, code: DeviceCode) -> None:
        """Close the queue with the reason; the first reason is kept."""
        with self._changed:
            self._end = self._end or (sentence, code)
            self._changed.notify_all()

    def take(self, timeout_s: float) -> list[Item]:
        """All queued items. Waits at most timeout_s for the first. Raises DeviceLost once closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._end, timeout_s)
            if not self._items and self._end:
                raise DeviceLost(*self._end)
            items = list(self._items)
            self._items.clear()
            self._held = 0
            return items

    def _put(self, item: Item) -> None:
        count = len(item.sample_numbers) if isinstance(item, Samples) else 1
        if self._held + count <= self._longest_queue:
            self._held += count
            self._items.append(item)
            if isinstance(item, Samples):
                self._last_time_ns = int(item.device_time_ns[-1])
        elif not isinstance(item, Event):  # events beyond the limit are dropped
            self._put_loss(item)

    def _put_loss(self, item: Samples | Loss) -> None:
        first, count = (
            (item.first_missing, item.count)
            if isinstance(item, Loss)
            else (int(item.sample_numbers[0]), len(item.sample_numbers))
        )
        last = self._items[-1] if self._items else None
        if isinstance(last, Loss) and last.stream == item.stream and last.first_missing + last.count == first:
            self._items[-1] = replace(last, cause="queue_overflow", count=last.count + count)
        else:
            self._items.append(Loss(item.stream, "queue_overflow", first, count, self._last_time_ns, item.host_time_ns))
