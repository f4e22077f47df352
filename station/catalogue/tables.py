"""Tables of the catalogue. All of their content is derived from session folders, so that the file can be deleted."""

from __future__ import annotations

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


def creation() -> str:
    """SQL that creates the empty tables."""
    statements = [
        f"CREATE TABLE {name} ({', '.join(f'{column} {kind}' for column, kind in columns.items())})"
        for name, columns in TABLES.items()
    ]
    statements += ["CREATE TABLE participants (participant_id VARCHAR)", "CREATE TABLE catalogue (format INTEGER)"]
    return "; ".join([*statements, f"INSERT INTO catalogue VALUES ({FORMAT})"])  # noqa: S608
