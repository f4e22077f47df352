"""Live results of a trial: an MCAP file of their own, which is never taken for a recording (FORMAT.md, Live results).

One process writes it while the trial runs, and another may read it then or after a crash: a file without an outcome is
incomplete, and what can be read of it is kept.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from documents.regular_file import open_regular
from recordings.chunks import Damage, Entry, read_entries
from recordings.errors import RecordingCode, RecordingError
from recordings.samples import Event
from recordings.topics import SCHEMAS, register_topics, wire_classes
from recordings.writer import sync_folder

FORMAT_VERSION = 1
PROFILE = "cuffstation-live"
MANIFEST, VALUES, EVENTS, OUTCOME = "/live_manifest", "/live_values", "/live_events", "/live_outcome"
SCHEMA_OF_TOPIC = {
    MANIFEST: "cuffstation.LiveManifest",
    VALUES: "cuffstation.LiveFrame",
    EVENTS: "cuffstation.Event",
    OUTCOME: "cuffstation.LiveOutcome",
}
LIVE_SCHEMAS = {
    "cuffstation.LiveManifest": """
        uint32 format_version = 1;
        string json = 2;
    """,
    "cuffstation.LiveFrame": """
        uint64 frame = 1;
        double time_s = 2;
        string outcome = 3;
        repeated string suit_outcomes = 4;
        repeated double values = 5;
        repeated string hidden = 6;
        repeated string left_out = 7;
        repeated string exchanged = 8;
        repeated string lost = 9;
        double latency_s = 10;
        uint64 dropped_frames = 11;
        uint32 every = 12;
    """,
    "cuffstation.Event": SCHEMAS["cuffstation.Event"],
    "cuffstation.LiveOutcome": """
        bool complete = 1;
        string sentence = 2;
        string recording = 3;
        string recording_sha256 = 4;
        uint64 frames = 5;
        uint64 dropped_frames = 6;
    """,
}
FLUSH_AFTER_S = 1.0
"""Wall seconds from the first message of a chunk to its closing: what a crash costs."""
_CLASSES = wire_classes(LIVE_SCHEMAS)


@dataclass(frozen=True)
class LiveManifest:
    """What the values are and where they come from. columns: name → unit, "" for a ratio; suits: names in order.

    recording is the file that holds the raw samples; model names the body; versions are those of the packages.
    """

    recording: str
    columns: Mapping[str, str]
    suits: tuple[str, ...]
    model: str
    is_scaled: bool
    lag_s: float
    origin: str
    versions: Mapping[str, str]
    settings: Mapping[str, Any]
    result: str = "live"


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """One frame; values (columns,) are NaN where there are none. suit_outcomes are in the order of the suits."""

    frame: int
    time_s: float
    outcome: str
    suit_outcomes: tuple[str, ...]
    values: NDArray[np.float64]
    hidden: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    exchanged: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    latency_s: float = 0.0
    dropped_frames: int = 0
    every: int = 1


@dataclass(frozen=True)
class LiveOutcome:
    """The end of a complete file; recording_sha256 is the hash of the raw file, "" where it was not closed."""

    complete: bool
    sentence: str
    recording: str
    recording_sha256: str
    frames: int
    dropped_frames: int


@dataclass(frozen=True, eq=False)
class LiveResult:
    """A file that was read. outcome is None where its writer was killed; damage names what cannot be read."""

    manifest: LiveManifest
    frames: tuple[LiveFrame, ...]
    events: tuple[Event, ...]
    outcome: LiveOutcome | None
    damage: tuple[str, ...]

    @property
    def is_complete(self) -> bool:
        return self.outcome is not None and self.outcome.complete and not self.damage

    @property
    def values(self) -> NDArray[np.float64]:
        """(frames, columns)"""
        return np.array([frame.values for frame in self.frames]).reshape(-1, len(self.manifest.columns))


_MANIFEST = TypeAdapter(LiveManifest)


class LiveResultWriter:
    """Write one file, from one thread. Raises OSError; what was flushed before stays readable."""

    def __init__(self, path: Path, manifest: LiveManifest, *, clock: Callable[[], float] = time.perf_counter) -> None:
        """Raises OSError, FileExistsError for a file that is there: results are not overwritten."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path, self._clock = path, clock
        self._file: BinaryIO = path.open("xb")
        sync_folder(path.parent)
        self._mcap = Writer(self._file, compression=CompressionType.ZSTD)
        self._mcap.start(profile=PROFILE)
        self._channels = register_topics(self._mcap, LIVE_SCHEMAS, SCHEMA_OF_TOPIC)
        self._sequence = dict.fromkeys(SCHEMA_OF_TOPIC, 0)
        self._flush_due_s = clock()
        json = _MANIFEST.dump_json(manifest).decode()
        self._put(MANIFEST, 0, {"format_version": FORMAT_VERSION, "json": json})

    def write(self, frame: LiveFrame, utc_ns: int) -> None:
        """utc_ns: when the frame was taken, by the station's clock."""
        self._put(VALUES, utc_ns, vars(frame) | {"values": frame.values.astype("<f8").tobytes()})

    def note(self, event: Event) -> None:
        fields = {"kind": event.kind, "text": event.text, "source": event.source}
        self._put(EVENTS, event.host_time_ns, fields)

    def close(self, outcome: LiveOutcome, utc_ns: int) -> None:
        self._put(OUTCOME, utc_ns, vars(outcome))
        self._mcap.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def discard(self) -> None:
        """Delete the file: the trial was not recorded."""
        self._file.close()
        self.path.unlink(missing_ok=True)

    def _put(self, topic: str, utc_ns: int, fields: Mapping[str, Any]) -> None:
        data = _CLASSES[SCHEMA_OF_TOPIC[topic]](**fields).SerializeToString()
        number = self._sequence[topic]
        self._mcap.add_message(self._channels[topic], utc_ns, data, utc_ns, number)
        self._sequence[topic] = number + 1
        if self._clock() >= self._flush_due_s:
            self._mcap.flush()  # type: ignore[no-untyped-call]
            self._file.flush()
            self._flush_due_s = self._clock() + FLUSH_AFTER_S


def is_live_result(path: Path) -> bool:
    """Whether the file says in its header that it holds live results."""
    try:
        with open_regular(path) as file:
            start = file.read(256)
    except OSError:
        return False
    at = len(MCAP0_MAGIC) + 9  # opcode and length of the header
    if not start.startswith(MCAP0_MAGIC) or len(start) < at + 4:
        return False
    (length,) = struct.unpack_from("<I", start, at)
    return start[at + 4 : at + 4 + length] == PROFILE.encode()


def read_live_result(path: Path) -> LiveResult:
    """Raises RecordingError for a file of something else, of a newer format, or without its manifest."""
    manifest: LiveManifest | None = None
    outcome: LiveOutcome | None = None
    frames: list[LiveFrame] = []
    events: list[Event] = []
    damage: list[str] = []
    for entry in _entries(path):
        if isinstance(entry, Damage):
            damage += [] if entry.is_cut else [str(entry)]
            continue
        wire = _CLASSES[entry.schema].FromString(entry.data)
        match entry.topic:
            case "/live_manifest":
                manifest = _manifest(path, wire)
            case "/live_values":
                frames.append(_frame(wire))
            case "/live_events":
                events.append(Event(wire.kind, wire.text, entry.log_time_ns, wire.source))
            case "/live_outcome":
                outcome = LiveOutcome(**{field.name: getattr(wire, field.name) for field in wire.DESCRIPTOR.fields})
    if manifest is None:
        raise RecordingError(f"{path} has lost its manifest; nothing in it can be used", RecordingCode.MANIFEST_LOST)
    return LiveResult(manifest, tuple(frames), tuple(events), outcome, tuple(damage))


def recover_live_result(path: Path, output: Path) -> LiveResult:
    """Copy every readable message into a new file with an index; without an outcome it stays incomplete.

    Raises RecordingError, for an output that exists, too.
    """
    try:
        with output.open("xb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start(profile=PROFILE)
            channels = register_topics(writer, LIVE_SCHEMAS, SCHEMA_OF_TOPIC)
            for entry in _entries(path):
                if isinstance(entry, Entry):
                    time_ns = entry.log_time_ns
                    writer.add_message(channels[entry.topic], time_ns, entry.data, time_ns, entry.sequence)
            writer.finish()  # type: ignore[no-untyped-call]
    except FileExistsError as error:
        raise RecordingError(f"{output} exists; name another output", RecordingCode.OUTPUT_EXISTS) from error
    return read_live_result(output)


def _entries(path: Path) -> Iterator[Entry | Damage]:
    if not is_live_result(path):
        raise RecordingError(f"{path} is not a file of live results", RecordingCode.OTHER_PROGRAM)
    for entry in read_entries(path):
        if isinstance(entry, Damage) or SCHEMA_OF_TOPIC.get(entry.topic) == entry.schema:
            yield entry


def _manifest(path: Path, wire: Any) -> LiveManifest:
    if wire.format_version > FORMAT_VERSION:
        raise RecordingError(
            f"{path} has format version {wire.format_version}, expected at most {FORMAT_VERSION}; update cuffstation",
            RecordingCode.LATER_FORMAT,
        )
    try:
        return _MANIFEST.validate_json(wire.json)
    except ValidationError as error:
        raise RecordingError(f"{path} has a manifest that cannot be read: {error}", RecordingCode.MANIFEST) from error


def _frame(wire: Any) -> LiveFrame:
    fields = {field.name: getattr(wire, field.name) for field in wire.DESCRIPTOR.fields}
    lists = {name: tuple(fields[name]) for name in ("suit_outcomes", "hidden", "left_out", "exchanged", "lost")}
    values = np.frombuffer(fields["values"], "<f8")
    return LiveFrame(**fields | lists | {"values": values})
