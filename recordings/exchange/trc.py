"""TRC, the marker file of OpenSim and others: five lines of header, then frame number, time, X Y Z of each marker."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.lengths import millimetres
from recordings.exchange.tables import MarkerTable, distinct_labels, settle_times, without_origin
from recordings.exchange.text import printed_by_c, read_lines, read_numbers, write_row


def read_trc(path: Path, unit: str = "", tracked: Collection[str] = ()) -> MarkerTable:
    """unit, where given, overrides the file's. Raises ForeignFile where it is none, or not all of it is there.

    A marker that is (0, 0, 0) in every frame was never seen, unless it is one of the tracked and the only such marker:
    then the file's origin was put there. Frames that show no marker do not count.
    """
    lines = read_lines(path)
    if len(lines) < 5 or not lines[0].startswith("PathFileType"):
        raise ForeignFile(
            f"{path} does not begin with PathFileType and five lines of header, expected a TRC file",
            RecordingCode.FOREIGN_WRONG_TYPE,
        )
    header = dict(zip(_fields(lines[1]), _fields(lines[2]), strict=False))
    labels, notes = distinct_labels(_fields(lines[3])[2:], str(path))
    first = next((i for i in range(4, len(lines)) if lines[i].split("\t", 1)[0].strip().isdigit()), len(lines))
    _require_markers(header, len(labels), path)
    if first == len(lines):
        raise ForeignFile(
            f"{path} has a header and no row of numbers below it; export it again, whole",
            RecordingCode.FOREIGN_TOO_SHORT,
        )
    rows, stale = _whole_rows(header, lines[first:], path)
    notes += stale + _notes_on_missing(rows, path)
    values = read_numbers(rows, "\t", range(2 + 3 * len(labels)), path, first + 1)
    scale = millimetres(unit or header.get("Units", ""), str(path))
    positions = scale * values[:, 2:].reshape(len(rows), len(labels), 3)
    found = without_origin(positions)
    shown = np.isfinite(found).any(axis=(1, 2))
    origin = _origin(positions[shown], labels, tracked)
    if origin is not None:
        found[shown, origin] = 0.0
        notes += (
            f"{path} has {labels[origin]}, and no other marker, at (0, 0, 0) in every frame that shows markers: it is "
            "taken for the origin, not for missing",
        )
    rate, time = settle_times(values[:, 0], values[:, 1], _rate(header, path), str(path), first + 1)
    return MarkerTable(labels, rate, time, found, np.zeros(found.shape[:2]), notes)


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


def _fields(line: str) -> Sequence[str]:
    return [field.strip() for field in line.split("\t") if field.strip()]


def _require_markers(header: dict[str, str], found: int, path: Path) -> None:
    announced = header.get("NumMarkers", str(found)).removesuffix(".0")
    if announced != str(found):
        raise ForeignFile(
            f"{path} announces NumMarkers {announced} and names {found}; export it again, whole",
            RecordingCode.FOREIGN_CUT,
        )


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
        return float(header.get("DataRate", "0"))
    except ValueError:
        raise ForeignFile(
            f"{path} has DataRate {header['DataRate']!r}, expected a number of frames a second",
            RecordingCode.FOREIGN_NO_RATE,
        ) from None
