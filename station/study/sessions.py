"""The sessions of a study: their folders, who was measured by whom, and the fitted values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from documents.message import Figures, Message, because, join_sentences
from fitting.cuffs.cuffs_file import CUFFS_FILE, CuffsFileError, read_cuffs_document
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.results.cuffs_schema import CuffEntry, CuffsDocument, FigureEntry, TrialEntry
from fitting.results.sentences import Note, verdict_messages
from fitting.study.cuff_study import Observation
from recordings.manifest import DataOrigin
from station.checksums import JOURNAL_FILE, file_sha256
from station.errors import StationError
from station.folders import require_folder
from station.journal import JournalError, read_journal
from station.messages.study_messages import StudyCode
from station.progress import Progress, silent

TESTS = {"stiffness": "static", "damping": "dynamic"}
"""Quantity → the test whose repeats each give a value. Migration is measured once in a donning."""
OWN = ("noise", "between_repeats")
"""Parts of a standard error that the other trials of the session do not share."""


class StudyError(StationError):
    """The study cannot be made."""


@dataclass(frozen=True)
class StudySession:
    """A fitted session: folder, codes of volunteer and operator, start (UTC), and its cuffs.json with its hash."""

    folder: Path
    volunteer: str
    operator: str
    begun: str
    cuffs: CuffsDocument
    sha256: str


@dataclass(frozen=True)
class StudySessions:
    """Sessions in the order of their folders, and why others are left out."""

    sessions: tuple[StudySession, ...]
    left_out: tuple[Message[StudyCode], ...]
    origin: DataOrigin


def session_folders(folders: Sequence[Path]) -> list[Path]:
    """Folders that are sessions, and the sessions below the others. Raises StudyError for a path that is no folder."""
    found: dict[Path, Path] = {}
    for folder in folders:
        require_folder(folder, StudyError)
        for session in [folder] if _is_session(folder) else sorted(_below(folder)):
            found.setdefault(session.resolve(), session)
    return list(found.values())


def read_sessions(folders: Sequence[Path], progress: Progress = silent) -> StudySessions:
    """Raises StudyError without a session that can be used, and where measured and simulated sessions are mixed."""
    paths = session_folders(folders)
    if not paths:
        raise StudyError(Message(StudyCode.NO_SESSION, {"folders": ", ".join(map(str, folders))}))
    read: list[StudySession] = []
    left_out: list[Message[StudyCode]] = []
    for done, path in enumerate(paths):
        progress("reading sessions", done, len(paths))
        session = read_session(path)
        if isinstance(session, StudySession):
            read.append(session)
        else:
            left_out.append(session)
    progress("reading sessions", len(paths), len(paths))
    if not read:
        figures: Figures = {"sessions": len(left_out), "left_out": join_sentences(left_out)}
        raise StudyError(Message(StudyCode.NO_USABLE_SESSION, figures))
    refuse_mixed(read)
    return StudySessions(tuple(read), tuple(left_out), DataOrigin.joined(session.cuffs.origin for session in read))


def read_session(folder: Path) -> StudySession | Message[StudyCode]:
    """A session, or why it cannot be used."""
    path = folder / CUFFS_FILE
    if not path.is_file():
        return Message(StudyCode.NOT_FITTED, {"session": str(folder)})
    try:
        journal, cuffs = read_journal(folder), read_cuffs_document(path)
    except (JournalError, CuffsFileError) as error:
        return Message(StudyCode.UNREADABLE, {"session": str(folder), **because(error)})
    if journal.setup is None or not journal.setup.subject:
        has_journal = (folder / JOURNAL_FILE).is_file()
        return Message(StudyCode.NO_VOLUNTEER if has_journal else StudyCode.NO_JOURNAL, {"session": str(folder)})
    return StudySession(folder, journal.setup.subject, journal.setup.operator, journal.begun, cuffs, file_sha256(path))


def select_measurements(
    session: StudySession, quantity: str
) -> tuple[dict[str, list[Observation]], list[Message[StudyCode]]]:
    """Cuff → values of the quantity in SI, and the donnings that have none that is identified."""
    found: dict[str, list[Observation]] = {}
    left_out: list[Message[StudyCode]] = []
    for cuff, entry in session.cuffs.cuffs.items():
        for donning, fitted in (entry.donnings or {str(entry.donning): entry}).items():
            if getattr(fitted, QUANTITIES[quantity]).value is None:
                figures = {"session": session.folder.name, "quantity": quantity, "cuff": cuff, "donning": donning}
                left_out.append(Message(StudyCode.NOT_IDENTIFIED, {**_reason(fitted), **figures}))
                continue
            values = [*_values(fitted, quantity)]
            found.setdefault(cuff, []).extend(
                _measurement(session, cuff, donning, repeat, figure) for repeat, figure in values
            )
    return found, left_out


def refuse_mixed(sessions: Sequence[StudySession]) -> None:
    """Raise StudyError where measured and simulated sessions are mixed."""
    by_origin: Mapping[DataOrigin, Path] = {session.cuffs.origin: session.folder for session in sessions}
    if {DataOrigin.MEASURED, DataOrigin.SIMULATED} <= by_origin.keys():
        figures = {kind: str(by_origin[DataOrigin(kind)]) for kind in ("measured", "simulated")}
        raise StudyError(Message(StudyCode.MIXED_ORIGIN, figures))


def _is_session(folder: Path) -> bool:
    return (folder / JOURNAL_FILE).is_file() or (folder / CUFFS_FILE).is_file()


def _below(folder: Path) -> set[Path]:
    return {path.parent for name in (JOURNAL_FILE, CUFFS_FILE) for path in folder.rglob(name)}


def _values(fitted: CuffEntry, quantity: str) -> Iterator[tuple[int, FigureEntry]]:
    """Repeat and value of every trial; of a donning without trials, and of migration, that of the donning."""
    trials: list[TrialEntry] = [
        trial for trial in fitted.trials if trial.state == "used" and trial.test == TESTS.get(quantity)
    ]
    figures = [(trial.repeat, getattr(trial, QUANTITIES[quantity])) for trial in trials]
    known = [(repeat, figure) for repeat, figure in figures if figure.value is not None]
    yield from known or [(1, getattr(fitted, QUANTITIES[quantity]))]


def _reason(fitted: CuffEntry) -> Figures:
    """Why a donning lacks a value: all verdicts as sentences, and the first of them as a code with its figures.

    A cuff that was written by hand has no codes; its reason is its verdict as written.
    """
    if not fitted.verdict_codes:
        return {"reason": fitted.verdict or "no value"}
    notes = (Note(note.code, note.figures) for note in fitted.note_codes)
    first, *others = verdict_messages(fitted.verdict_codes, notes)
    return {**first.figures, "reason": join_sentences([first, *others]), "reason_code": first.code.value}


def _measurement(session: StudySession, cuff: str, donning: str, repeat: int, figure: FigureEntry) -> Observation:
    shared = math.hypot(*(part for cause, part in figure.parts.items() if cause not in OWN))
    error = figure.standard_error or 0.0
    return Observation(
        value=figure.value or 0.0,
        noise=math.sqrt(max(0.0, error**2 - shared**2)),
        shared=shared,
        volunteer=session.volunteer,
        operator=session.operator,
        session=str(session.folder),
        donning=donning,
        repeat=repeat,
        cuff=cuff,
    )
