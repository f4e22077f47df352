"""Files of other programs → force with its unit, markers under our labels; or a sentence why not.

The suffix tells the format. Which column is the force, and in which unit, is what the operator says, or else what the
file declares.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from recordings.exchange.c3d import read_c3d_markers, read_c3d_signals
from recordings.exchange.qtm_tsv import read_qtm_tsv
from recordings.exchange.signal_csv import read_signals
from recordings.exchange.tables import MarkerTable, SignalTable, require_labels
from recordings.exchange.trc import read_trc
from station.errors import StationError
from station.exit_code import WRONG_USAGE

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
SLOWEST_FORCE_HZ, FASTEST_FORCE_HZ = 5.0, 100_000.0
SLOWEST_FRAMES_HZ, FASTEST_FRAMES_HZ = 5.0, 20_000.0
NARROWEST_MM, WIDEST_MM = 10.0, 20_000.0
"""Markers on a body and on what pulls it are this far apart; in another unit they would not be."""


class ImportRefused(StationError):
    """What was asked for cannot be done with these files; one sentence."""


class WrongImport(ImportRefused):
    """The command itself is at fault."""

    exit_code = WRONG_USAGE


@dataclass(frozen=True)
class ForceSource:
    """A file with the force: a DAQ's CSV, or a C3D with it as an analog channel.

    column None: the one named force_v, force_n or force_lbs; unit None: what the file says, by that name or in C3D.
    """

    path: Path
    column: str | None = None
    unit: ForceUnit | None = None
    time_column: str = "time_s"
    sync_column: str = "sync_v"


@dataclass(frozen=True)
class MarkerSource:
    """A file with the markers: QTM's TSV, TRC or C3D.

    unit None: what the file says, mm for TSV; names maps labels of the file to ours.
    """

    path: Path
    unit: str | None = None
    names: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Force:
    """time (n,) s on the file's clock, values (n,) in the unit, sync (n,) V or None."""

    time: NDArray[np.float64]
    values: NDArray[np.float64]
    unit: ForceUnit
    column: str
    sync: NDArray[np.float64] | None


def parse_names(pairs: Sequence[str]) -> dict[str, str]:
    """["theirs=ours", …] → {theirs: ours}. Raises WrongImport."""
    for pair in pairs:
        if not all(side.strip() for side in (*pair.split("=", 1), "")[:2]):
            raise WrongImport(f"--label {pair!r} names no two labels, expected THEIRS=OURS")
    return {theirs.strip(): ours.strip() for theirs, ours in (pair.split("=", 1) for pair in pairs)}


def read_force(source: ForceSource, *, has_own_clock: bool = True) -> Force:
    """The force and, where its clock is not the markers' own, the sync line beside it.

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
            raise WrongImport(
                f"{source.path} ends in {suffix or 'nothing'}, expected force in .csv, .txt, .tsv or .c3d"
            )
    column = _column(source, table, candidates)
    _require_rate(table.time_s, SLOWEST_FORCE_HZ, FASTEST_FORCE_HZ, f"{source.path}, {source.time_column},")
    sync = table.signals.get(source.sync_column) if has_own_clock else None
    return Force(table.time_s, table.signals[column], _unit(source, table, column), column, sync)


def read_markers(source: MarkerSource, needed: Sequence[str]) -> MarkerTable:
    """Markers under our labels. Raises ForeignFile, ImportRefused (a needed one is not there) or WrongImport."""
    match source.path.suffix.lower():
        case ".c3d":
            table = read_c3d_markers(source.path, source.unit or "")
        case ".trc":
            renamed = [theirs for theirs, ours in source.names.items() if ours in needed]
            table = read_trc(source.path, source.unit or "", [*needed, *renamed])
        case ".tsv" | ".txt":
            table = read_qtm_tsv(source.path, source.unit or "mm")
        case suffix:
            raise WrongImport(f"{source.path} ends in {suffix or 'nothing'}, expected markers in .tsv, .trc or .c3d")
    table = _renamed(table, source)
    absent = [label for label in needed if label not in table.labels]
    if absent:
        raise ImportRefused(
            f"{source.path} has no marker {', '.join(absent)}, only {', '.join(table.labels)}; correct the "
            "cuff's labels in the configuration, or say --label THEIRS=OURS"
        )
    _require_rate(table.time_s, SLOWEST_FRAMES_HZ, FASTEST_FRAMES_HZ, f"{source.path}, times,")
    _require_size(table, source.path)
    return table


def _column(source: ForceSource, table: SignalTable, candidates: Sequence[str]) -> str:
    found = [name for name in candidates if name in table.signals]
    if source.unit and not source.column:
        found = [name for name in found if name == f"force_{source.unit.lower()}"] or found
    if len(found) == 1:
        return found[0]
    what = f"no column {' or '.join(candidates)}" if not found else f"columns {' and '.join(found)}"
    raise ImportRefused(f"{source.path} has {what} among {', '.join(table.names)}; say which with --force-column")


def _unit(source: ForceSource, table: SignalTable, column: str) -> ForceUnit:
    """What was said, what the file declares, what the column's name ends in; else volts, as a DAQ writes."""
    if source.unit:
        return source.unit
    declared = table.units[column].strip()
    if declared and declared.lower() not in SPELLINGS:
        raise WrongImport(
            f"{source.path} declares {column} in {declared!r}, expected {', '.join(UNITS)}; give --force-unit"
        )
    return SPELLINGS.get((declared or column.rpartition("_")[2]).lower(), "V")


def _renamed(table: MarkerTable, source: MarkerSource) -> MarkerTable:
    unknown = [theirs for theirs in source.names if theirs not in table.labels]
    if unknown:
        raise WrongImport(f"{source.path} has no marker {', '.join(unknown)} to rename, only {', '.join(table.labels)}")
    labels = tuple(source.names.get(label, label) for label in table.labels)
    require_labels(labels, f"{source.path}, renamed by --label,")
    return replace(table, labels=labels)


def _require_rate(time: NDArray[np.float64], slowest: float, fastest: float, where: str) -> None:
    rate = 1 / float(np.median(np.diff(time)))
    if not slowest <= rate <= fastest:
        raise ImportRefused(
            f"{where} tell {rate:.3g} samples a second, expected {slowest:g} to {fastest:g}; are they in seconds?"
        )


def _require_size(table: MarkerTable, path: Path) -> None:
    """Raises ImportRefused where the markers are closer together than on a body, or farther apart than in a hall."""
    seen = [table.positions[~missing, i] for i, missing in enumerate(table.missing.T) if not missing.all()]
    if not seen:
        raise ImportRefused(f"{path} shows no marker in any frame; export the trajectories that QTM has identified")
    size = float(np.max(np.ptp([np.median(positions, axis=0) for positions in seen], axis=0)))
    if len(seen) > 1 and not NARROWEST_MM <= size <= WIDEST_MM:
        raise ImportRefused(
            f"{path} has its markers within {size:.4g} mm of each other, expected {NARROWEST_MM:g} to {WIDEST_MM:g}; "
            "give its unit with --mocap-unit"
        )
