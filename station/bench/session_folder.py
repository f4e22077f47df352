"""Folders that a trial may be recorded into: measured and simulated data are never mixed in one session."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from recordings.errors import RecordingError
from recordings.manifest import DataOrigin
from recordings.reader import read_manifest
from recordings.samples import DeviceIdentity
from station.messages.codes import RefusalCode
from station.messages.message import Message

SIMULATED_FOLDER = "simulated"
"""Sessions of simulated data are recorded below a folder of this name."""


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
        present = origin_of(path)
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


def origin_of(path: Path) -> DataOrigin:
    """Origin of a recording; unknown if its manifest cannot be read."""
    with suppress(RecordingError, OSError):
        return read_manifest(path).origin
    return DataOrigin.UNKNOWN
