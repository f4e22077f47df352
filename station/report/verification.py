"""Verify that every number of the report follows from the files of its session: render it again, and compare.

The trace of one number leads to the samples it rests on: page, report.json, result, recordings, streams.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from html import unescape
from importlib import metadata
from pathlib import Path

from documents.interval import counted
from documents.message import Message, because
from documents.plain_data import PlainDataError
from documents.regular_file import read_regular
from fitting.cuffs.cuffs_file import CUFFS_FILE
from fitting.errors import FitError
from fitting.results.codes import Standing
from recordings.errors import RecordingError
from recordings.reader import TrackCollector, open_recording
from station.checksums import Checksums, check_hash
from station.errors import StationError
from station.files.chain import LARGEST_REPORT, NUMBERS_FILE, REPORT_FILE, Link, verify_folder
from station.messages.file_messages import NumberCode
from station.recordings_of_session import recordings_in
from station.report.page import read_results, render
from station.report.report_file import DrawnFigure, Part, ReportDocument, ReportedNumber, ReportFileError, read_numbers

Fault = Message[NumberCode]
Numbers = Mapping[str, ReportedNumber]
VERSION = metadata.version("cuffstation")
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


Marks = Mapping[str, tuple[str, str | None]]
"""Text and attribute `value` of every number of a page, or caption and SHA-256 of every drawing, by id."""


def verify_session(folder: Path) -> list[Link]:
    """Every link of the chain of files, then the numbers of the report. Raises ChainError as verify_folder."""
    return [*verify_folder(folder), *number_links(folder)]


def number_links(folder: Path) -> Iterator[Link]:
    """Links of the numbers on the page to report.json, and from there to the results; none without report.json."""
    if not (folder / NUMBERS_FILE).is_file():
        return
    try:
        listed = read_numbers(folder / NUMBERS_FILE)
    except ReportFileError as error:
        yield Link(f"{NUMBERS_FILE}, its content", Standing.CHANGED, str(error), NumberCode.FILE)
        return
    yield from _input_links(folder, listed)
    numbers, figures = read_page(folder)
    for what, entries, marks in (("number", listed.numbers, numbers), ("figure", listed.figures, figures)):
        faults = [fault for key, entry in entries.items() for fault in page_faults(key, entry, marks)]
        faults += [Message(NumberCode.NOT_LISTED, {"id": key}) for key in marks if key not in entries]
        yield compared_link(f"{NUMBERS_FILE}, {counted(len(entries), what)} on the page", faults)
    yield from _source_links(folder, listed)


def read_page(folder: Path) -> tuple[Marks, Marks]:
    """Numbers and figures of the session's page, as the register of numbers marks them; none without one."""
    page = ""
    with suppress(OSError):
        page = read_regular(folder / REPORT_FILE, LARGEST_REPORT).decode("utf-8", "replace")
    drawn = _FIGURE.finditer(page)
    return (
        {unescape(m["id"]): (unescape(_COMMAND.sub("`", m["text"])), m["value"]) for m in _NUMBER.finditer(page)},
        {unescape(m["id"]): (unescape(m["caption"]), sha256(m["drawing"].encode()).hexdigest()) for m in drawn},
    )


def rendered_numbers(folder: Path) -> Numbers | Fault:
    """The numbers that the files of the folder give now, or why they give none."""
    try:
        return render(read_results(folder))[1].numbers
    except (StationError, FitError, PlainDataError, OSError) as error:
        return Message(NumberCode.FILE, {"path": str(getattr(error, "filename", None) or folder), **because(error)})


def page_faults(key: str, entry: ReportedNumber | DrawnFigure, marks: Marks) -> Iterator[Fault]:
    """Fault of a number or figure that is not on the page as it is listed."""
    if key not in marks:
        yield Message(NumberCode.NOT_ON_PAGE, {"id": key})
        return
    code = NumberCode.FIGURE if isinstance(entry, DrawnFigure) else NumberCode.PAGE
    for found, expected in zip(marks[key], entry.mark, strict=True):
        if found != expected:
            yield Message(code, {"id": key, "found": str(found), "expected": str(expected)})


def source_faults(key: str, listed: ReportDocument, rendered: Numbers) -> Iterator[Fault]:
    """Fault of a number that differs from its source. Another version may word or omit it."""
    number, again, is_same_version = listed.numbers[key], rendered.get(key), listed.version == VERSION
    place = {"id": key, "source": number.source.file or "recordings", "pointer": number.source.pointer}
    if again is None:
        if is_same_version:
            yield Message(NumberCode.NO_SOURCE, place)
        return
    for name in ("source", "value", "ci95"):
        found, expected = getattr(number, name), getattr(again, name)
        if found != expected:
            yield Message(NumberCode.SOURCE, {**place, "found": str(found), "expected": str(expected)})
            return
    if number.text != again.text and is_same_version:
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


def _source_links(folder: Path, listed: ReportDocument) -> Iterator[Link]:
    """A link for every file that numbers are from."""
    rendered, fitted = rendered_numbers(folder), {path.name for path in recordings_in(folder)}
    if isinstance(rendered, Message):
        if fitted.issuperset(listed.inputs):
            yield Link(f"{NUMBERS_FILE} ← recordings", Standing.UNRECORDED, FITTED_FOR_REPORT)
        else:
            yield Link.because(f"{NUMBERS_FILE} ← results", Standing.CHANGED, rendered)
        return
    new = rendered.keys() - listed.numbers.keys() if listed.version == VERSION else ()
    for file in dict.fromkeys(number.source.file for number in listed.numbers.values()):
        keys = [key for key, number in listed.numbers.items() if number.source.file == file]
        what = f"{NUMBERS_FILE} ← {file or 'recordings'}, {counted(len(keys), 'number')}"
        if file == CUFFS_FILE and not (folder / file).is_file():
            yield Link(what, Standing.UNRECORDED, FITTED_FOR_REPORT)
            continue
        faults = [fault for key in keys for fault in source_faults(key, listed, rendered)]
        left_out = [key for key in rendered if key in new and rendered[key].source.file == file]
        faults += [Message(NumberCode.LEFT_OUT, {"id": key}) for key in left_out]
        yield compared_link(what, faults)


def compared_link(what: str, faults: Sequence[Fault], remark: str = "") -> Link:
    """As recorded without faults, with the remark; else the first fault, and how many there are."""
    if not faults:
        return Link(what, Standing.AS_RECORDED, remark)
    more = f"; and {len(faults) - 1} more" if len(faults) > 1 else ""
    return Link(what, Standing.CHANGED, f"{faults[0]}{more}", faults[0].code)


class TracedStream(Part):
    """Samples of a stream in a recording."""

    name: str
    unit: str
    channels: int
    samples: int
    duration_s: float


class TracedRecording(Part):
    """A recording, its comparison with its recorded hash, and its streams; none of one that cannot be read."""

    file: str
    standing: Standing
    streams: list[TracedStream]


class TracedFault(Part):
    code: NumberCode
    text: str


class Trace(Part):
    """A number of the report, what contradicts it, and the recordings it rests on."""

    id: str
    number: ReportedNumber
    source_standing: Standing
    faults: list[TracedFault]
    recordings: list[TracedRecording]

    @property
    def is_broken(self) -> bool:
        standings = [self.source_standing, *(recording.standing for recording in self.recordings)]
        return bool(self.faults) or any(standing.is_break for standing in standings)


def trace(folder: Path, key: str) -> Trace:
    """The chain of one number by its id. Raises ReportFileError without report.json or the number."""
    listed = read_numbers(folder / NUMBERS_FILE)
    if (number := listed.numbers.get(key)) is None:
        raise ReportFileError(Message(NumberCode.UNKNOWN, {"file": NUMBERS_FILE, "id": key}))
    rendered, file = rendered_numbers(folder), number.source.file
    faults = list(page_faults(key, number, read_page(folder)[0]))
    faults += [rendered] if isinstance(rendered, Message) else source_faults(key, listed, rendered)
    return Trace(
        id=key,
        number=number,
        source_standing=check_hash(folder / file) if file else Standing.AS_RECORDED,
        faults=[TracedFault(code=fault.code, text=str(fault)) for fault in faults],
        recordings=[_recording(folder / name) for name in number.recordings],
    )


def trace_lines(traced: Trace) -> Iterator[str]:
    """The chain as text, from the page down to the samples."""
    number, source = traced.number, traced.number.source
    yield f"{traced.id}: {number.text}"
    yield f"  page         {REPORT_FILE}#{traced.id}"
    if not isinstance(number.value, str):
        interval = f", 95 % {number.ci95[0]!r} to {number.ci95[1]!r}" if number.ci95 else ""
        yield f"  value        {f'{number.value!r} {number.unit}'.rstrip()}{interval}"
    derivation = "" if source.derivation == "value" else f", {source.derivation}"
    yield f"  source       {source.file or 'recordings'} {source.pointer}{derivation}: {traced.source_standing}"
    if number.draws is not None:
        seed = "not recorded" if number.seed is None else number.seed
        yield f"  interval     {number.draws} random draws, seed {seed}"
    yield from (f"  contradicted {fault.text} [{fault.code}]" for fault in traced.faults)
    for recording in traced.recordings:
        yield f"  recording    {recording.file}: {recording.standing}"
        for stream in recording.streams:
            samples = f"{counted(stream.samples, 'sample')} × {stream.channels} [{stream.unit}]"
            yield f"    samples    {stream.name}: {samples}, {stream.duration_s:.1f} s"


def _recording(path: Path) -> TracedRecording:
    collector, found = TrackCollector(path), list[TracedStream]()
    with suppress(RecordingError, OSError):
        for stream in open_recording(path, collector.take).streams:
            times = collector.track(stream).device_time_ns
            duration = 1e-9 * float(times[-1] - times[0]) if len(times) else 0.0
            traced = TracedStream(
                name=stream.name, unit=stream.unit, channels=len(stream.labels), samples=len(times), duration_s=duration
            )
            found.append(traced)
    return TracedRecording(file=path.name, standing=check_hash(path), streams=found)
