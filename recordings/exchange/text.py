"""Tables in text files → numbers, whatever country's decimal mark they have; and numbers → text, to the last bit."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from documents.regular_file import open_regular
from recordings.errors import ForeignFile, RecordingCode

MISSING = frozenset({"", "nan", "null", "n/a", "na", "-"})
"""Texts by which programs write a missing value."""
PRINTED_BY_C = re.compile(r"[+-]?(?:nan\(\w+\)|1\.#(?:ind|qnan|snan|inf)0*)", re.IGNORECASE)
"""Texts by which Microsoft's C library has printed numbers that are none: -nan(ind), 1.#QNAN, -1.#IND0."""

BYTE_ORDER_MARKS = (b"\xff\xfe", b"\xfe\xff")
"""Of UTF-16, in which spreadsheets save "Unicode text"."""

LONGEST_QUOTED = 40
"""Characters of a field in a sentence."""

_LINE_END = re.compile(r"\r*\n|\r")
_BLANK = ' \t,;"'


def read_lines(path: Path) -> list[str]:
    """The lines of a text file. Raises ForeignFile where it cannot be read, is empty or is no text."""
    try:
        with open_regular(path) as file:
            raw = file.read()
    except OSError as error:
        raise ForeignFile(
            f"{path} cannot be read: {error.strerror or error}", RecordingCode.FOREIGN_UNREADABLE
        ) from error
    is_utf16 = raw.startswith(BYTE_ORDER_MARKS)
    if b"\0" in raw[:4096] and not is_utf16:
        raise ForeignFile(
            f"{path} is no text file, expected a table in text; was it renamed?", RecordingCode.FOREIGN_WRONG_TYPE
        )
    if b"\0" in raw and not is_utf16:
        raise ForeignFile(
            f"{path}, line {raw[: raw.index(0)].count(10) + 1}, has bytes that are zero, expected text: the file is "
            "damaged; copy or export it again",
            RecordingCode.FOREIGN_DAMAGED,
        )
    try:
        text = raw.decode("utf-16" if is_utf16 else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    if not text.strip():
        raise ForeignFile(f"{path} is empty; export it again", RecordingCode.FOREIGN_EMPTY)
    text = text.rstrip("\r\n \x1a").replace("\r\n", "\n")
    return _LINE_END.split(text) if "\r" in text else text.split("\n")  # the expression takes six times as long


def split_fields(line: str, separator: str) -> list[str]:
    """The fields of a line; a quoted one may hold the separator."""
    return (
        next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        if '"' in line
        else line.split(separator)
    )


def is_number(field: str) -> bool:
    """Whether a field is a number, with a point or a comma before its decimals."""
    try:
        float(field.replace(",", "."))
    except ValueError:
        return False
    return True


def without_blank_end(lines: Sequence[str]) -> Sequence[str]:
    """The lines up to the last one with a field that is not empty."""
    count = len(lines)
    while count and not lines[count - 1].strip(_BLANK):
        count -= 1
    return lines[:count]


def read_numbers(
    lines: Sequence[str], separator: str, columns: Sequence[int], path: Path, first_line: int
) -> NDArray[np.float64]:
    """The chosen columns (from 0) of lines of fields → (lines, columns), NaN where a field is empty or not there.

    A comma inside a field is a decimal mark, unless the separator is a comma, or the columns have decimal points too.
    Raises ForeignFile naming the line, counted from first_line.
    """
    with suppress(ValueError):  # a table without holes, of a country with decimal points: much faster
        options: dict[str, Any] = {"delimiter": separator, "usecols": columns, "quotechar": '"'}
        whole = np.loadtxt(lines, comments=None, ndmin=2, **options) if lines else np.zeros((0, len(columns)))
        if len(whole) == len(lines):
            return whole
    values, marks = np.full((len(lines), len(columns)), np.nan), set()
    for i, line in enumerate(lines):
        fields = split_fields(line, separator)
        for j, column in enumerate(columns):
            field = fields[column].strip().strip('"') if column < len(fields) else ""
            if field.lower() in MISSING or PRINTED_BY_C.fullmatch(field):
                continue
            marks |= {",", "."}.intersection(field)
            is_decimal_comma = marks == {","} and separator != ","
            try:
                number = field.replace(",", ".") if is_decimal_comma else field
                values[i, j] = float(number.replace("_", "?"))  # float() accepts 1_000, which is no number of a table
            except ValueError:
                raise _no_number(path, first_line + i, field, column) from None
    return values


def require_fields(lines: Sequence[str], separator: str, titles: Sequence[str], path: Path, first_line: int) -> None:
    """Raises ForeignFile at the first line that has not a field for each title, without the empty ones at its end."""
    count = len(titles)
    for i, line in enumerate(lines):
        if '"' not in line and line.count(separator) == count - 1:
            continue
        fields = split_fields(line, separator)
        if len(fields) < count or any(field.strip() for field in fields[count:]):
            is_comma = separator == "," and len(fields) > count
            remedy = "are decimals written with commas? Export points, or semicolons between columns"
            raise ForeignFile(
                f"{path}, line {first_line + i}, has {counted(len(fields), 'field')}, expected {count} "
                f"({listed(titles)}); "
                f"{remedy if is_comma else 'repair the line, or export it again'}",
                RecordingCode.FOREIGN_TITLES,
            )


def _no_number(path: Path, line: int, field: str, column: int) -> ForeignFile:
    remedy = "; write decimals with a point, and no mark of thousands" if re.fullmatch(r"[-+\d.,]+", field) else ""
    return ForeignFile(
        f"{path}, line {line}, has {field[:LONGEST_QUOTED]!r} in column {column + 1}, expected a number{remedy}",
        RecordingCode.FOREIGN_NOT_A_NUMBER,
    )


def listed(titles: Sequence[str]) -> str:
    """Titles of a table for a sentence, in quotes where they contain a comma."""
    return ", ".join(f'"{title}"' if "," in title else title for title in titles)


def printed_by_c(lines: Sequence[str]) -> tuple[str, ...]:
    """Texts other than nan by which these lines mark numbers that are none."""
    return tuple(sorted({found for line in lines for found in PRINTED_BY_C.findall(line)}))


def write_table(titles: Sequence[str], rows: Iterable[Sequence[float]], separator: str, missing: str = "") -> str:
    """A line of titles and a line per row, numbers in the fewest digits that give the same bits again."""
    return "\n".join([separator.join(titles), *(write_row(row, separator, missing) for row in rows)]) + "\n"


def write_row(row: Sequence[float], separator: str, missing: str = "") -> str:
    return separator.join(missing if math.isnan(number) else repr(float(number)) for number in row)
