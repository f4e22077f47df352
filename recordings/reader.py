"""One MCAP file → manifest, streams and items in bounded memory, from a whole file and from a cut one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from documents.results import EqualByFields, labelled_dataset
from recordings import topics
from recordings.chunks import Damage, Entry, read_entries
from recordings.errors import DamagedFile, RecordingCode, RecordingError
from recordings.manifest import Manifest, TrialOutcome
from recordings.packing import MOST_LABELS, Message, no_values, unpack
from recordings.samples import Event, Item, Samples, Stream

WIDENED, WIDENED_PER_BYTE = 64 * 2**20, 20
"""Bytes that a track may have, and besides for each that its samples have, where its labels changed."""


if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, eq=False, repr=False)
class Track(EqualByFields):
    """All samples of one stream in file order, as arrays.

    stream          its description; labels are those of the whole recording, in order of first appearance
    sample_numbers  (n,) uint64
    device_time_ns  (n,) int64, the device's clock
    host_time_ns    (n,) int64, UTC at arrival of the block that brought the sample
    values          scalar and analog streams (n, labels) float64; markers (n, markers, 4) float32; in Stream.unit.
                    NaN where a marker was missing, or its label was not known yet.
    """

    stream: Stream
    sample_numbers: NDArray[np.uint64]
    device_time_ns: NDArray[np.int64]
    host_time_ns: NDArray[np.int64]
    values: NDArray[Any]

    def __repr__(self) -> str:
        return (
            f"Track {self.stream.name}: {counted(len(self.values), 'sample')} of "
            f"{len(self.stream.labels)} [{self.stream.unit}]"
        )

    def to_dataframe(self) -> pd.DataFrame:
        """A row per sample: sample_number, device_time_ns, host_time_ns, then a column per label in Stream.unit; of a
        marker three, "label_x" and so on, and "label_residual". attrs["units"] has the unit of each column.
        """
        import pandas as pd

        names: list[str] = list(self.stream.labels)
        if self.values.ndim == 3:
            names = [f"{label}_{part}" for label in names for part in ("x", "y", "z", "residual")]
        table = pd.DataFrame(self.values.reshape(len(self.values), len(names)), columns=names)
        for place, name in enumerate(("sample_number", "device_time_ns", "host_time_ns")):
            table.insert(place, name, getattr(self, name + "s" * (name == "sample_number")))
        table.attrs["units"] = {"device_time_ns": "ns", "host_time_ns": "ns"} | dict.fromkeys(names, self.stream.unit)
        return table

    def to_xarray(self) -> xr.Dataset:
        """values over (sample, label), of markers over (sample, label, axis). Needs the extra xarray."""
        labels = {"label": (list(self.stream.labels), "")}
        axes: tuple[str, ...] = ("sample", "label")
        if self.values.ndim == 3:
            axes, labels = (*axes, "axis"), labels | {"axis": (["x", "y", "z", "residual"], "")}
        variables = {
            "values": (axes, self.values, self.stream.unit),
            "sample_number": (("sample",), self.sample_numbers, ""),
            "device_time_ns": (("sample",), self.device_time_ns, "ns"),
            "host_time_ns": (("sample",), self.host_time_ns, "ns"),
        }
        return labelled_dataset(variables, labels)


@dataclass(frozen=True, repr=False)
class Recording:
    """A recording that was read once, so that everything missing from it is known.

    outcome  how the trial ended; None when the file was cut before its end
    missing  every damage to the file, and messages counted at its end that are not there, as sentences
    damage   the part of `missing` that a cut does not explain: changed bytes, and messages lost between others
    """

    path: Path
    manifest: Manifest
    streams: tuple[Stream, ...]
    outcome: TrialOutcome | None
    missing: tuple[str, ...]
    damage: tuple[str, ...] = ()

    def __repr__(self) -> str:
        outcome = self.outcome.sentence if self.outcome else "cut before its end"
        streams = ", ".join(f"{stream.name} at {stream.rate_hz:g} Hz [{stream.unit}]" for stream in self.streams)
        return f"Recording {self.path.name}: {outcome}\n  {streams}" + "".join(f"\n  {gap}" for gap in self.missing)

    @property
    def complete(self) -> bool:
        """Whether everything that the writer received is in the file."""
        return not self.missing

    def items(self) -> Iterator[Stream | Item]:
        """All items in file order, with one chunk in memory at a time.

        A Stream precedes the first block with new labels.
        """
        in_force = {stream.name: stream for stream in self.streams}
        for entry in read_entries(self.path):
            item = read(entry) if isinstance(entry, Entry) else None
            if isinstance(item, Stream):
                if in_force.get(item.name) == item:
                    continue
                in_force[item.name] = item
            if isinstance(item, Stream | Item):
                yield item

    def load(self, name: str) -> Track:
        """One stream as arrays. Raises RecordingError when the recording has no such stream."""
        stream = next((stream for stream in self.streams if stream.name == name), None)
        if stream is None:
            found = ", ".join(stream.name for stream in self.streams)
            raise RecordingError(f"{self.path} has no stream {name}, only {found or 'none'}", RecordingCode.NO_STREAM)
        collector = TrackCollector(self.path)
        for entry in read_entries(self.path):
            if isinstance(entry, Entry) and entry.topic in (topics.STREAMS, name) and is_ours(entry):
                collector.take(entry)
        return collector.track(stream)


class TrackCollector:
    """Collects the samples of all streams while a recording is read, so that it is read once: open_recording(path,
    collector.take), then collector.track(stream) of every stream that is wanted.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._entries: dict[str, list[Entry]] = {}  # by the stream they are of

    def take(self, entry: Entry) -> None:
        """A message of a recording; messages come in the order of the file. Only descriptions are read at once."""
        described = read(entry) if entry.topic == topics.STREAMS else None
        name = described.name if isinstance(described, Stream) else entry.topic
        self._entries.setdefault(name, []).append(entry)

    def events(self) -> list[Event]:
        """All events of the recording, in the order of the file."""
        return [event for event in map(read, self._entries.get(topics.EVENTS, ())) if isinstance(event, Event)]

    def track(self, stream: Stream) -> Track:
        """One stream of the recording, as first described, as arrays. Raises RecordingError where a block cannot be
        read, or is not as wide as described.
        """
        labels = stream.labels
        later: dict[str, None] = {}  # labels that a later description adds, in order of first appearance
        blocks: list[tuple[tuple[str, ...], Samples]] = []
        for message in map(read, self._entries.get(stream.name, ())):
            if isinstance(message, Stream):
                labels = message.labels
                later |= dict.fromkeys(label for label in labels if label not in stream.labels)
                if len(later) > MOST_LABELS:
                    raise RecordingError(
                        f"{self._path} has more than {MOST_LABELS} labels in {stream.name}", RecordingCode.TOO_LARGE
                    )
            elif isinstance(message, Samples):
                blocks.append((labels, message))
        all_labels = (*stream.labels, *later)
        self._ensure_not_blown_up([block.values for _, block in blocks], len(all_labels))
        columns = [_in_columns(block.values, labels, all_labels, self._path) for labels, block in blocks]
        hosts = [np.full(len(block.sample_numbers), block.host_time_ns, np.int64) for _, block in blocks]
        return Track(
            stream=replace(stream, labels=all_labels),
            sample_numbers=_joined([block.sample_numbers for _, block in blocks], np.zeros(0, np.uint64)),
            device_time_ns=_joined([block.device_time_ns for _, block in blocks], np.zeros(0, np.int64)),
            host_time_ns=_joined(hosts, np.zeros(0, np.int64)),
            values=_joined(columns, no_values(stream.name, len(all_labels))),
        )

    def _ensure_not_blown_up(self, blocks: Sequence[NDArray[Any]], columns: int) -> None:
        """Blocks of one marker under thousands of changing labels would fill the memory with NaN: refuse them."""
        held = sum(values.nbytes for values in blocks)
        wide = sum(values.nbytes * columns // max(1, values.shape[1]) for values in blocks)
        if wide > WIDENED + WIDENED_PER_BYTE * held:
            raise RecordingError(
                f"{self._path} holds {held} bytes of samples, which all its labels make {wide}", RecordingCode.TOO_LARGE
            )


def open_recording(path: Path, take: Callable[[Entry], None] = lambda _: None) -> Recording:
    """Open a recording, whole or cut, in one pass over the file; the result lists missing data.

    take receives every message. Raises RecordingError for a file that cannot be read, is empty, or is not a recording.
    """
    survey = survey_file(path, take)
    if survey.manifest is None:
        reasons = "; ".join(survey.missing)
        raise DamagedFile(
            f"{path} has lost its manifest, without which its samples have no meaning: {reasons}",
            RecordingCode.MANIFEST_LOST,
        )
    return Recording(path, survey.manifest, survey.streams, survey.outcome, survey.missing, survey.damaged)


def read_manifest(path: Path) -> Manifest:
    """Read the manifest only. Raises RecordingError if there is none to read."""
    for entry in read_entries(path):
        found = read(entry) if isinstance(entry, Entry) else None
        if isinstance(found, Manifest):
            return found
    raise RecordingError(f"{path} has no manifest that can be read, expected a recording", RecordingCode.MANIFEST_LOST)


@dataclass(frozen=True)
class Survey:
    """Contents of a file besides its samples; manifest is None if both copies are damaged.

    messages  how many of our topics' messages can be read, by topic
    expected  how many there were, by the outcome's count or by the last sequence number before the cut
    streams   as first described
    """

    manifest: Manifest | None
    streams: tuple[Stream, ...]
    outcome: TrialOutcome | None
    messages: Mapping[str, int]
    expected: Mapping[str, int]
    damage: tuple[Damage, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """Every damage and every lost message, in sentences; empty for a whole recording."""
        cut = () if self.outcome else ("there is no outcome: the recording was cut, and what came after is unknown",)
        return (*(str(damage) for damage in self.damage), *cut, *self._lost)

    @property
    def damaged(self) -> tuple[str, ...]:
        """The same without damage that a cut explains."""
        return (*(str(damage) for damage in self.damage if not damage.is_cut), *self._lost)

    @property
    def _lost(self) -> tuple[str, ...]:
        return tuple(
            f"{topic} holds {self.messages.get(topic, 0)} of {counted(count, 'message')}"
            for topic, count in self.expected.items()
            if self.messages.get(topic, 0) != count
        )


def survey_file(path: Path, take: Callable[[Entry], None] = lambda _: None) -> Survey:
    """Read a file in one pass; take receives every message. Raises RecordingError if the file has no message of a
    recording, or one of a newer format.
    """
    manifest: Manifest | None = None
    outcome: TrialOutcome | None = None
    streams: dict[str, Stream] = {}
    messages: Counter[str] = Counter()
    expected: dict[str, int] = {}
    damage: list[Damage] = []
    for entry in read_entries(path):
        if isinstance(entry, Damage):
            damage.append(entry)
        elif is_ours(entry):
            messages[entry.topic] += 1
            expected[entry.topic] = entry.sequence + 1
            take(entry)
            if entry.topic not in (topics.MANIFEST, topics.STREAMS, topics.OUTCOME):
                continue
            match read(entry):
                case Manifest() as found:
                    manifest = manifest or found
                case Stream() as found if found.name in topics.SAMPLE_TOPICS:
                    streams.setdefault(found.name, found)
                case TrialOutcome() as found:
                    outcome = found
    if not messages:
        raise _nothing_is_ours(path, damage)
    expected |= outcome.messages if outcome else {}
    return Survey(manifest, tuple(streams.values()), outcome, messages, expected, tuple(damage))


def is_ours(entry: Entry) -> bool:
    """Whether a message is part of the recording; other programs may add topics of their own."""
    return topics.SCHEMA_OF_TOPIC.get(entry.topic) == entry.schema


def read(entry: Entry) -> Message | None:
    """Unpack a message; None for a topic that is not of a recording."""
    return unpack(entry.topic, entry.log_time_ns, entry.data) if is_ours(entry) else None


def _nothing_is_ours(path: Path, damage: list[Damage]) -> RecordingError:
    if path.stat().st_size == 0:
        return RecordingError(f"{path} is empty; nothing was recorded into it", RecordingCode.EMPTY)
    if not damage:
        return RecordingError(
            f"{path} is an MCAP file of another program, expected a recording with a {topics.MANIFEST}",
            RecordingCode.OTHER_PROGRAM,
        )
    if damage[0].offset == 0:
        return RecordingError(f"{path} is not an MCAP file, expected a recording", RecordingCode.NOT_MCAP)
    message = f"{path} was cut or damaged before its first whole chunk ended: {damage[0]}; nothing in it can be read"
    return RecordingError(message, RecordingCode.CUT) if damage[0].is_cut else DamagedFile(message)


def _in_columns(values: NDArray[Any], labels: tuple[str, ...], all_labels: tuple[str, ...], path: Path) -> NDArray[Any]:
    """Values of a block in the columns of the whole track; NaN for a label that the block lacks."""
    if values.shape[1] != len(labels):
        raise RecordingError(
            f"{path} has a block of {counted(values.shape[1], 'column')} where {len(labels)} are "
            "described; its labels were lost",
            RecordingCode.LABELS_LOST,
        )
    if labels == all_labels:
        return values
    wide = np.full((len(values), len(all_labels), *values.shape[2:]), np.nan, values.dtype)
    wide[:, [all_labels.index(label) for label in labels]] = values
    return wide


def _joined(parts: list[NDArray[Any]], nothing: NDArray[Any]) -> NDArray[Any]:
    joined = np.concatenate(parts) if parts else nothing
    joined.flags.writeable = False
    return joined
