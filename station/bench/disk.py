"""Room on the session's disk: enough for what is planned before anything is armed, and watched while it is recorded."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

from recordings.samples import Stream
from station.clock import Clock
from station.config import StationConfig
from station.protocol import published_plan

RESERVE_BYTES = 50e6
"""Below this a trial is closed while there is room for its end: 15 s of a hundred markers at 1 kHz, and the index."""
USUAL_TRIAL_S = 120.0
"""Station seconds that a trial is taken for where its duration is not given."""
GLANCE_S = 1.0
"""Wall seconds between two looks."""


def bytes_needed(streams: Iterable[Stream], config: StationConfig, folder: Path, duration_s: float | None) -> float:
    """What the trials of the plan that are not in the folder yet will take, and the reserve."""
    planned = sum(1 for _ in published_plan(config.cuffs, config.protocol.repeats))
    ahead = max(1, planned - sum(1 for _ in folder.glob("*.mcap")))
    # As FORMAT.md packs them, uncompressed; a tenth more for what stands around the values.
    per_second = sum(one.rate_hz * len(one.labels) * (16 if one.name == "/markers" else 8) for one in streams)
    return RESERVE_BYTES + 1.1 * per_second * ahead * (duration_s or USUAL_TRIAL_S)


def bytes_free(folder: Path) -> int:
    """On the disk that holds the folder, or would. Raises OSError where it cannot be told."""
    there = next(each for each in (folder.resolve(), *folder.resolve().parents) if each.is_dir())
    return shutil.disk_usage(there).free


class DiskWatch:
    """Looks once a second whether the reserve is still there."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._folder, self._clock = folder, clock
        self._next_s = clock.wall_s()

    def warning(self) -> str | None:
        """One sentence once the disk is nearly full, else None. A disk that is gone is told by the next write."""
        if self._clock.wall_s() < self._next_s:
            return None
        self._next_s = self._clock.wall_s() + GLANCE_S
        try:
            free = bytes_free(self._folder)
        except OSError:
            return None
        if free >= RESERVE_BYTES:
            return None
        return (
            f"the disk of {self._folder} has {free / 1e6:.0f} MB left, and {RESERVE_BYTES / 1e6:.0f} MB are kept for "
            "ending well: the trial was closed with everything that had come; free some room and record it again"
        )
