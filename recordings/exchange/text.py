"""Tables in text files → numbers, whatever country's decimal mark they have; and numbers → text, to the last bit."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.regular_file import open_regular
from recordings.errors import ForeignFile, RecordingCode

MISSING = frozenset({"", "nan", "null", "n/a", "na", "-"})
"""How programs write a value that is not there."""
PRINTED_BY_C = re.compile(r"[+-]?(?:nan\(\w+\)|1\.#(?:ind|qnan|snan|inf)0*)", re.IGNORECASE)
"""How Microsoft's C library has printed numbers that are none: -nan(ind), 1.#QNAN, -1.#IND0."""


def read_lines(path: Path) -> list[str]:
    """The lines of a text file. Raises ForeignFile where it cannot be read, is empty or is no text."""
    try:
        with open_regular(path) as file:
            raw = file.read()
    except OSError as error:
        raise ForeignFile(
            f"{path} cannot be read: {error.strerror or error}", RecordingCode.FOREIGN_UNREADABLE
        ) from error
    if b"\0" in raw[:4096]:
        raise ForeignFile(
            f"{path} is no text file, expected a table in text; was it renamed?", RecordingCode.FOREIGN_WRONG_TYPE
        )
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    if not text.strip():
        raise ForeignFile(f"{path} is empty; export it again", RecordingCode.FOREIGN_EMPTY)
    return text.rstrip("\r\n \x1a").splitlines()


def read_numbers(
    lines: Sequence[str], separator: str, columns: Sequence[int], path: Path, first_line: int
) -> NDArray[np.float64]:
    """The chosen columns (from 0) of lines of fields → (lines, columns), NaN where a field is empty or not there.

    A comma inside a field is a decimal mark. Raises ForeignFile naming the line, counted from first_line.
    """
    with suppress(ValueError):  # a table without holes, of a country with decimal points: much faster
        whole = np.loadtxt(lines, delimiter=separator, usecols=columns, comments=None, ndmin=2) if lines else None
        if whole is not None and len(whole) == len(lines):
            return whole
    is_decimal_comma = separator != ","
    values = np.full((len(lines), len(columns)), np.nan)
    for i, line in enumerate(lines):
        fields = (line.replace(",", ".") if is_decimal_comma else line).split(separator)
        for j, column in enumerate(columns):
            field = fields[column].strip().strip('"') if column < len(fields) else ""
            if field.lower() in MISSING or PRINTED_BY_C.fullmatch(field):
                continue
            try:
                values[i, j] = float(field)
            except ValueError:
                raise ForeignFile(
                    f"{path}, line {first_line + i}, has {field!r} in column {column + 1}, expected a number",
                    RecordingCode.FOREIGN_NOT_A_NUMBER,
                ) from None
    return values


def printed_by_c(lines: Sequence[str]) -> tuple[str, ...]:
    """How numbers that are none are printed in these lines, where it is otherwise than by nan."""
    return tuple(sorted({found for line in lines for found in PRINTED_BY_C.findall(line)}))


def write_table(titles: Sequence[str], rows: Iterable[Sequence[float]], separator: str, missing: str = "") -> str:
    """A line of titles and a line per row, numbers in the fewest digits that give the same bits again."""
    return "\n".join([separator.join(titles), *(write_row(row, separator, missing) for row in rows)]) + "\n"


def write_row(row: Sequence[float], separator: str, missing: str = "") -> str:
    return separator.join(missing if math.isnan(number) else repr(float(number)) for number in row)
