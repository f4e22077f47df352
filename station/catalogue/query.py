"""Query the catalogue: filters, or SQL that reads only."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import duckdb

from documents.message import Message
from station.catalogue.index import KEY, CatalogueError, ended_by_ctrl_c
from station.messages.study_messages import CatalogueCode

if TYPE_CHECKING:
    import pandas as pd

LISTED = """
SELECT session, subject, operator, begun_utc, origin, cuff, donning, stiffness_n_per_m, damping_n_s_per_m, migration_m
FROM sessions LEFT JOIN cuffs USING (session)
"""


TABLE_FUNCTION = re.compile(r'"type":"TABLE_FUNCTION".*?"function_name":"([^"]*)"')
READING = {"range", "generate_series", "unnest", "duckdb_tables", "duckdb_columns"}
"""Functions in place of a table; others change settings, or write logs."""
READ_ONLY: dict[str, str | bool | int | float | list[str]] = {
    "enable_external_access": "false",
    "python_enable_replacements": "false",
}


@dataclass(frozen=True)
class SessionFilter:
    """Filter of the list of cuffs; None takes all. since and before compare with the start of the session in UTC."""

    subject: str | None = None
    operator: str | None = None
    cuff: str | None = None
    origin: str | None = None
    since: datetime | None = None
    before: datetime | None = None


def list_cuffs(path: Path, chosen: SessionFilter) -> pd.DataFrame:
    """A row for each donning of each cuff; a session that is not fitted has one without a cuff."""
    named = {name: getattr(chosen, name) for name in ("subject", "operator", "cuff", "origin")}
    conditions = [f"{name} = ?" for name, value in named.items() if value is not None]
    values: list[object] = [value for value in named.values() if value is not None]
    for operator, moment in ((">=", chosen.since), ("<", chosen.before)):
        if moment is not None:
            conditions.append(f"begun_utc {operator} ?")
            values.append(moment)
    where = f"WHERE {' AND '.join(conditions)}" if conditions else ""
    return run_sql(path, f"{LISTED} {where} ORDER BY begun_utc, session, cuff, donning", values)


@ended_by_ctrl_c()
def run_sql(path: Path, sql: str, values: list[object] | None = None) -> pd.DataFrame:
    """The result of one query. Raises CatalogueError for SQL that fails, is no query, or reads other files."""
    sql = sql.encode(errors="replace").decode()  # an argument that is not UTF-8 has halves of surrogate pairs
    try:
        _ensure_query(sql)
        with _reading(path) as connection:
            return connection.execute(sql, values or []).df()
    except (duckdb.Error, ValueError, OverflowError) as error:  # the latter two by values that pandas cannot have
        reason = " ".join(str(error).split())
        raise CatalogueError(Message(CatalogueCode.WRONG_SQL, {"reason": reason})) from error


def _ensure_query(sql: str) -> None:
    """Raise CatalogueError for anything but one query: other statements write, or change the database's settings."""
    kinds = [statement.type.name for statement in duckdb.extract_statements(sql)]
    if kinds != ["SELECT"]:
        figures = {"found": " and ".join(kinds) or "no statement"}
        raise CatalogueError(Message(CatalogueCode.NO_QUERY, figures))
    with duckdb.connect() as connection:
        (tree,) = connection.execute("SELECT json_serialize_sql(?)", [sql]).fetchone() or ("",)
    if others := set(TABLE_FUNCTION.findall(tree)) - READING:
        raise CatalogueError(Message(CatalogueCode.NO_QUERY, {"found": f"the function {min(others)}"}))


@ended_by_ctrl_c()
def known_participants(path: Path) -> tuple[list[str], dict[str, dict[str, str | None]]]:
    """Codes of the subjects with a session, and the rows of participants.tsv by id."""
    with _reading(path) as connection:
        found = connection.execute("SELECT DISTINCT subject FROM sessions WHERE subject <> ''").fetchall()
        rows = connection.execute("SELECT * FROM participants")
        names = [column[0] for column in rows.description or ()]
        known = [dict(zip(names, row, strict=True)) for row in rows.fetchall()]
    return [subject for (subject,) in found], {row[KEY]: row for row in known}


@contextmanager
def _reading(path: Path) -> Iterator[duckdb.DuckDBPyConnection]:
    with duckdb.connect(str(path), read_only=True, config=READ_ONLY) as connection:
        yield connection
