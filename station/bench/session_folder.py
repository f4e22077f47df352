"""Folders that a trial may be recorded into, and the free space of their disk.

Measured and simulated data are never mixed in one session. Free space is checked for the whole plan before arming, and
monitored while recording.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from documents.message import Figures, Message
from recordings.errors import RecordingError
from recordings.manifest import DataOrigin
from recordings.reader import read_manifest
from recordings.samples import DeviceIdentity, Stream
from station.clock import Clock
from station.config import StationConfig
from station.messages.bench_messages import RefusalCode, TrialCode
from station.protocol import published_plan

SIMULATED_FOLDER = "simulated"
"""Sessions of simulated data are recorded below a folder of this name."""
RESERVE_BYTES = 50e6
"""Below this a trial is closed while its end still fits: 15 s of a hundred markers at 1 kHz, and the index."""
USUAL_TRIAL_S = 120.0
"""Station seconds assumed for a trial without a given duration."""
POLL_INTERVAL_S = 1.0
"""Wall seconds between two checks."""


def check_folder(folder: Path, devices: Sequence[DeviceIdentity]) -> Message[RefusalCode] | None:
    """Reason why samples of these devices cannot be recorded into the folder; None if they can."""
    is_simulated = DataOrigin.of_devices(devices) is DataOrigin.SIMULATED
    if is_simulated and not is_for_simulated(folder):
        figures = {
            "devices": ", ".join(device.name for device in devices if device.is_simulated),
            "folder": str(folder),
            "simulated_folder": SIMULATED_FOLDER,
            "place": str(folder.parent / SIMULATED_FOLDER / folder.name),
        }
        return Message(RefusalCode.SIMULATED_DEVICES, figures)
    return check_origin(folder, devices)


def check_origin(folder: Path, devices: Sequence[DeviceIdentity]) -> Message[RefusalCode] | None:
    """Reason why the trial would mix measured and simulated data in one folder; None if it would not."""
    origin = DataOrigin.of_devices(devices)
    if origin is DataOrigin.UNKNOWN:
        return None
    for path in sorted(folder.glob("*.mcap")):
        present = read_origin(path)
        if present is origin:
            return None
        if present is not DataOrigin.UNKNOWN:
            figures = {"folder": str(folder), "present": present, "file": path.name, "origin": origin}
            return Message(RefusalCode.MIXED_ORIGIN, figures)
    return None


def is_for_simulated(folder: Path) -> bool:
    """Whether sessions of simulated data may be recorded into the folder."""
    return SIMULATED_FOLDER in folder.resolve().parts


def rehearsal_folder() -> Path:
    """A temporary folder for any devices; delete its parent afterwards."""
    return Path(tempfile.mkdtemp(prefix="rehearsal-")) / SIMULATED_FOLDER


def read_origin(path: Path) -> DataOrigin:
    """Origin of a recording; unknown if its manifest cannot be read."""
    with suppress(RecordingError, OSError):
        return read_manifest(path).origin
    return DataOrigin.UNKNOWN


def bytes_needed(streams: Iterable[Stream], config: StationConfig, folder: Path, duration_s: float | None) -> float:
    """Size of the planned trials that are not in the folder yet, plus the reserve."""
    planned = sum(1 for _ in published_plan(config.cuffs, config.protocol.repeats))
    ahead = max(1, planned - sum(1 for _ in folder.glob("*.mcap")))
    # As packed by FORMAT.md, uncompressed; 10 % more for the headers of the messages.
    per_second = sum(
        stream.rate_hz * len(stream.labels) * (16 if stream.name == "/markers" else 8) for stream in streams
    )
    return RESERVE_BYTES + 1.1 * per_second * ahead * (duration_s or USUAL_TRIAL_S)


def bytes_free(folder: Path) -> int:
    """Free bytes on the disk of the folder, which need not exist yet. Raises OSError if the disk does not answer."""
    existing = next(path for path in (folder.resolve(), *folder.resolve().parents) if path.is_dir())
    return shutil.disk_usage(existing).free


class DiskMonitor:
    """Checks once a second whether the reserve is still free, and the recording, which exists, in its place."""

    def __init__(self, recording: Path, clock: Clock) -> None:
        self._recording, self._folder, self._clock = recording, recording.parent, clock
        self._next_s, self._identity = clock.wall_s(), recording.stat()

    def moved(self) -> Message[TrialCode] | None:
        """A message if the path no longer names the file that is being written: not even a copy of it."""
        try:
            is_same = os.path.samestat(self._recording.stat(), self._identity)
        except OSError as error:  # a disk without an answer shows at the next write
            is_same = not isinstance(error, FileNotFoundError | NotADirectoryError)
        return None if is_same else Message(TrialCode.RECORDING_MOVED, {"path": str(self._recording)})

    def poll(self) -> Message[TrialCode] | None:
        """A message once the disk is nearly full or the file moved. A disk that is gone shows at the next write."""
        if self._clock.wall_s() < self._next_s:
            return None
        self._next_s = self._clock.wall_s() + POLL_INTERVAL_S
        if message := self.moved():
            return message
        try:
            free = bytes_free(self._folder)
        except OSError:
            return None
        if free >= RESERVE_BYTES:
            return None
        figures: Figures = {"folder": str(self._folder), "free_mb": free / 1e6, "reserve_mb": RESERVE_BYTES / 1e6}
        return Message(TrialCode.DISK_NEARLY_FULL, figures)
