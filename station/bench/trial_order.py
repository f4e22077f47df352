"""Keep the trials of a session in order, also if the system's clock is set back between two of them."""

from __future__ import annotations

import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from recordings.errors import RecordingError
from recordings.reader import read_manifest
from station.messages.codes import TrialCode
from station.messages.message import Message

AHEAD_S = 1.0
"""Wall seconds by which the time of a file may be ahead of the clock: file systems round."""


def start_time_after_all(folder: Path, start_utc_ns: int) -> tuple[int, Message[TrialCode] | None]:
    """UTC [ns] for a trial that starts now, later than every trial in the folder; a message if the clock was set back.

    Migration and calibration depend on this order. The clock was set back if a file was written at a future time; the
    start time of a recording is no evidence, because a replay has a start time in the past.
    """
    paths = list(folder.glob("*.mcap"))
    written_s = max((path.stat().st_mtime for path in paths), default=0.0)
    if written_s < (now_s := time.time()) + AHEAD_S:
        return start_utc_ns, None
    latest_ns = max(map(_start_utc_ns, paths))
    message = Message(TrialCode.CLOCK_SET_BACK, {"now_utc": _utc(now_s), "last_utc": _utc(written_s)})
    return max(start_utc_ns, latest_ns + 1), message


def _start_utc_ns(path: Path) -> int:
    with suppress(RecordingError, OSError):
        return read_manifest(path).start_utc_ns
    return 0


def _utc(seconds: float) -> str:
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC"
