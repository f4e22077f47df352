"""Verify that every number of the report follows from the files of its session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from documents.regular_file import read_regular
from fitting.cuffs.cuffs_file import CUFFS_FILE, CuffsFileError, read_cuffs
from fitting.cuffs.wearable_cuff import bushing_force
from fitting.results.standing import Standing
from station.checksums import sha256_of
from station.files.chain import LARGEST_REPORT, NUMBERS_FILE, REPORT_FILE, Link, verify_folder
from station.messages.file_codes import NumberCode
from station.messages.message import Message
from station.report.located import Derivation, Source
from station.report.marked_page import MarkedPage, read_marks
from station.report.number_register import attribute_of
from station.report.provenance import figures_of
from station.report.report_file import ReportDocument, ReportedNumberEntry, ReportFileError, read_numbers
from station.report.source_files import SourceFiles
from station.report.sourced_number import Form

Fault = Message[NumberCode]


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
    files = SourceFiles(folder)
    page = read_page(folder)
    return [
        _page_link(folder, listed),
        *_input_links(folder, listed),
        _link(f"{NUMBERS_FILE}, {len(listed.numbers)} numbers on the page", list(_faults_on_page(listed, page))),
        _link(f"{NUMBERS_FILE}, {len(listed.figures)} figures on the page", list(_faults_of_figures(listed, page))),
        *_source_links(listed, files),
    ]


def faults_of(key: str, number: ReportedNumberEntry, files: SourceFiles) -> Iterator[Fault]:
    """Why a number does not agree with its source, whose file exists."""
    shown, source = number.number(), number.source.source()
    if str(shown) != number.text:
        yield Message(NumberCode.RENDERING, {"id": key, "found": number.text, "expected": str(shown)})
    place = {"id": key, "source": source.file, "pointer": source.pointer}
    try:
        is_bushing = number.rendering.form is Form.BUSHING
        found = _bushing(files, source) if is_bushing else files.value(source, tuple(number.recordings))
    except (KeyError, TypeError):
        yield Message(NumberCode.NO_SOURCE, place)
        return
    expected = found.get("value") if isinstance(found, Mapping) else found
    if expected != number.value:
        yield Message(NumberCode.SOURCE, {**place, "found": str(number.value), "expected": str(expected)})
    elif (interval := _interval(found, source, files)) not in (None, number.ci95):
        yield Message(NumberCode.SOURCE, {**place, "found": str(number.ci95), "expected": str(interval)})
    if not _has_its_provenance(number, files):
        yield Message(NumberCode.PROVENANCE, place)


def _interval(found: Any, source: Source, files: SourceFiles) -> Any:
    """Interval of an entry, or beside a number alone under its key with `_ci95`.

    None where the file has none, and a given standard error determines it.
    """
    if isinstance(found, Mapping):
        return found.get("ci95")
    if source.derivation is not Derivation.VALUE:
        return None
    try:
        return files.value(replace(source, pointer=f"{source.pointer}_ci95"))
    except (KeyError, TypeError):
        return None


def _has_its_provenance(number: ReportedNumberEntry, files: SourceFiles) -> bool:
    source, provenance = number.source.source(), files.provenance
    draws = provenance.draws(source) if number.ci95 or isinstance(number.value, str) else None
    is_counted = not source.file
    figures = figures_of(files.document(source.file), source) if isinstance(number.value, str) else {}
    return (
        (is_counted or tuple(number.recordings) == provenance.recordings(source))
        and (number.draws, number.seed) == ((draws.count, draws.seed) if draws else (None, None))
        and number.figures == figures
    )


def _bushing(files: SourceFiles, source: Source) -> str:
    """The OpenSim element of a cuff. Raises KeyError without the cuff."""
    try:
        cuffs = read_cuffs(files.folder / CUFFS_FILE)
    except CuffsFileError as error:
        raise KeyError(source.pointer) from error
    return bushing_force(cuffs[source.keys[-1]])


def _page_link(folder: Path, listed: ReportDocument) -> Link:
    path = folder / REPORT_FILE
    if not path.is_file():
        return Link(f"{NUMBERS_FILE} ← {REPORT_FILE}", Standing.MISSING)
    is_same = sha256_of(path) == listed.page.sha256
    return Link(f"{NUMBERS_FILE} ← {REPORT_FILE}", Standing.AS_RECORDED if is_same else Standing.CHANGED)


def _input_links(folder: Path, listed: ReportDocument) -> Iterator[Link]:
    """A link for every input that has changed, with the numbers that rest on it."""
    for file, sha256 in listed.inputs.items():
        path = folder / file
        if path.name == file and path.is_file() and sha256_of(path) == sha256:
            continue
        behind = [key for key, number in listed.numbers.items() if file in (*number.recordings, number.source.file)]
        standing = Standing.CHANGED if path.is_file() else Standing.MISSING
        if behind:
            fault = Message(NumberCode.INPUT, {"numbers": len(behind), "id": behind[0]})
            yield Link(f"{NUMBERS_FILE} ← {file}", standing, str(fault), fault.code)
        else:
            yield Link(f"{NUMBERS_FILE} ← {file}", standing)


def page_faults(key: str, number: ReportedNumberEntry, page: MarkedPage) -> Iterator[Fault]:
    """Why a number is not on the page as it is listed."""
    marked = page.numbers.get(key)
    attribute = None if isinstance(number.value, str) else attribute_of(number)
    if marked is None:
        yield Message(NumberCode.NOT_ON_PAGE, {"id": key})
    elif marked.text != number.text:
        yield Message(NumberCode.PAGE, {"id": key, "found": marked.text, "expected": number.text})
    elif marked.value != attribute:
        yield Message(NumberCode.PAGE, {"id": key, "found": str(marked.value), "expected": str(attribute)})


def read_page(folder: Path) -> MarkedPage:
    """The marks of the session's page; none without one."""
    try:
        return read_marks(read_regular(folder / REPORT_FILE, LARGEST_REPORT).decode("utf-8", "replace"))
    except OSError:
        return MarkedPage({}, {})


def _faults_on_page(listed: ReportDocument, page: MarkedPage) -> Iterator[Fault]:
    for key, number in listed.numbers.items():
        yield from page_faults(key, number, page)
    for key in page.numbers.keys() - listed.numbers.keys():
        yield Message(NumberCode.NOT_LISTED, {"id": key})


def _faults_of_figures(listed: ReportDocument, page: MarkedPage) -> Iterator[Fault]:
    for key in listed.figures.keys() | page.figures.keys():
        figure, marked = listed.figures.get(key), page.figures.get(key)
        if figure is None or marked is None:
            yield Message(NumberCode.NOT_LISTED if figure is None else NumberCode.NOT_ON_PAGE, {"id": key})
        elif (figure.caption, figure.sha256) != (marked.caption, marked.sha256):
            yield Message(NumberCode.FIGURE, {"id": key})


def _source_links(listed: ReportDocument, files: SourceFiles) -> Iterator[Link]:
    """A link for every file that numbers are from."""
    by_file: dict[str, dict[str, ReportedNumberEntry]] = {}
    for key, number in listed.numbers.items():
        by_file.setdefault(number.source.file, {})[key] = number
    for file, numbers in by_file.items():
        what = f"{NUMBERS_FILE} ← {file or 'recordings'}, {len(numbers)} numbers"
        if file == CUFFS_FILE and not (files.folder / file).is_file():
            yield Link(what, Standing.UNRECORDED, "the recordings were fitted for the report; verify with --recompute")
            continue
        yield _link(what, [fault for key, number in numbers.items() for fault in faults_of(key, number, files)])


def _link(what: str, faults: list[Fault]) -> Link:
    """As recorded without faults; else the first fault, and how many there are."""
    if not faults:
        return Link(what, Standing.AS_RECORDED)
    more = f"; and {len(faults) - 1} more" if len(faults) > 1 else ""
    return Link(what, Standing.CHANGED, f"{faults[0]}{more}", faults[0].code)
