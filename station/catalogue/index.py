"""Build the catalogue of a folder of sessions, and keep it up to date.

A session is read again where its session.jsonl or cuffs.json has changed. Sessions that are gone are removed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import duckdb
import pandas as pd

from documents.regular_file import open_regular
from fitting.cuffs.cuffs_file import CUFFS_FILE
from station.catalogue.errors import CatalogueError
from station.catalogue.participants import PARTICIPANTS_FILE, Participants, read_participants
from station.catalogue.session_rows import Row, SessionRows, SessionState, read_rows, stamp_of
from station.catalogue.tables import FORMAT, TABLES, creation
from station.checksums import list_in_session
from station.journal_lines import JOURNAL_FILE
from station.messages.message import Message
from station.messages.study_codes import CatalogueCode
from station.progress import Progress, silent
from station.whole_file import drafted

CATALOGUE_FILE = "catalogue.duckdb"
BATCH = 200
"""Sessions that are written together."""
EMPTY_BYTES = 3 * 4096
"""The headers of a DuckDB file; a shorter one was left by a program that ended while it created the file."""


@dataclass(frozen=True)
class Indexed:
    """Number of sessions in the catalogue, read now, removed now, and those that cannot be read with the reason."""

    sessions: int
    read: int
    removed: int
    unreadable: dict[str, str]


def update_catalogue(folder: Path, path: Path, progress: Progress = silent, *, is_rebuilt: bool = False) -> Indexed:
    """Bring the catalogue at `path` up to date with the sessions below the folder. Raises CatalogueError."""
    if not folder.is_dir():
        raise CatalogueError(Message(CatalogueCode.NOT_A_FOLDER, {"folder": str(folder)}))
    participants = _participants(folder)
    found = _sessions_below(folder)
    with _opened(path, is_rebuilt=is_rebuilt) as connection:
        known = dict(connection.execute("SELECT session, stamp FROM sessions").fetchall())
        gone = [name for name in known if name not in found]
        changed = [name for name, session in found.items() if known.get(name) != stamp_of(session)]
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
            path.with_name(f"{path.name}.wal").unlink(missing_ok=True)
    except duckdb.Error as error:
        raise _not_opened(path, error) from error
    except OSError as error:
        figures = {"path": str(path), "reason": error.strerror or str(error)}
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
    return {path.relative_to(folder).as_posix(): path for path in sorted(folders)}


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
