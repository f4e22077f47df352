"""Live values as a stream of the Lab Streaming Layer (LSL), on one network interface only, and as a table.

liblsl announces nothing. It answers queries, on ports that it opens on all interfaces, and has no setting for one.
So it listens for queries of this computer only, and the operating system binds its sockets to the device of the
interface (SO_BINDTODEVICE, Linux; decision 0042). Where that is not possible, the outlet is refused.

TRIAL.live.csv has a row for each solved frame, written while the trial runs. It is not the offline result, and no
assessment reads it. TRIAL.live.json, written at the end, has the units and the hash of the recording; without it, the
live process or the recorder ended before the trial did. A replay gives the same values if no frame was left out.
"""

from __future__ import annotations

import contextlib
import csv
import ctypes
import hashlib
import json
import os
import socket
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from documents.message import Message
from station.checksums import list_in_session, write_whole
from station.config import LiveSection
from station.errors import StationError
from station.extras import MissingExtra
from station.live.published import NAN, LiveDelivery, LiveSetup, LiveValues
from station.messages.live_messages import LiveCode
from station.versions import solver_digest, solving_versions

LOOPBACK, ANY = "loopback", "any"
DEVICE_OF_LOOPBACK = "lo"
CONTENT_TYPE = "Biomechanics"
UNITS = {"N": "newtons", "uV": "microvolts", "": "normalized"}
CONFIG = """[ports]
IPv6 = disable
[multicast]
ResolveScope = {scope}
ListenAddress = {address}
[log]
level = -2
"""
AXES = "xyz"
FOLDER = "live"
"""Of the session: beside the recordings, and not among them."""
SUFFIX = ".live.csv"


class OutletRefused(StationError):
    """The outlet cannot be opened on the interface that was asked for."""


class LslOutlet:
    """A sink. interface: "loopback", the name of a network interface such as "eth0", or "any"."""

    def __init__(self, name: str, interface: str) -> None:
        self._name, self._interface = name, interface
        self._setup: LiveSetup | None = None
        self._pylsl: Any = None
        self._outlet: Any = None
        self._offset_s = 0.0

    def begin(self, setup: LiveSetup) -> None:
        """Open the outlet. Raises OutletRefused or MissingExtra."""
        if self._interface != ANY and sys.platform != "linux":
            raise OutletRefused(Message(LiveCode.OUTLET_NOT_CONFINED, {"interface": self._interface}))
        device = DEVICE_OF_LOOPBACK if self._interface == LOOPBACK else self._interface
        if self._interface != ANY and device not in (name for _, name in socket.if_nameindex()):
            known = ", ".join(name for _, name in socket.if_nameindex())
            raise OutletRefused(Message(LiveCode.NO_INTERFACE, {"interface": self._interface, "known": known}))
        try:
            import pylsl
        except (ModuleNotFoundError, RuntimeError) as error:
            raise MissingExtra("the live outlet", "pylsl", "lsl") from error
        before = _sockets()
        _configure(pylsl, self._interface)
        outlet = pylsl.StreamOutlet(_info(pylsl, self._name, setup))
        try:
            if self._interface != ANY:
                for number in _sockets() - before:
                    _bind_to_device(number, device)
        except OSError as error:
            figures = {"interface": self._interface}
            raise OutletRefused(Message(LiveCode.OUTLET_NOT_CONFINED, figures)) from error
        self._pylsl, self._setup, self._outlet = pylsl, setup, outlet
        self._offset_s = pylsl.local_clock() - time.time()

    def begin_recording(self, recording: Path) -> None: ...

    def write(self, values: LiveValues, delivery: LiveDelivery) -> None:  # noqa: ARG002
        """Stamped with the time at which the frame was taken, by the clock of LSL."""
        if self._outlet is not None and self._setup is not None:
            self._outlet.push_sample(live_row(self._setup, values), values.host_time_s + self._offset_s)

    def note(self, kind: str, text: str) -> None: ...

    def close(self) -> None:
        self._outlet = None


def _info(pylsl: Any, name: str, setup: LiveSetup) -> Any:
    """The description, with labels, units and types of the channels as XDF has them.

    The rate is irregular: frames may be left out, and their stamps say so.
    """
    columns = live_columns(setup)
    info = pylsl.StreamInfo(
        name, CONTENT_TYPE, len(columns), pylsl.IRREGULAR_RATE, pylsl.cf_double64, f"cuffstation {setup.trial}"
    )
    info.set_channel_labels([column.name for column in columns])
    info.set_channel_units([UNITS.get(column.unit, column.unit) for column in columns])
    info.set_channel_types([column.kind for column in columns])
    acquisition = info.desc().append_child("acquisition")
    acquisition.append_child_value("manufacturer", "cuffstation")
    acquisition.append_child_value("model", setup.subject.name)
    processing = info.desc().append_child("processing")
    processing.append_child_value("result", "live")
    processing.append_child_value("lag_s", f"{setup.lag_s:g}")
    processing.append_child_value("body", "scaled" if setup.subject.is_scaled else "generic")
    processing.append_child_value("origin", setup.origin)
    return info


def _configure(pylsl: Any, interface: str) -> None:
    """To be called before the first outlet of the process: liblsl reads its settings once."""
    scope, address = ("machine", "127.0.0.1") if interface == LOOPBACK else ("link", "")
    set_content = pylsl.lib.lib.lsl_set_config_content
    set_content.argtypes, set_content.restype = [ctypes.c_char_p], None
    set_content(CONFIG.format(scope=scope, address=address).encode())


def _sockets() -> set[int]:
    """Descriptors of this process's sockets (Linux); empty elsewhere."""
    found = set()
    folder = Path("/proc/self/fd")
    for entry in folder.iterdir() if folder.is_dir() else ():
        with contextlib.suppress(OSError):
            if os.readlink(entry).startswith("socket:"):  # noqa: PTH115  (its target is no path)
                found.add(int(entry.name))
    return found


def _bind_to_device(number: int, device: str) -> None:
    """Let only packets of this network device reach a socket of liblsl. Raises OSError."""
    if sys.platform == "linux":
        with socket.socket(fileno=os.dup(number)) as one:
            if one.family == socket.AF_INET:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, device.encode() + b"\0")


@dataclass(frozen=True)
class LiveColumn:
    """name as in the file and the outlet; unit "" for a ratio; kind is the type of an XDF channel."""

    name: str
    unit: str
    kind: str


def live_columns(setup: LiveSetup) -> tuple[LiveColumn, ...]:
    """In the order of live_row(): coordinates and their rates in SI, every scenario, what was measured."""
    columns = [
        LiveColumn(f"{part}/{name}", unit, "Coordinate")
        for part, unit in (("coordinate", "rad or m"), ("speed", "per s"), ("acceleration", "per s^2"))
        for name in setup.coordinates
    ]
    for scenario in setup.scenarios:
        name = scenario.name
        columns += [
            LiveColumn(f"{name}/effort", "", "Effort"),
            LiveColumn(f"{name}/reserve_effort", "", "Effort"),
            LiveColumn(f"{name}/cord_force", "N", "Force"),
            *(LiveColumn(f"{name}/joint_force_{axis}", "N", "Force") for axis in AXES),
            *(LiveColumn(f"{name}/activation/{muscle}", "", "Activation") for muscle in setup.muscles),
        ]
    columns.append(LiveColumn("measured/cord_force", "N", "Force"))
    columns += [LiveColumn(f"measured/emg_rms/{name}", "uV", "EMG") for name in setup.emg_channels]
    return tuple(columns)


def live_row(setup: LiveSetup, values: LiveValues) -> list[float]:
    """NaN where there is no value."""
    row = [*values.coordinates, *values.speeds, *values.accelerations]
    for one in values.scenarios:
        row += [one.effort, one.reserve_effort, one.cord_force_n, *one.joint_force_n, *one.activations]
    has_emg = len(values.emg_rms_uv) == len(setup.emg_channels)
    emg: Iterable[float] = values.emg_rms_uv if has_emg else (NAN,) * len(setup.emg_channels)
    return [*row, values.cord_force_measured_n, *emg]


def live_path(recording: Path, folder: Path | None = None) -> Path:
    """Path of the live result of a recording; folder: instead of the session's."""
    return (folder or recording.parent / FOLDER) / f"{recording.stem}{SUFFIX}"


class ResultFile:
    """A sink that writes from begin_recording() on; before it nothing is recorded, and nothing kept."""

    def __init__(self, settings: LiveSection, folder: Path | None = None) -> None:
        self.path: Path | None = None
        """The table, None before it begins."""
        self._settings, self._folder = settings, folder
        self._setup: LiveSetup | None = None
        self._recording = Path()
        self._file: TextIO | None = None
        self._outcomes: Counter[str] = Counter()
        self._dropped = 0
        self._events: list[dict[str, str]] = []

    def begin(self, setup: LiveSetup) -> None:
        self._setup = setup

    def begin_recording(self, recording: Path) -> None:
        """Create the table. Raises OSError."""
        if self._setup is None or self._file is not None:
            return
        path = live_path(recording, self._folder)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("x", encoding="utf-8", newline="", buffering=1)  # a row is written at once
        self.path, self._recording = path, recording
        csv.writer(self._file).writerow(_header(self._setup))

    def write(self, values: LiveValues, delivery: LiveDelivery) -> None:
        if self._file is None or self._setup is None:
            return
        self._outcomes[str(values.outcome)] += 1
        self._dropped = delivery.dropped_frames
        csv.writer(self._file).writerow(_row(self._setup, values, delivery))

    def note(self, kind: str, text: str) -> None:
        if self._file is not None:
            self._events.append({"kind": kind, "text": text})

    def close(self, sentence: str, *, has_ended: bool) -> None:
        """has_ended: the recorder has closed the recording, and it can be hashed. Raises OSError."""
        file, self._file = self._file, None
        if file is None or self.path is None or self._setup is None:
            return
        file.close()
        if has_ended and not self._recording.exists():
            self.path.unlink()
            return
        list_in_session(self.path)
        if has_ended:
            text = json.dumps(self._description(self._setup, sentence), indent=2)
            write_whole(self.path.with_suffix(".json"), f"{text}\n")

    def _description(self, setup: LiveSetup, sentence: str) -> dict[str, Any]:
        return {
            "result": "live",
            "sentence": sentence,
            "recording": self._recording.name,
            "recording_sha256": hashlib.sha256(self._recording.read_bytes()).hexdigest(),
            "model": setup.subject.name,
            "is_scaled": setup.subject.is_scaled,
            "lag_s": setup.lag_s,
            "suits": [scenario.name for scenario in setup.scenarios],
            "frames": self._outcomes.total(),
            "dropped_frames": self._dropped,
            "outcomes": dict(self._outcomes),
            "units": {"time_s": "s", "latency_s": "s"} | {one.name: one.unit for one in live_columns(setup)},
            "events": self._events,
            "origin": setup.origin,
            "versions": {**solving_versions(), "solver": solver_digest()},
            "settings": self._settings.model_dump(mode="json"),
        }


def _header(setup: LiveSetup) -> Iterator[str]:
    yield from ("frame", "time_s", "outcome")
    yield from (f"{scenario.name}/outcome" for scenario in setup.scenarios)
    yield from (column.name for column in live_columns(setup))
    yield from ("hidden", "left_out", "exchanged", "lost", "latency_s", "dropped_frames", "every")


def _row(setup: LiveSetup, values: LiveValues, delivery: LiveDelivery) -> Iterator[Any]:
    yield from (values.frame, values.time_s, str(values.outcome))
    yield from (str(scenario.outcome) for scenario in values.scenarios)
    yield from live_row(setup, values)
    yield from map(_names, (values.hidden, values.left_out, map(" ".join, values.exchanged), values.lost))
    yield from (delivery.latency_s, delivery.dropped_frames, delivery.every)


def _names(names: Iterable[str]) -> str:
    return ";".join(names)
