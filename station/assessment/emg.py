"""Measured reductions of muscle activity, for comparison with the model: muscle,reduction_percent,sd."""

from __future__ import annotations

import csv
import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from documents.regular_file import LARGEST_TABLE, describe_failure, read_regular
from station.errors import StationError
from station.messages.codes import InputCode
from station.messages.message import Figures, Message

COLUMNS = ("muscle", "reduction_percent", "sd")


class EmgError(StationError):
    """An EMG file that cannot be used."""


@dataclass(frozen=True)
class MeasuredReduction:
    """Measured reduction of the activity of a muscle, or of a group of the suit file, with its standard deviation."""

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
            Message(InputCode.EMG_UNREADABLE, {"path": str(path), "reason": describe_failure(error)})
        ) from error
    found = list(rows[0]) if rows else []
    if not set(COLUMNS) <= set(found):
        figures = {"path": path.name, "found": ",".join(found) or "none", "expected": ",".join(COLUMNS)}
        raise EmgError(Message(InputCode.EMG_COLUMNS, figures))
    return [_measured(path, line, row, known) for line, row in enumerate(rows, start=2)]


def _measured(path: Path, line: int, row: dict[str, str], known: Collection[str]) -> MeasuredReduction:
    if row["muscle"] not in known:
        figures: Figures = {"path": path.name, "line": line, "muscle": row["muscle"], "known": ", ".join(known)}
        raise EmgError(Message(InputCode.EMG_MUSCLE, figures))
    try:
        reduction, sd = float(row["reduction_percent"]), float(row["sd"])
    except (TypeError, ValueError):
        reduction = sd = math.nan
    if not math.isfinite(reduction) or not 0 <= sd < math.inf:
        given = {"reduction": str(row["reduction_percent"]), "sd": str(row["sd"])}
        raise EmgError(Message(InputCode.EMG_NUMBER, {"path": path.name, "line": line, **given}))
    return MeasuredReduction(row["muscle"], reduction, sd)
