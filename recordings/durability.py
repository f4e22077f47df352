"""From the operating system onto the disk: what a power cut cannot take back."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

LONGEST_FINISH_S = 60.0
"""Wall seconds that the end of a recording waits for its disk: far longer than a slow one takes, and not for ever."""


def in_a_thread(work: Callable[[], None]) -> None:
    """A thread that a disk holds for ever is left behind when the process ends."""
    threading.Thread(target=work, name="fsync", daemon=True).start()


class BackgroundSync:
    """Has the disk take what was written, without holding up who writes: an fsync can take longer than a kill may cost.

    One at a time. failure is what one failed with, for good.
    """

    def __init__(self, sync: Callable[[], None], start: Callable[[Callable[[], None]], None] = in_a_thread) -> None:
        self._sync, self._start = sync, start
        self._idle = threading.Event()
        self._idle.set()
        self.failure: Exception | None = None

    @property
    def is_busy(self) -> bool:
        """Whether one is under way."""
        return not self._idle.is_set()

    def begin(self) -> None:
        """Starts one, of all that is written by now, and returns at once."""
        self._idle.clear()
        self._start(self._run)

    def finish(self) -> None:
        """Does one and returns when it is done; first waits for the one under way. A disk that hangs has failed."""
        if self._idle.wait(LONGEST_FINISH_S):
            self.begin()
        if not self._idle.wait(LONGEST_FINISH_S):
            self.failure = TimeoutError(errno.ETIMEDOUT, "the disk does not answer")
            self._idle.set()  # no caller waits for it any more

    def _run(self) -> None:
        try:
            self._sync()
        except Exception as error:
            self.failure = error
        finally:
            self._idle.set()


def sync_folder(folder: Path) -> None:
    """Has the disk take the folder's list of files: the name of a new file is not in the file itself.

    Windows cannot open a folder, and journals its entries itself; fsync of the file reports a failing disk.
    """
    with suppress(OSError):
        opened = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(opened)
        finally:
            os.close(opened)
