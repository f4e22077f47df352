"""Export the force of the rope on the cuff as an external force for OpenSim: vector, point and zero torque.

All components are in the mocap frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.trial.reader import read_trial
from recordings.manifest import DataOrigin
from solver.time_series_table import write_table
from station.files.pull import pull_on_cuff
from station.files.segments import LEAST_ROWS, Segments, fill_gaps, find_segments
from station.files.synchronised import ExportRefused, SynchronisedRecording
from station.messages.file_codes import ExportCode
from station.messages.message import Figures, Message
from station.whole_file import drafted

Array = NDArray[np.float64]

COLUMNS = tuple(f"{part}{axis}" for part in ("cuff_force_v", "cuff_force_p", "cuff_torque_") for axis in "xyz")


@dataclass(frozen=True)
class WrittenLoads:
    """The files, their gaps for the sidecar, and notes for the operator."""

    files: tuple[Path, ...]
    gaps: dict[str, Any]
    notes: tuple[Message[ExportCode], ...]


def write_loads(trial: SynchronisedRecording, stem: Path, suffix: str, *, fills_gaps: bool) -> WrittenLoads:
    """Write STEM_force.mot, one file per segment (STEM_force_1.mot, …) or, with fills_gaps, one interpolated file.

    Raises ExportRefused for a bounce or a trial of the wearer, and if the direction of the force is unknown throughout.
    """
    file = trial.path.name
    if trial.manifest.body is not None:
        raise ExportRefused(Message(ExportCode.NO_CUFF_FORCE, {"file": file, "test": trial.manifest.test}))
    if trial.manifest.cuff is None:
        raise ExportRefused(Message(ExportCode.BOUNCE, {"file": file}))
    try:
        direction, point = pull_on_cuff(read_trial(trial.path))
    except UnusableTrial as error:
        raise ExportRefused(Message(ExportCode.NO_DIRECTION, {"file": file, "reason": str(error)})) from error
    time, force = trial.line.force_time, trial.line.force
    table = np.column_stack((force, direction, point))
    segments = find_segments(time, table)
    if not segments.slices:
        raise ExportRefused(Message(ExportCode.CUFF_HIDDEN, {"file": file, "rows": LEAST_ROWS}))
    if fills_gaps:
        return _write_filled(trial, stem, suffix, table)
    return _write_segments(trial, stem, suffix, table, segments)


def _write_segments(
    trial: SynchronisedRecording, stem: Path, suffix: str, table: Array, segments: Segments
) -> WrittenLoads:
    time, count = trial.line.force_time, len(segments.slices)
    numbers = [""] if count == 1 else [f"_{i}" for i in range(1, count + 1)]
    files = tuple(
        _write(stem.with_name(f"{stem.name}_force{number}{suffix}"), time[part], table[part], trial.manifest.origin)
        for number, part in zip(numbers, segments.slices, strict=True)
    )
    described = [
        {"file": file.name, "from_s": time[part][0], "to_s": time[part][-1], "rows": part.stop - part.start}
        for file, part in zip(files, segments.slices, strict=True)
    ]
    left_out = {"marker_hidden": segments.unknown, "piece_too_short": segments.too_short}
    figures: Figures = {
        "file": trial.path.name,
        "left_out": sum(left_out.values()),
        "rows": len(time),
        "files": count,
    }
    note = Message(ExportCode.ROWS_LEFT_OUT, figures)
    is_whole = count == 1 and not any(left_out.values())
    return WrittenLoads(files, {"pieces": described, "rows_left_out": left_out}, () if is_whole else (note,))


def _write_filled(trial: SynchronisedRecording, stem: Path, suffix: str, table: Array) -> WrittenLoads:
    filled = fill_gaps(trial.line.force_time, table)
    path = stem.with_name(f"{stem.name}_force{suffix}")
    file = _write(path, filled.time, filled.values, trial.manifest.origin)
    gaps = {
        "filled": "linear interpolation between the known rows: direction, point and, for lost samples, force",
        "rows_filled": {"marker_hidden": filled.unknown, "samples_lost": filled.lost},
        "longest_gap_s": filled.longest,
    }
    figures: Figures = {
        "file": trial.path.name,
        "hidden": filled.unknown,
        "lost": filled.lost,
        "longest_s": filled.longest,
    }
    note = Message(ExportCode.ROWS_FILLED, figures)
    return WrittenLoads((file,), gaps, (note,) if filled.unknown or filled.lost else ())


def _write(path: Path, time: Array, table: Array, origin: DataOrigin) -> Path:
    """Write table (rows, 7): force [N], direction of any length, point [m]. origin: for the header."""
    direction = table[:, 1:4] / np.linalg.norm(table[:, 1:4], axis=1, keepdims=True)
    force = table[:, :1] * direction
    with drafted(path) as draft:
        values = np.column_stack((force, table[:, 4:], np.zeros_like(force)))
        write_table(draft, COLUMNS, time, values, {"data": origin})
    return path
