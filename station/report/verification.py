"""Verify that every number of the report follows from the files of its session: render it again, and compare.

The trace of one number leads to the samples it rests on: page, report.json, result, recordings, streams.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from html import unescape
from importlib import metadata
from pathlib import Path
from typing import Any

from documents.interval import counted
from documents.message import Message, because
from documents.plain_data import PlainDataError
from documents.regular_file import read_regular
from fitting.cuffs.cuffs_file import CUFFS_FILE
from fitting.errors import FitError
from fitting.results.codes import Standing
from recordings.errors import RecordingError
from recordings.reader import TrackCollector, open_recording
from station.checksums import Checksums, standing_of
from station.errors import StationError
from station.files.chain import LARGEST_REPORT, NUMBERS_FILE, REPORT_FILE, Link, verify_folder
from station.messages.file_messages import NumberCode
from station.recordings_of_session import recordings_in
from station.report.page import read_results, render
from station.report.report_file import ReportDocument, ReportedNumber, ReportFileError, read_numbers

Fault = Message[NumberCode]
Numbers = Mapping[str, ReportedNumber]

FITTED_FOR_REPORT = "the recordings were fitted for the report; verify with --recompute"

_NUMBER = re.compile(
    r'<(data|span) class="number" id="(?P<id>[^"]*)"(?: value="(?P<value>[^"]*)")? title="[^"]*">(?P<text>.*?)</\1>',
    re.DOTALL,
)
_FIGURE = re.compile(
    r'<div id="(?P<id>figure\.[^"]*)">(?P<drawing>.*?)</div><!-- (?P=id) --><figcaption>(?P<caption>.*?)</figcaption>',
    re.DOTALL,
)
_COMMAND = re.compile(r"</?code>")
"""Commands of a sentence; in a result they are in backticks."""


@dataclass(frozen=True)
class MarkedPage:
    """Text and attribute `value` of every number of a page, caption and SHA-256 of every drawing, by id."""

    numbers: Mapping[str, tuple[str, str | None]]
    figures: Mapping[str, tuple[str, str]]


def verify_session(folder: Path) -> list[Link]:
    """Every link of the chain of files, then the numbers of the report. Raises ChainError as verify_folder."""
    return [*verify_folder(folder), *number_links(folder)]


def number_links(folder: Path) -> list[Link]:
    """Links of the numbers on the page to report.json, and from there to the results; none without report.json."""
    path = folder / NUMBERS_FILE
    if not path.is_file():
        return []
    try:
        listed = read_numbers(path)
    except ReportFileError as error:
        return [Link(f"{NUMBERS_FILE}, its content", Standing.CHANGED, str(error), NumberCode.FILE)]
    page = read_page(folder)
    return [
        *_input_links(folder, listed),
        _link(
            f"{NUMBERS_FILE}, {counted(len(listed.numbers), 'number')} on the page", list(_faults_on_page(listed, page))
        ),
        _link(
            f"{NUMBERS_FILE}, {counted(len(listed.figures), 'figure')} on the page",
            list(_faults_of_figures(listed, page)),
        ),
        *_source_links(folder, listed),
    ]


def read_page(folder: Path) -> MarkedPage:
    """The marks on the session's page, as the register of numbers writes them; none without one."""
    try:
        page = read_regular(folder / REPORT_FILE, LARGEST_REPORT).decode("utf-8", "replace")
    except OSError:
        page = ""
    return MarkedPage(
        {
            unescape(found["id"]): (unescape(_COMMAND.sub("`", found["text"])), found["value"])
            for found in _NUMBER.finditer(page)
        },
        {
            unescape(found["id"]): (
                unescape(found["caption"]),
                hashlib.sha256(found["drawing"].encode()).hexdigest(),
            )
            for found in _FIGURE.finditer(page)
        },
    )


def rendered_numbers(folder: Path) -> Numbers | Fault:
    """The numbers that the files of the folder give now, or why they give none."""
    try:
        return render(read_results(folder))[1].numbers
    except (StationError, FitError, PlainDataError, OSError) as error:
        return Message(NumberCode.FILE, {"file": str(folder), **because(error)})


def page_faults(key: str, number: ReportedNumber, page: MarkedPage) -> Iterator[Fault]:
    """Why a number is not on the page as it is listed."""
    if key not in page.numbers:
        yield Message(NumberCode.NOT_ON_PAGE, {"id": key})
        return
    for found, expected in zip(page.numbers[key], (number.text, number.attribute), strict=True):
        if found != expected:
            yield Message(NumberCode.PAGE, {"id": key, "found": str(found), "expected": str(expected)})


def source_faults(key: str, number: ReportedNumber, again: ReportedNumber | None, version: str) -> Iterator[Fault]:
    """Why a number is not the one that its source gives. Another version may show it with another text, or not."""
    place = {"id": key, "source": number.source.file or "recordings", "pointer": number.source.pointer}
    if again is None:
        if version == metadata.version("cuffstation"):
            yield Message(NumberCode.NO_SOURCE, place)
        return
    for name in ("source", "value", "ci95"):
        found, expected = getattr(number, name), getattr(again, name)
        if found != expected:
            yield Message(NumberCode.SOURCE, {**place, "found": str(found), "expected": str(expected)})
            return
    if number.text != again.text and version == metadata.version("cuffstation"):
        yield Message(NumberCode.RENDERING, {"id": key, "found": number.text, "expected": again.text})
    if (number.recordings, number.draws, number.seed) != (again.recordings, again.draws, again.seed):
        yield Message(NumberCode.PROVENANCE, place)


def _input_links(folder: Path, listed: ReportDocument) -> Iterator[Link]:
    """A link for every input that differs from the list of hashes, with the numbers that rest on it."""
    sums = Checksums(folder)
    for file in listed.inputs:
        standing, _ = sums.compare(file)
        if standing.is_break:
            behind = [key for key, number in listed.numbers.items() if file in (*number.recordings, number.source.file)]
            fault = Message(NumberCode.INPUT, {"numbers": len(behind), "id": behind[0]}) if behind else None
            yield Link.because(f"{NUMBERS_FILE} ← {file}", standing, fault)


def _faults_on_page(listed: ReportDocument, page: MarkedPage) -> Iterator[Fault]:
    for key, number in listed.numbers.items():
        yield from page_faults(key, number, page)
    for key in page.numbers.keys() - listed.numbers.keys():
        yield Message(NumberCode.NOT_LISTED, {"id": key})


def _faults_of_figures(listed: ReportDocument, page: MarkedPage) -> Iterator[Fault]:
    for key in listed.figures.keys() | page.figures.keys():
        figure = listed.figures.get(key)
        if figure is None or key not in page.figures:
            yield Message(NumberCode.NOT_LISTED if figure is None else NumberCode.NOT_ON_PAGE, {"id": key})
        elif (figure.caption, figure.sha256) != page.figures[key]:
            yield Message(NumberCode.FIGURE, {"id": key})


def _source_links(folder: Path, listed: ReportDocument) -> Iterator[Link]:
    """A link for every file that numbers are from."""
    rendered = rendered_numbers(folder)
    if isinstance(rendered, Message) and set(listed.inputs) <= {path.name for path in recordings_in(folder)}:
        yield Link(f"{NUMBERS_FILE} ← recordings", Standing.UNRECORDED, FITTED_FOR_REPORT)
        return
    if isinstance(rendered, Message):
        yield Link.because(f"{NUMBERS_FILE} ← results", Standing.CHANGED, rendered)
        return
    is_same_version = listed.version == metadata.version("cuffstation")
    new = [key for key in rendered if key not in listed.numbers] if is_same_version else []
    for file in dict.fromkeys(number.source.file for number in listed.numbers.values()):
        keys = [key for key, number in listed.numbers.items() if number.source.file == file]
        what = f"{NUMBERS_FILE} ← {file or 'recordings'}, {counted(len(keys), 'number')}"
        if file == CUFFS_FILE and not (folder / file).is_file():
            yield Link(what, Standing.UNRECORDED, FITTED_FOR_REPORT)
            continue
        faults = [
            fault
            for key in keys
            for fault in source_faults(key, listed.numbers[key], rendered.get(key), listed.version)
        ]
        faults += [Message(NumberCode.LEFT_OUT, {"id": key}) for key in new if rendered[key].source.file == file]
        yield _link(what, faults)


def _link(what: str, faults: list[Fault]) -> Link:
    """As recorded without faults; else the first fault, and how many there are."""
    if not faults:
        return Link(what, Standing.AS_RECORDED)
    more = f"; and {len(faults) - 1} more" if len(faults) > 1 else ""
    return Link(what, Standing.CHANGED, f"{faults[0]}{more}", faults[0].code)


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
        return (
            f"{self.name}: {counted(self.samples, 'sample')} × {self.channels} [{self.unit}], {self.duration_s:.1f} s"
        )


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
        "recordings": [asdict(recording) for recording in traced.recordings],
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
