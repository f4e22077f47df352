"""The rope's pull on the cuff as OpenSim's external force: vector, point and no torque, in the mocap frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.quality import UnusableTrial
from fitting.trial import read_trial
from recordings.manifest import DataOrigin
from solver.motion import write_table
from station.files.one_clock import ExportRefused, OneClock
from station.files.pieces import LEAST_ROWS, Pieces, fill_gaps, find_pieces
from station.files.pull import pull_on_cuff
from station.whole_file import drafted

Array = NDArray[np.float64]

COLUMNS = tuple(f"{part}{axis}" for part in ("cuff_force_v", "cuff_force_p", "cuff_torque_") for axis in "xyz")


@dataclass(frozen=True)
class WrittenLoads:
    """The files, what the sidecar says of their gaps, and sentences for the operator where there are any."""

    files: tuple[Path, ...]
    gaps: dict[str, Any]
    notes: tuple[str, ...]


def write_loads(trial: OneClock, stem: Path, suffix: str, *, fills_gaps: bool) -> WrittenLoads:
    """STEM_force.mot, or where there are gaps STEM_force_1.mot, STEM_force_2.mot …; filled on request, one file.

    Raises ExportRefused for a bounce, or where the direction of the force is never known.
    """
    if trial.manifest.cuff is None:
        raise ExportRefused(f"{trial.path.name} is a bounce: it has no cuff on which its force would act")
    try:
        direction, point = pull_on_cuff(read_trial(trial.path))
    except UnusableTrial as error:
        raise ExportRefused(f"{trial.path.name} does not tell the direction of its force: {error}") from error
    time, force = trial.line.force_time, trial.line.force
    table = np.column_stack((force, direction, point))
    pieces = find_pieces(time, table)
    if not pieces.slices:
        raise ExportRefused(
            f"{trial.path.name} shows the cuff and its anchor together in no {LEAST_ROWS} samples of force in a row; "
            "see with `station info` how long each marker was hidden"
        )
    if fills_gaps:
        return _write_filled(trial, stem, suffix, table)
    return _write_pieces(trial, stem, suffix, table, pieces)


def _write_pieces(trial: OneClock, stem: Path, suffix: str, table: Array, pieces: Pieces) -> WrittenLoads:
    time, count = trial.line.force_time, len(pieces.slices)
    numbers = [""] if count == 1 else [f"_{i}" for i in range(1, count + 1)]
    files = tuple(
        _write(stem.with_name(f"{stem.name}_force{number}{suffix}"), time[part], table[part], trial.manifest.origin)
        for number, part in zip(numbers, pieces.slices, strict=True)
    )
    described = [
        {"file": file.name, "from_s": time[part][0], "to_s": time[part][-1], "rows": part.stop - part.start}
        for file, part in zip(files, pieces.slices, strict=True)
    ]
    left_out = {"marker_hidden": pieces.unknown, "piece_too_short": pieces.too_short}
    note = (
        f"{trial.path.name}: {sum(left_out.values())} of {len(time)} rows are left out because a marker of the cuff or "
        f"its anchor is hidden; the rest is in {count} gap-free files. --fill-gaps writes one file and fills the gaps"
    )
    is_whole = count == 1 and not any(left_out.values())
    return WrittenLoads(files, {"pieces": described, "rows_left_out": left_out}, () if is_whole else (note,))


def _write_filled(trial: OneClock, stem: Path, suffix: str, table: Array) -> WrittenLoads:
    filled = fill_gaps(trial.line.force_time, table)
    path = stem.with_name(f"{stem.name}_force{suffix}")
    file = _write(path, filled.time, filled.values, trial.manifest.origin)
    gaps = {
        "filled": "along straight lines between the known rows: direction, point and, where samples were lost, force",
        "rows_filled": {"marker_hidden": filled.unknown, "samples_lost": filled.lost},
        "longest_gap_s": filled.longest,
    }
    note = (
        f"{trial.path.name}: direction and point of {filled.unknown} rows are filled along straight lines, and "
        f"{filled.lost} rows of samples that were lost; the longest gap lasts {filled.longest:.3g} s"
    )
    return WrittenLoads((file,), gaps, (note,) if filled.unknown or filled.lost else ())


def _write(path: Path, time: Array, table: Array, origin: DataOrigin) -> Path:
    """table (rows, 7): force [N], direction, which need not have length 1, and point [m]; origin is for the header."""
    direction = table[:, 1:4] / np.linalg.norm(table[:, 1:4], axis=1, keepdims=True)
    force = table[:, :1] * direction
    with drafted(path) as draft:
        values = np.column_stack((force, table[:, 4:], np.zeros_like(force)))
        write_table(draft, COLUMNS, time, values, {"data": origin})
    return path
