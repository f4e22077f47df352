"""Build the catalogue of a folder of sessions, and keep it up to date.

A session is read again where its session.jsonl or cuffs.json has changed. Sessions that are gone are removed.

The folder of a session becomes rows of the catalogue. All content of its tables is derived from session folders, so
that the file can be deleted. What is known of the volunteers beside their codes is in BIDS' participants.tsv.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

import duckdb
import pandas as pd

from documents.interval import counted
from documents.message import Message, because
from documents.regular_file import LARGEST_TABLE, describe_failure, open_regular, read_regular
from fitting.cuffs.cuffs_file import CUFFS_FILE, CuffsFileError, read_cuffs_document
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.results.cuffs_schema import CuffEntry, CuffsDocument, TrialEntry
from station.checksums import JOURNAL_FILE, Checksums, drafted, file_sha256, list_in_session, write_whole
from station.errors import StationError
from station.folders import require_folder
from station.journal import Journal, JournalError, read_journal
from station.messages.study_messages import CatalogueCode
from station.progress import Progress, silent

CATALOGUE_FILE = "catalogue.duckdb"
BATCH = 200
"""Sessions that are written together."""
EMPTY_BYTES = 3 * 4096
"""The headers of a DuckDB file; a shorter one was left by a program that ended while it created the file."""
Row = dict[str, Any]

YEARS = range(1970, 2200)
FORMAT = 1
"""Of the tables; a catalogue of another format is built anew."""

TABLES: dict[str, dict[str, str]] = {
    "sessions": {
        "session": "VARCHAR PRIMARY KEY",  # folder, relative to that of the catalogue
        "subject": "VARCHAR",
        "operator": "VARCHAR",
        "number": "VARCHAR",
        "begun_utc": "TIMESTAMP",
        "origin": "VARCHAR",
        "state": "VARCHAR",  # fitted, not_fitted, unreadable
        "reason": "VARCHAR",
        "cuffs_sha256": "VARCHAR",
        "stamp": "VARCHAR",  # sizes and times of change of the files it was read from
    },
    "cuffs": {
        "session": "VARCHAR",
        "cuff": "VARCHAR",
        "donning": "VARCHAR",
        "is_last": "BOOLEAN",  # the cuff as last donned
        "site": "VARCHAR",
        "stiffness_n_per_m": "DOUBLE",
        "stiffness_standard_error": "DOUBLE",
        "damping_n_s_per_m": "DOUBLE",
        "damping_standard_error": "DOUBLE",
        "migration_m": "DOUBLE",
        "migration_standard_error": "DOUBLE",
        "verdicts": "VARCHAR",  # codes, separated by spaces
    },
    "trials": {
        "session": "VARCHAR",
        "file": "VARCHAR",
        "cuff": "VARCHAR",
        "test": "VARCHAR",
        "repeat": "INTEGER",
        "donning": "VARCHAR",
        "is_accepted": "BOOLEAN",
        "lost_samples": "BIGINT",
        "state": "VARCHAR",  # used, superseded, unusable; NULL before the fit
        "reason": "VARCHAR",  # code
        "stiffness_n_per_m": "DOUBLE",
        "damping_n_s_per_m": "DOUBLE",
        "migration_m": "DOUBLE",
        "sha256": "VARCHAR",
    },
}
"""Table → column → SQL type. participants has the columns of participants.tsv, all text."""
PARTICIPANTS_FILE = "participants.tsv"
KEY, PREFIX, MISSING = "participant_id", "sub-", "n/a"
Participants = dict[str, dict[str, str | None]]
"""participant_id → column → value, None where it is not known."""


@dataclass(frozen=True)
class Indexed:
    """Number of sessions in the catalogue, read now, removed now, and those that cannot be read with the reason."""

    sessions: int
    read: int
    removed: int
    unreadable: dict[str, str]


@contextmanager
def ended_by_ctrl_c() -> Iterator[None]:
    """DuckDB raises RuntimeError where Ctrl-C ends a statement."""
    try:
        yield
    except RuntimeError as error:
        if "interrupted" not in str(error):
            raise
        raise KeyboardInterrupt from error


@ended_by_ctrl_c()
def update_catalogue(folder: Path, path: Path, progress: Progress = silent, *, is_rebuilt: bool = False) -> Indexed:
    """Bring the catalogue at `path` up to date with the sessions below the folder. Raises CatalogueError."""
    require_folder(folder, CatalogueError)
    participants = _participants(folder)
    found = _sessions_below(folder)
    with _opened(path, is_rebuilt=is_rebuilt) as connection:
        known = dict(connection.execute("SELECT session, stamp FROM sessions").fetchall())
        gone = [name for name in known if name not in found]
        changed = [name for name, session in found.items() if known.get(name) != folder_stamp(session)]
        _delete(connection, [*gone, *(name for name in changed if name in known)])
        for first in range(0, len(changed), BATCH):
            progress("reading sessions", first, len(changed))
            _insert(connection, [read_rows(found[name], name) for name in changed[first : first + BATCH]])
        progress("reading sessions", len(changed), len(changed))
        _replace_participants(connection, participants)
        query = "SELECT session, reason FROM sessions WHERE state = ? ORDER BY session"
        unreadable = dict(connection.execute(query, [SessionState.UNREADABLE.value]).fetchall())
    return Indexed(len(found), len(changed), len(gone), unreadable)


@contextmanager
def _opened(path: Path, *, is_rebuilt: bool) -> Iterator[duckdb.DuckDBPyConnection]:
    """The catalogue for writing, in one transaction. A new one, or one in place of another format, is a draft first."""
    try:
        if not is_rebuilt and _is_current(path):
            with duckdb.connect(str(path)) as connection:
                connection.begin()
                yield connection
                connection.commit()
            list_in_session(path)
            return
        if path.exists():
            _ensure_ours(path)
        with drafted(path) as draft:
            with duckdb.connect(str(draft)) as connection:
                connection.execute(creation())
                yield connection
                connection.execute("CHECKPOINT")  # by closing, DuckDB does not report a full disk
            path.with_name(f"{path.name}.wal").unlink(missing_ok=True)
    except duckdb.Error as error:
        raise _not_opened(path, error) from error
    except OSError as error:
        figures = {"path": str(path), **because(error)}
        raise CatalogueError(Message(CatalogueCode.NOT_CREATED, figures)) from error


def _is_current(path: Path) -> bool:
    """Whether the file is a catalogue of this format; otherwise it has nothing that the folders do not have."""
    if not path.exists() or path.stat().st_size < EMPTY_BYTES:
        return False
    with duckdb.connect(str(path), read_only=True) as connection:
        try:
            return connection.execute("SELECT format FROM catalogue").fetchall() == [(FORMAT,)]
        except duckdb.CatalogException:
            return False


def _ensure_ours(path: Path) -> None:
    """Raise CatalogueError for a file of another program. A damaged file of DuckDB is taken for a catalogue."""
    with open_regular(path) as file:
        head = file.read(EMPTY_BYTES)
    if head[8:12] != b"DUCK" and head.strip(b"\0"):
        raise CatalogueError(Message(CatalogueCode.OTHER_DATABASE, {"path": str(path)}))
    if len(head) < EMPTY_BYTES:
        return
    try:
        with duckdb.connect(str(path), read_only=True) as connection:
            tables = {name for (name,) in connection.execute("SELECT table_name FROM duckdb_tables()").fetchall()}
    except duckdb.Error as error:
        if "Could not set lock" in str(error):
            raise
        return
    if tables and "catalogue" not in tables:
        raise CatalogueError(Message(CatalogueCode.OTHER_DATABASE, {"path": str(path)}))


def _not_opened(path: Path, error: Exception) -> CatalogueError:
    figures = {"path": str(path), "reason": str(error).partition("\n")[0].rstrip(".")}
    is_usable = path.exists() and os.access(path, os.W_OK)
    return CatalogueError(Message(CatalogueCode.NOT_OPENED if is_usable else CatalogueCode.NOT_CREATED, figures))


def _sessions_below(folder: Path) -> dict[str, Path]:
    """Name → folder, also the folder itself (name ".") where it is a session."""
    folders = {path.parent for name in (JOURNAL_FILE, CUFFS_FILE) for path in folder.rglob(name)}
    return {_printable(path.relative_to(folder).as_posix()): path for path in sorted(folders)}


def _printable(text: str) -> str:
    """A text without the bytes of file names that are not UTF-8, which no table can hold."""
    return text.encode(errors="backslashreplace").decode()


def _participants(folder: Path) -> Participants:
    path = folder / PARTICIPANTS_FILE
    return read_participants(path) if path.exists() else {}


def _delete(connection: duckdb.DuckDBPyConnection, names: Sequence[str]) -> None:
    for table in TABLES if names else ():
        connection.execute(f"DELETE FROM {table} WHERE session IN (SELECT unnest(?))", [list(names)])  # noqa: S608


def _insert(connection: duckdb.DuckDBPyConnection, sessions: Sequence[SessionRows]) -> None:
    _append(connection, "sessions", [one.session for one in sessions])
    _append(connection, "cuffs", [row for one in sessions for row in one.cuffs])
    _append(connection, "trials", [row for one in sessions for row in one.trials])


def _append(connection: duckdb.DuckDBPyConnection, table: str, rows: Sequence[Row]) -> None:
    """By a data frame: row by row would take a hundred times as long."""
    if not rows:
        return
    frame = pd.DataFrame.from_records(rows, columns=list(TABLES[table])).astype(object)
    connection.register("appended", frame.where(frame.notna(), None))
    columns = ", ".join(f"CAST({name} AS {kind.split()[0]})" for name, kind in TABLES[table].items())
    connection.execute(f"INSERT INTO {table} SELECT {columns} FROM appended")  # noqa: S608
    connection.unregister("appended")


def _replace_participants(connection: duckdb.DuckDBPyConnection, participants: Participants) -> None:
    columns = list(next(iter(participants.values()), {"participant_id": None}))
    quoted = ", ".join('"{}" VARCHAR'.format(name.replace('"', '""')) for name in columns)
    connection.execute(f"CREATE OR REPLACE TABLE participants ({quoted})")
    with suppress(StopIteration):
        next(iter(participants))
        marks = ", ".join("?" * len(columns))
        rows = [list(row.values()) for row in participants.values()]
        connection.executemany(f"INSERT INTO participants VALUES ({marks})", rows)  # noqa: S608


class SessionState(StrEnum):
    """Readable part of a session."""

    FITTED = "fitted"
    NOT_FITTED = "not_fitted"
    UNREADABLE = "unreadable"


@dataclass(frozen=True)
class SessionRows:
    """Rows of one session, by column."""

    session: Row
    cuffs: list[Row] = field(default_factory=list)
    trials: list[Row] = field(default_factory=list)


def folder_stamp(folder: Path) -> str:
    """Size and time of change of the session's journal and cuffs.json; it differs where either was written."""
    parts = []
    for name in (JOURNAL_FILE, CUFFS_FILE):
        with suppress(OSError):
            status = (folder / name).stat()
            parts.append(f"{name} {status.st_size} {status.st_mtime_ns}")
    return "; ".join(parts)


def read_rows(folder: Path, name: str) -> SessionRows:
    """The rows of a session; one that cannot be read has a row with the reason."""
    stamp = folder_stamp(folder)  # before the files are read: a change meanwhile is read the next time
    path = folder / CUFFS_FILE
    try:
        journal = read_journal(folder)
        begun = _moment(journal.begun)
        cuffs = read_cuffs_document(path) if path.is_file() else None
        hashes = Checksums(folder).sums
        trials = [{**row, "sha256": hashes.get(row["file"])} for row in _trials(name, journal, cuffs)]
    except (JournalError, CuffsFileError, _UnlikelyValue) as error:
        reason = {"state": SessionState.UNREADABLE.value, "reason": _printable(str(error))}
        return SessionRows({"session": name, "stamp": stamp, **reason})
    session = {
        "session": name,
        "begun_utc": begun,
        "origin": cuffs.origin.value if cuffs else None,
        "state": (SessionState.FITTED if cuffs else SessionState.NOT_FITTED).value,
        "cuffs_sha256": file_sha256(path) if cuffs else None,
        "stamp": stamp,
    }
    if journal.setup is not None:
        setup = journal.setup
        session |= {"subject": setup.subject, "operator": setup.operator, "number": setup.number}
    return SessionRows(session, [*_cuffs(name, cuffs)] if cuffs else [], trials)


class _UnlikelyValue(ValueError):
    """A value that no session has, and no table of the catalogue can hold."""


def _moment(text: str) -> datetime | None:
    """UTC without a time zone; None for an empty text. Raises _UnlikelyValue."""
    if not text:
        return None
    try:
        read = datetime.fromisoformat(text)
    except ValueError:
        raise _UnlikelyValue(f"its time is {text!r}, expected such as 2026-05-31T14:03:00+02:00") from None
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
    }


def creation() -> str:
    """SQL that creates the empty tables."""
    statements = [
        f"CREATE TABLE {name} ({', '.join(f'{column} {kind}' for column, kind in columns.items())})"
        for name, columns in TABLES.items()
    ]
    statements += ["CREATE TABLE participants (participant_id VARCHAR)", "CREATE TABLE catalogue (format INTEGER)"]
    return "; ".join([*statements, f"INSERT INTO catalogue VALUES ({FORMAT})"])  # noqa: S608


def read_participants(path: Path) -> Participants:
    """Raises CatalogueError for a file that is not the table of BIDS."""
    try:
        text = read_regular(path, LARGEST_TABLE).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise _wrong(path, describe_failure(error)) from error
    try:  # any line ends, also those of an old Macintosh
        rows = list(csv.reader(io.StringIO(text, newline=None), delimiter="\t", quoting=csv.QUOTE_NONE))
    except csv.Error as error:
        raise _wrong(path, str(error)) from error
    if "\0" in text:
        raise _wrong(path, "it contains NUL characters")
    if not rows or rows[0][:1] != [KEY]:
        raise _wrong(path, f"expected the first column {KEY}")
    header = rows[0]
    if len(set(map(str.casefold, header))) < len(header) or not all(header):
        raise _wrong(path, "a column has no name, or two have the same")
    found: Participants = {}
    for number, row in enumerate(rows[1:], 2):
        if not row:
            continue
        if len(row) != len(header) or row[0] in found:
            raise _wrong(
                path,
                f"line {number} has {counted(len(row), 'value')} for {counted(len(header), 'column')}, or its id again",
            )
        found[row[0]] = {name: None if value == MISSING else value for name, value in zip(header, row, strict=True)}
    return found


def write_participants(path: Path, subjects: Sequence[str], known: Mapping[str, Mapping[str, str | None]]) -> None:
    """A row for each subject, and for each participant that is known without a session, with all known columns.

    Raises CatalogueError where a file is there that is no such table, or has a value that the new one would lose.
    """
    columns = list(dict.fromkeys([KEY, *(name for row in known.values() for name in row)]))
    ids = sorted({PREFIX + subject for subject in subjects} | known.keys())
    rows = [[{**known.get(one, {}), KEY: one}.get(name) or MISSING for name in columns] for one in ids]
    for participant, row in read_participants(path).items() if path.exists() else ():
        kept = {**known.get(participant, {}), KEY: participant} if participant in ids else {}
        if lost := [name for name, value in row.items() if value is not None and kept.get(name) != value]:
            raise _wrong(path, f"{lost[0]} of {participant} would be lost; name a file that does not exist")
    write_whole(path, "".join("\t".join(row) + "\n" for row in [columns, *rows]))


def _wrong(path: Path, reason: str) -> CatalogueError:
    return CatalogueError(Message(CatalogueCode.WRONG_PARTICIPANTS, {"path": str(path), "reason": reason}))


class CatalogueError(StationError):
    """The catalogue cannot be built, written or queried."""
