"""TRC, the marker file of OpenSim and others: five lines of header, then frame number, time, X Y Z of each marker."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from recordings.errors import ForeignFile
from recordings.exchange.lengths import millimetres
from recordings.exchange.tables import MarkerTable, require_labels, settle_times, without_origin
from recordings.exchange.text import read_lines, read_numbers, write_row


def read_trc(path: Path, unit: str = "") -> MarkerTable:
    """unit, where given, overrides the file's. Raises ForeignFile where it is none, or not all of it is there."""
    lines = read_lines(path)
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise ForeignFile(f"{path} does not begin with PathFileType and five lines of header, expected a TRC file")
    header = dict(zip(_fields(lines[1]), _fields(lines[2]), strict=False))
    labels = tuple(_fields(lines[3])[2:])
    require_labels(labels, str(path))
    first = next((i for i in range(4, len(lines)) if lines[i].split("\t", 1)[0].strip().isdigit()), len(lines))
    rows = lines[first:]
    for key, found, verb in (("NumMarkers", len(labels), "names"), ("NumFrames", len(rows), "holds")):
        if header.get(key, str(found)).removesuffix(".0") != str(found):
            raise ForeignFile(f"{path} announces {key} {header[key]} and {verb} {found}; export it again, whole")
    values = read_numbers(rows, "\t", range(2 + 3 * len(labels)), path, first + 1)
    scale = millimetres(unit or header.get("Units", ""), str(path))
    positions = without_origin(scale * values[:, 2:].reshape(len(rows), len(labels), 3))
    rate, time = settle_times(values[:, 0], values[:, 1], _rate(header, path), str(path), first + 1)
    return MarkerTable(labels, rate, time, positions, np.zeros(positions.shape[:2]))


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


def _rate(header: dict[str, str], path: Path) -> float:
    try:
        return float(header.get("DataRate", "0"))
    except ValueError:
        raise ForeignFile(f"{path} has DataRate {header['DataRate']!r}, expected a number of frames a second") from None
