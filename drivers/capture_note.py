"""Which capture is ours: what lets a station end the one it left running when it was killed, and no other.

QTM does not say who began a capture. It numbers the frames of each from 1, though, so that its latest frame tells how
long it has run; and a note on the disk tells when ours began, until QTM has saved it. One capture runs at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

AGREES_S = 2.0
"""What the two may differ by: delays of the network and of a busy machine. Nobody ends our capture at the mocap PC,
and begins one of his own, within so short a time of our beginning."""


_DIGITS = 20
"""Of a UTC in nanoseconds, and more."""


class CaptureNote:
    """now_ns gives UTC [ns], of the same pace as QTM's frames also in the next process. Without a path there is none.

    A note that cannot be kept makes us ask a person for help, no more; so it fails silently.
    """

    def __init__(self, path: Path | None, now_ns: Callable[[], int]) -> None:
        self._path, self._now_ns = path, now_ns

    @property
    def age_s(self) -> float | None:
        """Since our capture began; None where we have left none."""
        if self._path is None or not self._path.is_file():
            return None
        try:
            with self._path.open(encoding="ascii") as file:
                return (self._now_ns() - int(file.read(_DIGITS))) * 1e-9
        except (OSError, ValueError):
            return None

    def fits(self, running_s: float) -> bool:
        """Whether a capture that has run so long is the one we left."""
        return self.age_s is not None and abs(self.age_s - running_s) < AGREES_S

    def write(self) -> None:
        """Our capture begins now."""
        if self._path is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)  # a link there would have another file written to
                with self._path.open("x", encoding="ascii") as file:
                    file.write(str(self._now_ns()))

    def erase(self) -> None:
        """It has been saved, or is not there any more."""
        if self._path is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)
