"""TRC, the marker file of OpenSim and others: five lines of header, then frame number, time, X Y Z of each marker."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.sample_tables import (
    MarkerTable,
    distinct_labels,
    millimetres,
    note_on_far,
    require_whole_positions,
    settle_times,
    without_origin,
)
from recordings.exchange.text import is_number, printed_by_c, read_lines, read_numbers, without_blank_end, write_row

SEPARATORS = ("\t", ";", ",")
COLUMNS_BEFORE = 2
"""Frame number and time."""


def read_trc(path: Path, unit: str = "", tracked: Collection[str] = ()) -> MarkerTable:
    """unit, where given, overrides the file's. Raises ForeignFile where it is none, or not all of it is there.

    A marker that is (0, 0, 0) in every frame was never seen, unless it is one of the tracked and the only such marker:
    then the file's origin was put there. Frames that show no marker do not count.
    """
    lines = without_blank_end(read_lines(path))
    if len(lines) < 5 or not lines[0].strip('" ').startswith("PathFileType"):
        raise ForeignFile(
            f"{path} does not begin with PathFileType and five lines of header, expected a TRC file",
            RecordingCode.FOREIGN_WRONG_TYPE,
        )
    separator = _separator(max(lines[4:], key=len))
    lines = [lines[0], *(_tabbed(line) for line in lines[1:])]
    header = _header(lines[1], lines[2])
    columns, names = _named_columns(lines[3])
    labels, notes = distinct_labels(names, str(path))
    first = next((i for i in range(4, len(lines)) if is_number(lines[i].split("\t", 1)[0])), len(lines))
    notes += _note_on_markers(header, len(labels), path)
    if first == len(lines):
        raise ForeignFile(
            f"{path} has a header and no row of numbers below it; export it again, whole",
            RecordingCode.FOREIGN_TOO_SHORT,
        )
    rows, stale = _whole_rows(header, lines[first:], path)
    notes += stale + _notes_on_missing(rows, path)
    notes += _notes_on_columns(rows, columns[-1] + 3, path, first + 1, separator)
    require_whole_positions(rows, COLUMNS_BEFORE, columns[-1] + 3, path, first + 1)
    read = [0, 1, *(column + axis for column in columns for axis in range(3))]
    values = read_numbers(rows, "\t", read, path, first + 1)
    scale = millimetres(unit or header.get("Units", ""), str(path))
    positions = scale * values[:, 2:].reshape(len(rows), len(labels), 3)
    found = without_origin(positions)
    notes += note_on_far(positions, str(path))
    shown = np.isfinite(found).any(axis=(1, 2))
    origin = _origin(positions[shown], labels, tracked)
    if origin is not None:
        found[shown, origin] = 0.0
        notes += (
            f"{path} has {labels[origin]}, and no other marker, at (0, 0, 0) in every frame that shows markers: it is "
            "taken for the origin, not for missing",
        )
    rate, time, on_rate = settle_times(values[:, 0], values[:, 1], _rate(header, path), str(path), first + 1)
    return MarkerTable(labels, rate, time, found, np.zeros(found.shape[:2]), notes + on_rate)


def write_trc(table: MarkerTable, name: str) -> str:
    """The text of a TRC file in mm; a missing marker leaves its fields empty, which OpenSim reads as NaN.

    Rows end in a tab, as OpenSim's own do: without it OpenSim overlooks the last field where that is empty.
    """
    rate, frames = f"{table.rate_hz:.12g}", len(table.time_s)
    header = [
        f"PathFileType\t4\t(X/Y/Z)\t{name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{frames}\t{len(table.labels)}\tmm\t{rate}\t1\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(table.labels) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{i + 1}" for i in range(len(table.labels)) for axis in "XYZ"),
        "",
    ]
    flat = table.positions.reshape(frames, -1)
    rows = [
        f"{number}\t" + write_row((time, *row), "\t") + "\t"
        for number, (time, row) in enumerate(zip(table.time_s.tolist(), flat.tolist(), strict=True), start=1)
    ]
    return "\n".join(header + rows) + "\n"


def _separator(line: str) -> str | None:
    """None if blanks alone separate its fields; commas may be decimal marks then."""
    return next((mark for mark in SEPARATORS if mark in line and " " not in line.partition(mark)[0].strip()), None)


def _tabbed(line: str) -> str:
    """A line with tabs between its fields, which other programs separate by semicolons, commas or blanks."""
    separator = _separator(line)
    return line if separator == "\t" else "\t".join(field.strip() for field in line.split(separator))


def _header(keys: str, values: str) -> dict[str, str]:
    """Values by key; an empty value keeps its place, and there may be more tabs between the others."""
    columns = [[field.strip() for field in line.split("\t")] for line in (keys, values)]
    filled = [[field for field in fields if field] for fields in columns]
    return dict(zip(*(filled if len(filled[0]) == len(filled[1]) else columns), strict=False))


def _named_columns(line: str) -> tuple[list[int], list[str]]:
    """The first column of each marker, and its name, of the line of names: a name stands above the first of three
    columns, or else the names stand side by side.
    """
    fields = [field.strip() for field in line.split("\t")][COLUMNS_BEFORE:]
    columns = [i for i, field in enumerate(fields) if field]
    if any(column % 3 for column in columns):  # side by side
        columns = [3 * i for i in range(len(columns))]
    return [COLUMNS_BEFORE + column for column in columns], [field for field in fields if field]


def _note_on_markers(header: dict[str, str], found: int, path: Path) -> tuple[str, ...]:
    """A note where more markers are named than announced: Cortex adds virtual ones. Raises ForeignFile for fewer."""
    announced = header.get("NumMarkers", str(found)).removesuffix(".0")
    if announced == str(found):
        return ()
    if announced.isdigit() and int(announced) < found:
        return (f"{path} announces NumMarkers {announced} and names {found}: all of these are read",)
    raise ForeignFile(
        f"{path} announces NumMarkers {announced} and names {found}; export it again, whole", RecordingCode.FOREIGN_CUT
    )


def _notes_on_columns(
    rows: Sequence[str], count: int, path: Path, first_line: int, separator: str | None
) -> tuple[str, ...]:
    """A note on numbers of markers without a name behind the others, between tabs.

    Raises ForeignFile for them where other marks separate the columns, and may be part of a number, and for too few
    with blanks: then the names may not be those of the columns.
    """
    note: tuple[str, ...] = ()
    for i, row in enumerate(rows):
        found = len(row.rstrip().split("\t"))
        if found > count and separator == "\t":
            note = (f"{path} has numbers of markers without a name, which are not read",)
        elif found > count or (separator is None and found < count):
            raise ForeignFile(
                f"{path}, line {first_line + i}, has {counted(found, 'column')}, expected {count} of the "
                "markers that line 4 "
                "names; export it again, with a point in decimals and tabs between the columns",
                RecordingCode.FOREIGN_TITLES,
            )
    return note


def _whole_rows(header: dict[str, str], rows: list[str], path: Path) -> tuple[list[str], tuple[str, ...]]:
    """The rows that are whole, and a note where they are not as many as announced.

    Where a file holds fewer and does not end with its last line, a digit of that line may be missing: it is left out.
    """
    announced, found = header.get("NumFrames", str(len(rows))).removesuffix(".0"), len(rows)
    if announced == str(found):
        return rows, ()
    note = f"{path} announces NumFrames {announced} and holds {found}: all of these are read; check that it is complete"
    is_ended = path.read_bytes().endswith((b"\n", b"\r"))
    if is_ended or not announced.isdigit() or int(announced) < found:
        return rows, (note,)
    return rows[:-1], (f"{path} announces NumFrames {announced} and ends within row {found}: {found - 1} are read",)


def _notes_on_missing(rows: Sequence[str], path: Path) -> tuple[str, ...]:
    printed = printed_by_c(rows)
    return (f"{path} has {', '.join(printed)} for values that are read as missing",) if printed else ()


def _origin(positions: NDArray[np.float64], labels: Sequence[str], tracked: Collection[str]) -> int | None:
    """Index of the marker that is the file's origin, if there is one; of the frames that show markers."""
    never_moved = np.flatnonzero((positions == 0).all(axis=(0, 2)))
    return int(never_moved[0]) if len(never_moved) == 1 and labels[never_moved[0]] in tracked else None


def _rate(header: dict[str, str], path: Path) -> float:
    try:
        return float(header.get("DataRate", "").replace(",", ".") or 0)
    except ValueError:
        raise ForeignFile(
            f"{path} has DataRate {header['DataRate']!r}, expected a number of frames a second",
            RecordingCode.FOREIGN_NO_RATE,
        ) from None
