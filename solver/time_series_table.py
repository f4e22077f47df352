"""Tables over time in files: .mot and .sto with OpenSim's header, and .csv."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from documents.regular_file import LARGEST_TABLE, describe_failure, read_regular
from solver.errors import MotionError, SolverCode

Array = NDArray[np.float64]
FEWEST_SAMPLED, LONGEST_STEP_S = 20, 0.5
"""Rows and median step [s] of a table that was sampled, not written by hand; a longer step is one in ms."""
SMALLER_UNITS = (("ms", 1e3), ("µs", 1e6), ("ns", 1e9))
"""And how many of it are a second."""
LEAST_ROWS_ALIKE, LEAST_DECIMALS = 20, 3
"""Rows of numbers with equally many decimals, at least so many, from which all are written so. Fewer rows or decimals
are also those of a program that drops zeros at the end of a number.
"""
_FILLING = " \t,;"
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(e[-+]?\d+)?", re.IGNORECASE)


@dataclass(frozen=True)
class TableHeader:
    """Header lines of a table.

    in_degrees  whether angles are in degrees
    rows        number of rows, nRows or SIMM's datarows; None where it is not stated
    repeated    rows that are left out because they are those before them, as OpenSim's RRA writes its last one
    """

    in_degrees: bool = False
    rows: int | None = None
    repeated: int = 0

    def row_counts(self, found: int) -> tuple[int, int] | None:
        """Rows that are stated and rows of the file, found and repeated, if they differ; None if they do not."""
        found += self.repeated
        return None if self.rows in (None, found) else (self.rows, found)


def write_table(
    path: Path, names: Sequence[str], time: Array, values: Array, notes: Mapping[str, str] | None = None
) -> None:
    """Write time [s] and values (frames, names) with a column per name, and notes above them, a line each.

    A .csv has its notes behind a #, anything else OpenSim's header. In the latter a value that is not finite is a
    MotionError, because OpenSim's Storage stops reading there without a message.
    """
    is_csv = path.suffix == ".csv"
    if not is_csv and not np.isfinite(values).all():
        raise MotionError(
            f"{path.name} should hold finite numbers, or OpenSim stops reading there; leave these frames out",
            SolverCode.NOT_FINITE,
        )
    separator = "," if is_csv else "\t"
    lines = [f"{'# ' * is_csv}{name}={note}" for name, note in (notes or {}).items()]
    if not is_csv:
        counts = f"version=1\nnRows={len(time)}\nnColumns={len(names) + 1}\ninDegrees=no"
        lines = [path.stem, counts, *lines, "endheader"]
    lines.append(separator.join(["time", *names]))
    row = separator.join(["%.10g"] * (len(names) + 1))
    lines += [row % tuple(numbers) for numbers in np.column_stack([time, values]).tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_table(path: Path, *, may_have_gaps: bool = False) -> tuple[list[str], Array, TableHeader]:
    """Names of the columns, their values (frames, columns), and the header; all rows are read, whatever it states, but
    none that repeats the row before it.

    Of a .mot or .sto with OpenSim's header, or a .csv, where lines that begin with # are skipped. may_have_gaps:
    numbers that are not finite are returned, except times. Raises MotionError.
    """
    try:
        raw = read_regular(path, LARGEST_TABLE)
    except OSError as error:
        sentence = f"{path} should be a motion file and cannot be read ({describe_failure(error)}); check the path"
        raise MotionError(sentence, SolverCode.UNREADABLE_TABLE) from error
    lines = _lines(path, raw)
    if path.suffix.lower() == ".trc":
        sentence = f"{path.name} should be a table over time (.mot, .sto, .csv) and holds markers; see `station ik`"
        raise MotionError(sentence, SolverCode.MALFORMED_TABLE)
    header, first = TableHeader(), 0
    if path.suffix != ".csv":
        ends = [i for i, line in enumerate(lines) if line.strip(_FILLING) == "endheader"]
        if not ends:
            sentence = f"{path.name} should have a line 'endheader' above its table and has none; check it"
            raise MotionError(sentence, SolverCode.MALFORMED_TABLE)
        first = ends[0] + 1
        header = _parse_header(lines[: ends[0]], path)
    given = [line for line in lines[first:] if line.strip() and line[0] != "#"]
    rows = [line.replace(",", " ") for line in given]
    if len(rows) < 3:
        sentence = f"{path.name} should have a row of names and at least two frames and has {counted(len(rows), 'row')}"
        raise MotionError(sentence, SolverCode.NO_FRAMES)
    names = rows[0].split()
    try:
        table = np.loadtxt(rows[1:], comments=None, ndmin=2)
    except ValueError as error:
        _ensure_points(path, given)
        _ensure_same_length(path, rows)
        sentence = f"{path.name} should hold numbers below its names ({error}); check the file"
        raise MotionError(sentence, SolverCode.MALFORMED_TABLE) from error
    if table.shape[1] != len(names):
        names = _names_with_spaces(given[0])
    if table.shape[1] != len(names):
        _ensure_points(path, given)
        _ensure_same_length(path, rows)
    if raw[-1:] not in (b"\n", b"\r"):
        _ensure_whole_end(path, rows)
    checked = table[:, :1] if may_have_gaps else table
    if not np.isfinite(checked).all():
        frame, column = np.argwhere(~np.isfinite(checked))[0]
        sentence = f"{path.name} should hold finite numbers and has {names[column]} {table[frame, column]}"
        raise MotionError(f"{sentence} in frame {frame + 1}; fill or cut the gap", SolverCode.NOT_FINITE)
    known = np.nan_to_num(table)
    is_new = np.append(True, (known[1:] != known[:-1]).any(axis=1))
    if is_new.sum() < 2:
        raise MotionError(
            f"{path.name} should have times that increase and has one row again and again", SolverCode.UNEVEN_TIME
        )
    return names, table[is_new], replace(header, repeated=int(np.sum(~is_new)))


def _lines(path: Path, raw: bytes) -> list[str]:
    if b"\0" in raw:
        sentence = f"{path.name} should be text in UTF-8 and has bytes of zero, as text in UTF-16 has; save it as UTF-8"
        raise MotionError(sentence, SolverCode.MALFORMED_TABLE)
    try:
        return raw.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:  # a name with an accent in the header of an older program
        return raw.decode("latin-1").splitlines()


def ensure_seconds(path: Path, time: Array, motion: Array | None = None) -> None:
    """Raise MotionError for times (frames,) whose steps are those of milliseconds, smaller units or frame numbers.

    motion: times [s] that the table is for. A table of few rows has milliseconds if it begins and ends with the motion,
    within a step, a thousand times later, and the motion lies within one step of it.
    """
    step = float(np.median(np.diff(time)))
    is_in_ms = len(time) >= FEWEST_SAMPLED and step >= LONGEST_STEP_S
    if motion is not None and len(time) > 2 and step >= motion[-1] - motion[0]:
        is_in_ms |= bool((np.abs(time[[0, -1]] - 1e3 * motion[[0, -1]]) <= step).all())
    if is_in_ms:
        unit, in_second = next((unit for unit in SMALLER_UNITS if step / unit[1] < LONGEST_STEP_S), SMALLER_UNITS[-1])
        remedy = f"divide them by {in_second:.0f}" + ", or frame numbers by the rate" * (step == 1.0)
        raise MotionError(
            f"{path.name} should have times in s and has steps of {step:g}, as of times in {unit}; {remedy}",
            SolverCode.TIME_UNIT,
        )


def _names_with_spaces(row: str) -> list[str]:
    """Names that tabs separate, or else commas, as a name may contain spaces."""
    separator = "\t" if "\t" in row else ","
    return [name.strip() for name in row.strip(_FILLING).split(separator)]


def _ensure_points(path: Path, rows: Sequence[str]) -> None:
    """Raise MotionError for decimal commas, below the row of names: in a cell between tabs, spaces or semicolons, or in
    a row with commas alone, which then has more cells than names, and no point.
    """
    count = len(rows[0].split(","))
    for row in rows[1:]:
        cells, between_commas = re.split(r"[\s;]+", row.strip()), row.split(",")
        found = [cell for cell in cells if len(cells) > 1 and _DECIMAL_COMMA.fullmatch(cell)]
        if len(cells) == 1 and len(between_commas) > count and "." not in row:
            found = [",".join(between_commas[:2])]
        if found:
            raise MotionError(
                f"{path.name} should have a decimal point in its numbers and has a decimal comma, as in {found[0]}; "
                "write them with a point, and a tab or a comma between columns",
                SolverCode.MALFORMED_TABLE,
            )


def _ensure_same_length(path: Path, rows: Sequence[str]) -> None:
    """Raise MotionError for the first row that has not as many columns as the row of names."""
    lengths = [len(row.split()) for row in rows]
    for number, length in enumerate(lengths):
        if length != lengths[0]:
            raise MotionError(
                f"{path.name} should have {counted(lengths[0], 'column')} in every row and has {length} "
                f"in frame {number}; "
                "the file may be cut",
                SolverCode.MALFORMED_TABLE,
            )


def _ensure_whole_end(path: Path, rows: Sequence[str]) -> None:
    """Raise MotionError for a last number, without a line's end, that has fewer decimals than all above it: it was cut
    to another number.
    """
    cells = [row.split()[-1] for row in rows[1:]]
    if not math.isfinite(float(cells[-1])):
        return
    *above, last = (len(cell.partition(".")[2]) for cell in cells if math.isfinite(float(cell)))
    if len(above) >= LEAST_ROWS_ALIKE and LEAST_DECIMALS <= min(above) == max(above) > last:
        sentence = f"{path.name} should end with {counted(above[0], 'decimal')} as in every row and ends with {last}"
        raise MotionError(f"{sentence}; the file is cut, export it again", SolverCode.MALFORMED_TABLE)


def _parse_header(lines: Sequence[str], path: Path) -> TableHeader:
    """As the lines state. A motion file of SIMM, as OpenSim 1 wrote it, has no version and is in degrees.

    Spreadsheets fill the lines of a header with tabs or commas, up to the number of columns.
    """
    fields = {}
    for line in lines:
        key, *value = line.strip(_FILLING).lower().replace("=", " ").split() or [""]
        fields[key] = " ".join(value)
    rows = fields.get("nrows", fields.get("datarows", ""))
    stated = fields.get("indegrees", "no")
    if stated not in ("yes", "y", "no", "n", ""):
        sentence = f"{path.name} should have inDegrees=yes or inDegrees=no in its header and has '{stated}'; correct it"
        raise MotionError(sentence, SolverCode.MALFORMED_TABLE)
    in_degrees = stated in ("yes", "y")
    if "indegrees" not in fields:
        in_degrees = "version" not in fields and (path.suffix == ".mot" or fields.get("angles") == "are in degrees.")
    return TableHeader(in_degrees, int(rows) if re.fullmatch("[0-9]{1,9}", rows) else None)
