"""Where a trial may be recorded: measured and simulated data never share a session's folder."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from recordings.errors import RecordingError
from recordings.manifest import DataOrigin
from recordings.reader import read_manifest
from recordings.samples import DeviceIdentity

SIMULATED_FOLDER = "simulated"
"""Sessions of simulated data are recorded below a folder of this name."""


def why_not_here(folder: Path, devices: Sequence[DeviceIdentity]) -> str:
    """Why what these devices send cannot be recorded into the folder, in a sentence; "" if it can."""
    is_simulated = DataOrigin.of_devices(devices) is DataOrigin.SIMULATED
    if is_simulated and not is_for_simulated(folder):
        place = folder.parent / SIMULATED_FOLDER / folder.name
        return (
            f"{who_is_simulated(devices)}, and {folder} is not below a folder called {SIMULATED_FOLDER}; give "
            f"--session {place}, or start the console with --simulated"
        )
    return why_mixed(folder, devices)


def is_for_simulated(folder: Path) -> bool:
    """Whether sessions of simulated data may be recorded into the folder."""
    return SIMULATED_FOLDER in folder.resolve().parts


def rehearsal_folder() -> Path:
    """A folder for any devices, of which nothing is kept; its parent is to be deleted with it."""
    return Path(tempfile.mkdtemp(prefix="rehearsal-")) / SIMULATED_FOLDER


def why_mixed(folder: Path, devices: Sequence[DeviceIdentity]) -> str:
    """Why the trial would mix measured and simulated data in one folder; "" if it would not."""
    origin = DataOrigin.of_devices(devices)
    if origin is DataOrigin.UNKNOWN:
        return ""
    for path in sorted(folder.glob("*.mcap")):
        there = origin_of(path)
        if there is not DataOrigin.UNKNOWN:
            words = f"{folder} holds {there} data ({path.name}), and this trial's would be {origin}"
            return "" if there is origin else f"{words}; give a session's folder of its own"
    return ""


def who_is_simulated(devices: Sequence[DeviceIdentity]) -> str:
    """A clause that names the devices."""
    names = [device.name for device in devices if device.is_simulated]
    return f"{names[0]} says that it is simulated" if len(names) == 1 else f"{' and '.join(names)} say: simulated"


def origin_of(path: Path) -> DataOrigin:
    """Of a recording; unknown where its manifest cannot be read."""
    with suppress(RecordingError, OSError):
        return read_manifest(path).origin
    return DataOrigin.UNKNOWN
