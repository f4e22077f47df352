"""Follow a number of the report to the samples it rests on: page, report.json, result, recordings, streams."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fitting.results.codes import Standing
from recordings.errors import RecordingError
from recordings.reader import TrackCollector, open_recording
from station.checksums import standing_of
from station.errors import StationError
from station.files.chain import NUMBERS_FILE, REPORT_FILE
from station.messages.file_messages import NumberCode
from station.messages.message import Message
from station.report.report_file import ReportedNumber, read_numbers
from station.report.verification import page_faults, read_page, rendered_numbers, source_faults


class NoSuchNumber(StationError):
    """The report has no number of this id."""


@dataclass(frozen=True)
class TracedStream:
    """Samples of a stream in a recording."""

    name: str
    unit: str
    channels: int
    samples: int
    duration_s: float

    def __str__(self) -> str:
        return f"{self.name}: {self.samples} samples × {self.channels} [{self.unit}], {self.duration_s:.1f} s"


@dataclass(frozen=True)
class TracedRecording:
    """A recording, its comparison with its recorded hash, and its streams; none of one that cannot be read."""

    file: str
    standing: Standing
    streams: tuple[TracedStream, ...]


@dataclass(frozen=True)
class Trace:
    """A number of the report, what contradicts it, and the recordings it rests on."""

    id: str
    number: ReportedNumber
    faults: tuple[Message[NumberCode], ...]
    source_standing: Standing
    recordings: tuple[TracedRecording, ...]

    @property
    def is_broken(self) -> bool:
        standings = [self.source_standing, *(recording.standing for recording in self.recordings)]
        return bool(self.faults) or any(standing.is_break for standing in standings)


def trace(folder: Path, key: str) -> Trace:
    """The chain of one number by its id. Raises ReportFileError without report.json, and NoSuchNumber."""
    listed = read_numbers(folder / NUMBERS_FILE)
    number = listed.numbers.get(key)
    if number is None:
        raise NoSuchNumber(Message(NumberCode.UNKNOWN, {"file": NUMBERS_FILE, "id": key}))
    rendered, file = rendered_numbers(folder), number.source.file
    faults = [*page_faults(key, number, read_page(folder))]
    faults += (
        [rendered] if isinstance(rendered, Message) else source_faults(key, number, rendered.get(key), listed.version)
    )
    return Trace(
        key,
        number,
        tuple(faults),
        standing_of(folder / file) if file else Standing.AS_RECORDED,
        tuple(_recording(folder / name) for name in number.recordings),
    )


def trace_lines(traced: Trace) -> Iterator[str]:
    """The chain as text, from the page down to the samples."""
    number, source = traced.number, traced.number.source
    yield f"{traced.id}: {number.text}"
    yield f"  page         {REPORT_FILE}#{traced.id}"
    if not isinstance(number.value, str):
        yield f"  value        {_value(number)}"
    derivation = "" if source.derivation == "value" else f", {source.derivation}"
    yield f"  source       {source.file or 'recordings'} {source.pointer}{derivation}: {traced.source_standing}"
    if number.draws is not None:
        seed = "not recorded" if number.seed is None else number.seed
        yield f"  interval     {number.draws} random draws, seed {seed}"
    yield from (f"  contradicted {fault} [{fault.code}]" for fault in traced.faults)
    for recording in traced.recordings:
        yield f"  recording    {recording.file}: {recording.standing}"
        yield from (f"    samples    {stream}" for stream in recording.streams)


def plain_trace(traced: Trace) -> dict[str, Any]:
    """The chain as JSON."""
    return {
        "id": traced.id,
        "number": traced.number.model_dump(mode="json", exclude_defaults=True),
        "source_standing": traced.source_standing,
        "faults": [{"code": fault.code, "text": str(fault)} for fault in traced.faults],
        "recordings": [
            {
                "file": recording.file,
                "standing": recording.standing,
                "streams": [vars(stream) for stream in recording.streams],
            }
            for recording in traced.recordings
        ],
    }


def _value(number: ReportedNumber) -> str:
    interval = f", 95 % {number.ci95[0]!r} to {number.ci95[1]!r}" if number.ci95 else ""
    return f"{number.value!r} {number.unit}".rstrip() + interval


def _recording(path: Path) -> TracedRecording:
    collector = TrackCollector(path)
    try:
        streams = open_recording(path, collector.take).streams
    except (RecordingError, OSError):
        return TracedRecording(path.name, standing_of(path), ())
    found = []
    for stream in streams:
        track = collector.track(stream)
        times = track.device_time_ns
        duration = 1e-9 * float(times[-1] - times[0]) if len(times) else 0.0
        found.append(TracedStream(stream.name, stream.unit, len(stream.labels), len(times), duration))
    return TracedRecording(path.name, standing_of(path), tuple(found))
