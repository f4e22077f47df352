"""Measured reductions of muscle activity, to stand beside the model's: muscle,reduction_percent,sd."""

from __future__ import annotations

import csv
import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from documents.regular_file import LARGEST_TABLE, read_regular
from station.errors import StationError

COLUMNS = ("muscle", "reduction_percent", "sd")


class EmgError(StationError):
    """An EMG file that cannot be used; one sentence."""


@dataclass(frozen=True)
class MeasuredReduction:
    """By how much a muscle, or a group of muscles of the suit file, was measured to do less; standard deviation."""

    muscle: str
    reduction_percent: float
    sd_percent: float


def read_emg(path: Path, known: Collection[str]) -> list[MeasuredReduction]:
    """Read a table of measured reductions; known are the model's muscles and the suit's groups. Raises EmgError."""
    try:
        rows = list(
            csv.DictReader(read_regular(path, LARGEST_TABLE).decode("utf-8-sig").splitlines(), skipinitialspace=True)
        )
    except (OSError, UnicodeDecodeError) as error:
        raise EmgError(
            f"{path} should be a table of EMG in CSV and cannot be read ({error}); check the path"
        ) from error
    found = list(rows[0]) if rows else []
    if not set(COLUMNS) <= set(found):
        raise EmgError(f"{path.name} should have the columns {','.join(COLUMNS)} and has {','.join(found) or 'no row'}")
    return [_measured(path, line, row, known) for line, row in enumerate(rows, start=2)]


def _measured(path: Path, line: int, row: dict[str, str], known: Collection[str]) -> MeasuredReduction:
    if row["muscle"] not in known:
        raise EmgError(
            f"{path.name}, line {line}, names {row['muscle']}, which is no muscle of the model and no group of the "
            f"suit; known are {', '.join(known)}"
        )
    try:
        reduction, sd = float(row["reduction_percent"]), float(row["sd"])
    except (TypeError, ValueError):
        reduction = sd = math.nan
    if not math.isfinite(reduction) or not 0 <= sd < math.inf:
        raise EmgError(
            f"{path.name}, line {line}, should give numbers in percent and gives {row['reduction_percent']} and "
            f"{row['sd']}; correct it"
        )
    return MeasuredReduction(row["muscle"], reduction, sd)
