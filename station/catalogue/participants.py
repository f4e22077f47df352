"""participants.tsv of BIDS: what is known of the volunteers beside their codes."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from documents.regular_file import LARGEST_TABLE, describe_failure, read_regular
from station.errors import StationError
from station.messages.message import Message
from station.messages.study_codes import CatalogueCode
from station.whole_file import write_whole

PARTICIPANTS_FILE = "participants.tsv"
KEY, PREFIX, MISSING = "participant_id", "sub-", "n/a"

Participants = dict[str, dict[str, str | None]]
"""participant_id → column → value, None where it is not known."""


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
            raise _wrong(path, f"line {number} has {len(row)} values for {len(header)} columns, or its id again")
        found[row[0]] = {name: None if value == MISSING else value for name, value in zip(header, row, strict=True)}
    return found


def write_participants(path: Path, subjects: Sequence[str], known: Mapping[str, Mapping[str, str | None]]) -> None:
    """A row for each subject, and for each participant that is known without a session, with all known columns."""
    columns = list(dict.fromkeys([KEY, *(name for row in known.values() for name in row)]))
    ids = sorted({PREFIX + subject for subject in subjects} | known.keys())
    rows = [[{**known.get(one, {}), KEY: one}.get(name) or MISSING for name in columns] for one in ids]
    write_whole(path, "".join("\t".join(row) + "\n" for row in [columns, *rows]))


def _wrong(path: Path, reason: str) -> CatalogueError:
    return CatalogueError(Message(CatalogueCode.WRONG_PARTICIPANTS, {"path": str(path), "reason": reason}))


class CatalogueError(StationError):
    """The catalogue cannot be built, written or queried."""
