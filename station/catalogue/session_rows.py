"""A session's folder as rows of the catalogue."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from fitting.cuffs.cuffs_file import CUFFS_FILE, CuffsFileError, read_cuffs_document
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.results.cuffs_schema import CuffEntry, CuffsDocument, TrialEntry
from station.checksums import sha256_of
from station.journal import Journal, JournalError, read_journal
from station.journal_lines import JOURNAL_FILE

Row = dict[str, Any]


YEARS = range(1970, 2200)


class SessionState(StrEnum):
    """How much of a session there is to read."""

    FITTED = "fitted"
    NOT_FITTED = "not_fitted"
    UNREADABLE = "unreadable"


@dataclass(frozen=True)
class SessionRows:
    """Rows of one session, by column."""

    session: Row
    cuffs: list[Row] = field(default_factory=list)
    trials: list[Row] = field(default_factory=list)


def stamp_of(folder: Path) -> str:
    """Size and time of change of the session's journal and cuffs.json; it differs where either was written."""
    parts = []
    for name in (JOURNAL_FILE, CUFFS_FILE):
        with suppress(OSError):
            status = (folder / name).stat()
            parts.append(f"{name} {status.st_size} {status.st_mtime_ns}")
    return "; ".join(parts)


def read_rows(folder: Path, name: str) -> SessionRows:
    """The rows of a session; one that cannot be read has a row with the reason."""
    stamp = stamp_of(folder)  # before the files are read: a change meanwhile is read the next time
    path = folder / CUFFS_FILE
    try:
        journal = read_journal(folder)
        begun = _moment(journal.begun)
        cuffs = read_cuffs_document(path) if path.is_file() else None
        trials = _trials(name, journal, cuffs)
    except (JournalError, CuffsFileError, _UnlikelyValue) as error:
        reason = {"state": SessionState.UNREADABLE.value, "reason": str(error)}
        return SessionRows({"session": name, "stamp": stamp, **reason})
    session = {
        "session": name,
        "begun_utc": begun,
        "origin": cuffs.origin.value if cuffs else None,
        "state": (SessionState.FITTED if cuffs else SessionState.NOT_FITTED).value,
        "cuffs_sha256": sha256_of(path) if cuffs else None,
        "stamp": stamp,
    }
    if journal.setup is not None:
        setup = journal.setup
        session |= {"subject": setup.subject, "operator": setup.operator, "number": setup.number}
    return SessionRows(session, [*_cuffs(name, cuffs)] if cuffs else [], trials)


class _UnlikelyValue(ValueError):
    """A value that no session has, and no table of the catalogue can hold."""


def _moment(text: str) -> datetime | None:
    """UTC without a time zone; None for a text that is no time."""
    try:
        read = datetime.fromisoformat(text)
    except ValueError:
        return None
    if read.year not in YEARS:
        raise _UnlikelyValue(f"its time is {text}, expected a year from {YEARS.start} to {YEARS.stop - 1}")
    return read.astimezone(UTC).replace(tzinfo=None)


def _ensure_likely(trial: Row) -> Row:
    """Raises _UnlikelyValue for a number that an INTEGER or a BIGINT cannot hold."""
    for key, bits in (("repeat", 31), ("lost_samples", 63)):
        if not -(2**bits) <= trial.get(key, 0) < 2**bits:
            raise _UnlikelyValue(f"{key} of {trial['file']} is {trial[key]}")
    return trial


def _cuffs(session: str, document: CuffsDocument) -> Iterator[Row]:
    for cuff, donning, fitted, is_last in _donnings(document):
        row: Row = {"session": session, "cuff": cuff, "donning": donning, "is_last": is_last, "site": fitted.site}
        for quantity, key in QUANTITIES.items():
            figure = getattr(fitted, key)
            row |= {key: figure.value, f"{quantity}_standard_error": figure.standard_error}
        yield {**row, "verdicts": " ".join(fitted.verdict_codes)}


def _donnings(document: CuffsDocument) -> Iterator[tuple[str, str, CuffEntry, bool]]:
    for cuff, entry in document.cuffs.items():
        last = str(entry.donning)
        for donning, fitted in (entry.donnings or {last: entry}).items():
            yield cuff, donning, fitted, donning == last


def _trials(session: str, journal: Journal, document: CuffsDocument | None) -> list[Row]:
    """A row for each recording that the journal or the fit names."""
    redone = journal.redone
    rows: dict[str, Row] = {
        one.file: {
            "session": session,
            "file": one.file,
            "cuff": one.cuff,
            "test": one.test,
            "repeat": one.repeat,
            "donning": one.donning,
            "is_accepted": one.accepted and one.file not in redone,
            "lost_samples": one.lost_samples,
        }
        for one in journal.recorded
    }
    for cuff, donning, fitted, _ in _donnings(document) if document else ():
        for trial in fitted.trials:
            rows[trial.file] = {**rows.get(trial.file, {}), **_fitted(session, cuff, donning, trial)}
    return [_ensure_likely(row) for row in rows.values()]


def _fitted(session: str, cuff: str, donning: str, trial: TrialEntry) -> Row:
    return {
        "session": session,
        "file": trial.file,
        "cuff": cuff,
        "test": trial.test,
        "repeat": trial.repeat,
        "donning": donning,
        "state": trial.state,
        "reason": trial.reason_code.code.value if trial.reason_code else None,
        **{key: getattr(trial, key).value for key in QUANTITIES.values()},
        "sha256": trial.sha256,
    }
