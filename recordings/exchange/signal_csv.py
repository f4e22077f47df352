"""A DAQ's CSV: a header that names the columns, one line per sample; separated by comma, semicolon or tab."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.tables import SignalTable, require_rising, require_single_channels
from recordings.exchange.text import (
    read_lines,
    read_numbers,
    require_fields,
    split_fields,
    without_blank_end,
    write_table,
)

SEPARATORS = (",", ";", "\t")


def read_signals(path: Path, time_column: str, wanted: Sequence[str]) -> SignalTable:
    """Those of the wanted columns that are there; lines before the header are empty or begin with #.

    Raises ForeignFile where there is no time, a wanted column twice, a number is none, a line has fewer or more fields
    than titles, or the times do not rise.
    """
    lines = without_blank_end(read_lines(path))
    start = next(
        i for i, line in enumerate(lines) if line.strip() and (not line.startswith("#") or i == len(lines) - 1)
    )
    separator, titles = _header(lines[start], time_column)
    if time_column not in titles:
        raise ForeignFile(
            f"{path} has no column {time_column}, only {', '.join(titles)}; name it with --time-column",
            RecordingCode.FOREIGN_MISSING_COLUMN,
        )
    require_single_channels([title for title in titles if title in (time_column, *wanted)], str(path))
    chosen = [time_column, *(name for name in wanted if name in titles)]
    values = read_numbers(lines[start + 1 :], separator, [titles.index(name) for name in chosen], path, start + 2)
    require_fields(lines[start + 1 :], separator, titles, path, start + 2)
    require_rising(values[:, 0], f"{path}, {time_column},", start + 2)
    signals = {name: values[:, i + 1] for i, name in enumerate(chosen[1:])}
    return SignalTable(values[:, 0], signals, dict.fromkeys(signals, ""), tuple(titles))


def write_columns(columns: Mapping[str, NDArray[np.float64]], separator: str) -> str:
    """Columns (n,) of one length under their names, every number to the last bit, empty where it is NaN."""
    return write_table(tuple(columns), np.column_stack(tuple(columns.values())).tolist(), separator)


def _header(line: str, time_column: str) -> tuple[str, list[str]]:
    """The separator under which the time column appears, or else the commonest, and the titles."""
    found = {separator: _titles(line, separator) for separator in sorted(SEPARATORS, key=line.count, reverse=True)}
    return next(((mark, titles) for mark, titles in found.items() if time_column in titles), next(iter(found.items())))


def _titles(line: str, separator: str) -> list[str]:
    """The titles, without the empty ones at the end of the line."""
    titles = [title.strip().strip('"') for title in split_fields(line, separator)]
    while len(titles) > 1 and not titles[-1]:
        titles.pop()
    return titles
