"""QTM's export of marker trajectories as TSV: a header of key and values per line, then a row per frame.

After docs.qualisys.com/qtm/content/processing_measurement/motion_data_tsv.htm. Frame and Time columns and the line of
their titles are options of the export, so is the decimal mark of the country. Positions are in mm.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
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
from recordings.exchange.text import MISSING, is_number, read_lines, read_numbers, without_blank_end, write_row

KEY = re.compile(r"[A-Z][A-Z0-9_]+$")


def read_qtm_tsv(path: Path, unit: str = "mm") -> MarkerTable:
    """Raises ForeignFile where it is no such file, or not all of it is there."""
    lines = read_lines(path)
    header, first = _header(lines)
    if "MARKER_NAMES" not in header:
        raise ForeignFile(
            f"{path} has no line MARKER_NAMES, expected QTM's export of 3D trajectories as TSV with its header; "
            "tick Include TSV header in QTM's export settings",
            RecordingCode.FOREIGN_NO_HEADER,
        )
    labels, notes = distinct_labels(header["MARKER_NAMES"], f"{path}, MARKER_NAMES,")
    _require_count(header, "NO_OF_MARKERS", len(labels), "names", path)
    rows = lines[first:]
    if len(rows) > _announced(header, "NO_OF_FRAMES", len(rows)):
        rows = rows[: max(len(without_blank_end(rows)), _announced(header, "NO_OF_FRAMES", 0))]
    widest = max((row.count("\t") + 1 for row in rows), default=0)
    _require_count(header, "NO_OF_FRAMES", len(rows), "holds", path)
    extra = _leading_columns(lines[first - 1], rows, widest, len(labels), path)
    require_whole_positions(rows, extra, extra + 3 * len(labels), path, first + 1)
    values = read_numbers(rows, "\t", range(extra + 3 * len(labels)), path, first + 1)
    read = millimetres(unit, str(path)) * values[:, extra:].reshape(len(rows), len(labels), 3)
    notes += note_on_far(read, str(path))
    positions = without_origin(read)
    rate, time, on_rate = _time(values[:, :extra], header, str(path), first + 1)
    return MarkerTable(labels, rate, time, positions, np.zeros(positions.shape[:2]), notes + on_rate)


def write_qtm_tsv(table: MarkerTable, captured: datetime | None = None) -> str:
    """The text of such a file, with Frame and Time columns; a missing marker leaves its fields empty.

    Programs read the header by the places of its lines, so all of QTM's are there in its order. Cameras are not known
    and count 0; so do analog channels, which are in a file of their own.
    """
    header = [
        f"NO_OF_FRAMES\t{len(table.time_s)}",
        "NO_OF_CAMERAS\t0",
        f"NO_OF_MARKERS\t{len(table.labels)}",
        f"FREQUENCY\t{table.rate_hz:.12g}",
        "NO_OF_ANALOG\t0",
        "ANALOG_FREQUENCY\t0",
        "DESCRIPTION\t--",
        f"TIME_STAMP\t{captured:%Y-%m-%d, %H:%M:%S}" if captured else "TIME_STAMP\t--",
        "DATA_INCLUDED\t3D",
        "\t".join(("MARKER_NAMES", *table.labels)),
        "\t".join(("TRAJECTORY_TYPES", *("Measured" for _ in table.labels))),
        "\t".join(("Frame", "Time", *(f"{label} {axis}" for label in table.labels for axis in "XYZ"))),
    ]
    numbers = table.frame_numbers
    flat = table.positions.reshape(len(table.time_s), -1)
    rows = [
        f"{number}\t" + write_row((time, *row), "\t")
        for number, time, row in zip(numbers.tolist(), table.time_s.tolist(), flat.tolist(), strict=True)
    ]
    return "\n".join(header + rows) + "\n"


def _header(lines: Sequence[str]) -> tuple[dict[str, list[str]], int]:
    """The header's values by key, and the index of the first row: of numbers, or of tabs if it shows no marker."""
    header: dict[str, list[str]] = {}
    for i, line in enumerate(lines):
        key, *values = line.split("\t")
        if KEY.match(key.strip()):
            header[key.strip()] = [value.strip() for value in values if value.strip()]
            continue
        first = next(iter(line.split()), "")
        is_hidden = line and first.lower() in MISSING and "MARKER_NAMES" in header
        if is_hidden or is_number(first):
            return header, i
    return header, len(lines)


def _announced(header: dict[str, list[str]], key: str, otherwise: int) -> int:
    announced = header.get(key)
    return int(announced[0]) if announced and announced[0].isdigit() else otherwise


def _require_count(header: dict[str, list[str]], key: str, found: int, verb: str, path: Path) -> None:
    announced = _announced(header, key, found)
    if announced != found:
        raise ForeignFile(
            f"{path} announces {key} {announced} and {verb} {found}; export it again, whole", RecordingCode.FOREIGN_CUT
        )


def _leading_columns(titles: str, rows: Sequence[str], widest: int, markers: int, path: Path) -> int:
    """Number of columns before the first marker's: by their titles, else by counting fields."""
    names = [title.strip().lower() for title in titles.split("\t")]
    if names[0] in ("frame", "time"):
        return 2 if names[1] == "time" else 1
    extra = widest - 3 * markers
    empty = min((len(row) - len(row.rstrip("\t")) for row in rows), default=0)
    if extra > 0 and empty % 3 == 1:
        extra -= 1  # every row ends in a tab; a marker that is hidden in all of them leaves three
    if extra in (0, 1, 2):
        return extra
    raise ForeignFile(
        f"{path} has {counted(widest, 'column')} for {counted(markers, 'marker')}, expected "
        f"{3 * markers}, with Frame and Time at most "
        f"{3 * markers + 2}; export X, Y and Z of every trajectory and nothing else",
        RecordingCode.FOREIGN_TITLES,
    )


def _time(
    leading: NDArray[np.float64], header: dict[str, list[str]], where: str, first_line: int
) -> tuple[float, NDArray[np.float64], tuple[str, ...]]:
    """As settle_times, from the columns Frame and Time and from FREQUENCY."""
    announced = (header.get("FREQUENCY") or [""])[0]  # "EXT" where another device gave the beat
    rate = float(announced.replace(",", ".")) if is_number(announced) else 0.0
    numbers, time = np.arange(1, len(leading) + 1, dtype=np.float64), None
    for column in leading.T:
        if np.any(column % 1):
            time = column
        else:
            numbers = column
    if leading.shape[1] == 2:
        numbers, time = leading.T
    return settle_times(numbers, time, rate, where, first_line)
