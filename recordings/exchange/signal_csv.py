"""A DAQ's CSV: a header that names the columns, one line per sample; separated by comma, semicolon or tab."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.sample_tables import SignalTable, require_rising, require_single_channels
from recordings.exchange.text import listed, read_lines, read_numbers, require_fields, without_blank_end, write_table

SEPARATORS = (",", ";", "\t")
ABOVE = re.compile(r'#|"?sep=.?"?\s*$', re.IGNORECASE)


def read_signals(path: Path, time_column: str, wanted: Sequence[str]) -> SignalTable:
    """Those of the wanted columns that are there; lines before the header are empty, begin with # or name the separator
    for a spreadsheet (sep=;).

    Raises ForeignFile where there is no time, a wanted column twice, a number is none, a line has fewer or more fields
    than titles, or the times do not rise.
    """
    lines = without_blank_end(read_lines(path))
    start = next(i for i, line in enumerate(lines) if line.strip() and (not ABOVE.match(line) or i == len(lines) - 1))
    separator, titles, height = _header(lines[start:], time_column)
    if not titles:
        raise ForeignFile(
            f"{path}, line {start + 1}, has a quote that does not end; correct the titles", RecordingCode.FOREIGN_TITLES
        )
    if time_column not in titles:
        raise ForeignFile(
            f"{path} has no column {time_column}, only {listed(titles)}; name it with --time-column",
            RecordingCode.FOREIGN_MISSING_COLUMN,
        )
    require_single_channels([title for title in titles if title in (time_column, *wanted)], str(path))
    chosen = [time_column, *(name for name in wanted if name in titles)]
    rows, first_line = lines[start + height :], start + height + 1
    values = read_numbers(rows, separator, [titles.index(name) for name in chosen], path, first_line)
    require_fields(rows, separator, titles, path, first_line)
    require_rising(values[:, 0], f"{path}, {time_column},", first_line)
    signals = {name: values[:, i + 1] for i, name in enumerate(chosen[1:])}
    return SignalTable(values[:, 0], signals, dict.fromkeys(signals, ""), tuple(titles))


def write_columns(columns: Mapping[str, NDArray[np.float64]], separator: str) -> str:
    """Columns (n,) of one length under their names, every number to the last bit, empty where it is NaN."""
    return write_table(tuple(columns), np.column_stack(tuple(columns.values())).tolist(), separator)


def _header(lines: Sequence[str], time_column: str) -> tuple[str, list[str], int]:
    """The separator under which the time column appears, or else the commonest, the titles, and their lines."""
    found = [(mark, *_titles(lines, mark)) for mark in sorted(SEPARATORS, key=lines[0].count, reverse=True)]
    return next((header for header in found if time_column in header[1]), found[0])


def _titles(lines: Sequence[str], separator: str) -> tuple[list[str], int]:
    """The titles, without the empty ones at their end, and the number of their lines, which quotes may join.

    No titles where a quote does not end.
    """
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    try:
        titles = [" ".join(title.split()) for title in next(reader)]
    except csv.Error:  # a field longer than the reader's limit
        return [], 1
    if 1 < reader.line_num == len(lines):  # the last field is the rest of the file
        return [], 1
    while len(titles) > 1 and not titles[-1]:
        titles.pop()
    return titles, reader.line_num
