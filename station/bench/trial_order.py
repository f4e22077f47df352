"""The order of a session's trials: kept also where the system's clock is set back between two of them."""

from __future__ import annotations

import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from recordings.errors import RecordingError
from recordings.reader import read_manifest

AHEAD_S = 1.0
"""Wall seconds by which a file's time may lie ahead of the clock: file systems round."""


def start_after_all_in(folder: Path, start_utc_ns: int) -> tuple[int, str]:
    """UTC [ns] of a trial that starts now and comes after all in the folder; a sentence where the clock was set back.

    Migration and calibration follow this order, so a clock that was set back must not reverse it. It was, where a
    recording was written at a time that has not come yet: a replay, too, has start times of the past.
    """
    paths = list(folder.glob("*.mcap"))
    written_s = max((path.stat().st_mtime for path in paths), default=0.0)
    if written_s < (now_s := time.time()) + AHEAD_S:
        return start_utc_ns, ""
    latest_ns = max(map(_start_utc_ns, paths))
    return max(start_utc_ns, latest_ns + 1), (
        f"the system's clock says {_utc(now_s)}, and the session's last file was written at {_utc(written_s)}: the "
        "clock was set back. This trial is dated after the others, so that their order holds; check date and time"
    )


def _start_utc_ns(path: Path) -> int:
    with suppress(RecordingError, OSError):
        return read_manifest(path).start_utc_ns
    return 0


def _utc(seconds: float) -> str:
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC"
