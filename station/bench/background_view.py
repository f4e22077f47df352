"""A view with its own thread; when it falls behind, the oldest items are dropped and counted."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from types import TracebackType
from typing import Self

from recordings.samples import Item
from station.bench.snapshot import Snapshot

JOIN_TIMEOUT_S = 5.0
"""Wall seconds to wait at the end for a view that is stuck."""


class BackgroundView(ABC):
    """A context manager around a trial. offer() and show() return at once, even while the thread is busy."""

    def __init__(self, name: str, refresh_s: float, backlog: int | None) -> None:
        """backlog: items that may wait; None: all, and the end waits until they are handled."""
        self.dropped = 0
        self._refresh_s = refresh_s
        self._backlog: deque[Item] = deque(maxlen=backlog)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def offer(self, item: Item) -> None:
        if len(self._backlog) == self._backlog.maxlen:
            self.dropped += 1
        self._backlog.append(item)

    @abstractmethod
    def show(self, snapshot: Snapshot) -> None: ...

    @abstractmethod
    def _handle(self, item: Item) -> None:
        """Take one item, in the thread of the view."""

    def _refresh(self) -> None:
        """Take all items since the last refresh."""
        while self._backlog:
            self._handle(self._backlog.popleft())

    def _run(self) -> None:
        while not self._stop.wait(self._refresh_s):
            self._refresh()
        self._refresh()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(None if self._backlog.maxlen is None else JOIN_TIMEOUT_S)
