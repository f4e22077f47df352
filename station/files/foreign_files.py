"""Read force with its unit, and markers under the labels of the configuration, from files of other programs.

The suffix of the file gives the format. Column and unit of the force are those of the command line, or else those that
the file declares.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures, Message
from recordings.exchange.c3d import read_c3d_markers, read_c3d_signals
from recordings.exchange.qtm_tsv import read_qtm_tsv
from recordings.exchange.sample_tables import MarkerTable, SignalTable, require_labels
from recordings.exchange.signal_csv import read_signals
from recordings.exchange.trc import read_trc
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.messages.file_messages import ImportCode

ForceUnit = Literal["V", "N", "lbs"]
UNITS: tuple[ForceUnit, ...] = ("V", "N", "lbs")
SPELLINGS: Mapping[str, ForceUnit] = {
    "v": "V",
    "volt": "V",
    "volts": "V",
    "n": "N",
    "newton": "N",
    "newtons": "N",
    "lbs": "lbs",
    "lb": "lbs",
    "lbf": "lbs",
}
_UNIT = rf"{'|'.join(SPELLINGS)}|(?:[kmcd]|da)n|[mk]v|mv/v|k?gf?|kp|oz"
NAMED_UNIT = re.compile(rf"[(\[{{]\s*({_UNIT})\s*[)\]}}]|(?:^|[_ /:-])\s*({_UNIT})\s*$", re.IGNORECASE)
"""In brackets in a column's title, or at its end after a blank, an underscore or one of / : -, or alone; also refused
units. A quantity divided by its unit (F/kN) is ISO 80000-1's form for the title of a column.
"""
SLOWEST_FORCE_HZ, FASTEST_FORCE_HZ = 5.0, 100_000.0
SLOWEST_FRAMES_HZ, FASTEST_FRAMES_HZ = 5.0, 2_000.0
NARROWEST_MM, WIDEST_MM, CLOSEST_MM = 20.0, 20_000.0, 10.0
"""Plausible sizes of a set of markers on a body and on the rope, and distance of two markers that cameras distinguish:
another unit than that of the title is outside of this range. A unit that the operator gives is believed.
"""
LARGEST_FORCE, FARTHEST_MM = 1e6, 1e6
"""Beyond any load cell, in V, N or lbs, and any laboratory: the mark of a missing value, or damage."""


class ImportRefused(StationError):
    """The files cannot be imported."""


class WrongImport(ImportRefused):
    """The command line is wrong."""

    exit_code = WRONG_USAGE


@dataclass(frozen=True)
class ForceSource:
    """A file with the force: a CSV of a DAQ, or a C3D with an analog channel.

    column None: the column force_v, force_n or force_lbs; unit None: the unit in the name of the column or in the C3D.
    """

    path: Path
    column: str | None = None
    unit: ForceUnit | None = None
    time_column: str = "time_s"
    sync_column: str = "sync_v"


@dataclass(frozen=True)
class MarkerSource:
    """A file with the markers: TSV of QTM, TRC or C3D.

    unit None: the unit that the file declares, mm for TSV; names: label in the file → label in the configuration.
    """

    path: Path
    unit: str | None = None
    names: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Force:
    """Force at time (n,) [s] on the clock of the file: values (n,) in the unit, sync (n,) [V] or None.

    others: names of the other signals in the file
    """

    time: NDArray[np.float64]
    values: NDArray[np.float64]
    unit: ForceUnit
    column: str
    sync: NDArray[np.float64] | None
    others: tuple[str, ...] = ()


def parse_names(pairs: Sequence[str]) -> dict[str, str]:
    """Parse ["theirs=ours", …] to {theirs: ours}. Raises WrongImport."""
    for pair in pairs:
        if not all(side.strip() for side in (*pair.split("=", 1), "")[:2]):
            raise WrongImport(Message(ImportCode.WRONG_LABEL_PAIR, {"pair": repr(pair)}))
    return {theirs.strip(): ours.strip() for theirs, ours in (pair.split("=", 1) for pair in pairs)}


def read_force(source: ForceSource, *, has_own_clock: bool = True) -> Force:
    """Read the force, and the sync line if the file has its own clock.

    Raises ForeignFile, ImportRefused or WrongImport.
    """
    candidates = [source.column] if source.column else [f"force_{unit.lower()}" for unit in UNITS]
    wanted = [*candidates, source.sync_column]
    match source.path.suffix.lower():
        case ".c3d":
            table = read_c3d_signals(source.path, wanted)
        case ".csv" | ".tsv" | ".txt":
            table = read_signals(source.path, source.time_column, wanted)
        case suffix:
            raise WrongImport(_wrong_format(ImportCode.FORCE_FORMAT, source.path, suffix))
    column = _column(source, table, candidates)
    _require_rate(table.time_s, SLOWEST_FORCE_HZ, FASTEST_FORCE_HZ, f"times in {source.path}, {source.time_column},")
    _require_possible(table.time_s, table.signals[column], LARGEST_FORCE, f"{source.path}, {column},")
    sync = table.signals.get(source.sync_column) if has_own_clock else None
    others = tuple(name for name in table.names if name not in (source.time_column, column, source.sync_column))
    return Force(table.time_s, table.signals[column], _unit(source, table, column), column, sync, others)


def read_markers(source: MarkerSource, needed: Sequence[str]) -> MarkerTable:
    """Read the markers and rename them. Raises ForeignFile, ImportRefused (a needed one is missing) or WrongImport."""
    match source.path.suffix.lower():
        case ".c3d":
            table = read_c3d_markers(source.path, source.unit or "")
        case ".trc":
            renamed = [theirs for theirs, ours in source.names.items() if ours in needed]
            table = read_trc(source.path, source.unit or "", [*needed, *renamed])
        case ".tsv" | ".txt":
            table = read_qtm_tsv(source.path, source.unit or "mm")
        case suffix:
            raise WrongImport(_wrong_format(ImportCode.MARKER_FORMAT, source.path, suffix))
    table = _renamed(table, source)
    absent = [label for label in needed if label not in table.labels]
    if absent:
        raise ImportRefused(_missing(ImportCode.MARKERS_MISSING, source.path, absent, table.labels))
    _require_rate(table.time_s, SLOWEST_FRAMES_HZ, FASTEST_FRAMES_HZ, f"times in {source.path}")
    _require_size(table, needed, source)
    for i, label in enumerate(table.labels):
        _require_possible(table.time_s, table.positions[:, i], FARTHEST_MM, f"{source.path}, {label} [mm],")
    return table


def _wrong_format(code: ImportCode, path: Path, suffix: str) -> Message[ImportCode]:
    return Message(code, {"path": str(path), "suffix": suffix or "no suffix"})


def _missing(code: ImportCode, path: Path, missing: Sequence[str], known: Sequence[str]) -> Message[ImportCode]:
    return Message(code, {"path": str(path), "missing": ", ".join(missing), "known": ", ".join(known)})


def _column(source: ForceSource, table: SignalTable, candidates: Sequence[str]) -> str:
    found = [name for name in candidates if name in table.signals]
    if source.unit and not source.column:
        found = [name for name in found if name == f"force_{source.unit.lower()}"] or found
    if len(found) == 1:
        return found[0]
    figures = {
        "path": str(source.path),
        "found": " and ".join(found),
        "expected": " or ".join(candidates),
        "known": ", ".join(table.names),
    }
    code = ImportCode.SEVERAL_FORCE_COLUMNS if found else ImportCode.NO_FORCE_COLUMN
    raise ImportRefused(Message(code, figures))


def _unit(source: ForceSource, table: SignalTable, column: str) -> ForceUnit:
    """The unit of the command line, of the file, or in the name of the column; otherwise volts, as written by a DAQ.

    Raises WrongImport for another unit, and for a name with two different ones.
    """
    if source.unit:
        return source.unit
    of_file = table.units[column].strip()
    declared = [of_file] if of_file else ["".join(found) for found in NAMED_UNIT.findall(column)]
    units = {SPELLINGS.get(unit.lower()) for unit in declared}
    if len(units) > 1 or None in units:
        named = " and ".join(map(repr, dict.fromkeys(declared)))
        figures = {"path": str(source.path), "column": column, "unit": named, "known": ", ".join(UNITS)}
        raise WrongImport(Message(ImportCode.FORCE_UNIT, figures))
    return SPELLINGS[declared[0].lower()] if declared else "V"


def _renamed(table: MarkerTable, source: MarkerSource) -> MarkerTable:
    unknown = [theirs for theirs in source.names if theirs not in table.labels]
    if unknown:
        raise WrongImport(_missing(ImportCode.UNKNOWN_LABEL, source.path, unknown, table.labels))
    labels = tuple(source.names.get(label, label) for label in table.labels)
    require_labels(labels, f"{source.path}, renamed by --label,")
    return replace(table, labels=labels)


def _require_rate(time: NDArray[np.float64], lowest: float, highest: float, times: str) -> None:
    rate = 1 / float(np.median(np.diff(time)))
    if not lowest <= rate <= highest:
        figures: Figures = {"times": times, "rate_hz": rate, "lowest_hz": lowest, "highest_hz": highest}
        raise ImportRefused(Message(ImportCode.SAMPLE_RATE, figures))


def _require_possible(time: NDArray[np.float64], values: NDArray[np.float64], most: float, what: str) -> None:
    """Raise ImportRefused at the first of the times (n,) at which a value (n, …) is beyond `most`."""
    beyond = np.argwhere(np.abs(values) > most)
    if len(beyond):
        place = tuple(beyond[0])
        figures: Figures = {"what": what, "value": float(values[place]), "time_s": float(time[place[0]]), "most": most}
        raise ImportRefused(Message(ImportCode.IMPOSSIBLE_VALUE, figures))


def _require_size(table: MarkerTable, needed: Sequence[str], source: MarkerSource) -> None:
    """Raise ImportRefused for distances of the needed markers too short for a body, or too long for a laboratory.

    All visible markers count if fewer than two are needed, as in a bounce.
    """
    visible = {
        label: np.median(table.positions[~missing, i], axis=0)
        for i, (label, missing) in enumerate(zip(table.labels, table.missing.T, strict=True))
        if not missing.all()
    }
    if not visible:
        raise ImportRefused(Message(ImportCode.NOTHING_VISIBLE, {"path": str(source.path)}))
    if len(set(needed)) > 1:
        visible = {label: place for label, place in visible.items() if label in needed}
    if len(visible) < 2:
        return
    pairs = {pair: float(np.linalg.norm(visible[pair[0]] - visible[pair[1]])) for pair in combinations(visible, 2)}
    size, least = max(pairs.values()), NARROWEST_MM
    (one, other), closest = min(pairs.items(), key=lambda pair: pair[1])
    if source.unit is not None:
        least = closest = CLOSEST_MM
    figures: Figures = {"path": str(source.path), "size_mm": size, "least_mm": least, "most_mm": WIDEST_MM}
    if not least <= size <= WIDEST_MM:
        raise ImportRefused(Message(ImportCode.MARKER_DISTANCE, figures))
    if closest < CLOSEST_MM:
        figures = {**figures, "one": one, "other": other, "distance_mm": closest, "least_mm": CLOSEST_MM}
        raise ImportRefused(Message(ImportCode.MARKERS_CLOSE, figures))
