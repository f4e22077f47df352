"""Export the force of the rope on the cuff as an external force for OpenSim: vector, point and zero torque.

All components are in the mocap frame.

A table over time is divided into segments without gaps: OpenSim's Storage stops reading at the first number that is not
finite.

A gap is where values are unknown, or where samples were lost and the times jump. OpenSim interpolates a spline across a
gap and extrapolates beyond the last row; its files cannot mark either.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures, Message, because
from fitting.errors import UnusableTrial
from fitting.pull.cuff_motion import cuff_motion, pull_direction, reference_posture
from fitting.pull.pose import fit_pose
from fitting.trial.trial import Trial, read_trial
from recordings.manifest import DataOrigin
from solver.time_series_table import write_table
from station.checksums import drafted
from station.files.synchronised import ExportRefused, SynchronisedRecording
from station.messages.file_messages import ExportCode

Array = NDArray[np.float64]

COLUMNS = tuple(f"{part}{axis}" for part in ("cuff_force_v", "cuff_force_p", "cuff_torque_") for axis in "xyz")
LEAST_ROWS = 4  # of a segment: a cubic spline needs four points
JUMP = 1.5  # time steps between two rows from which on a sample is lost


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
        raise ExportRefused(Message(ExportCode.NO_DIRECTION, {"file": file, **because(error)})) from error
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
    figures: Figures = {"file": trial.path.name, "left_out": sum(left_out.values()), "rows": len(time), "files": count}
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


@dataclass(frozen=True, eq=False)
class Segments:
    """The known part of a table.

    slices     (start, end) of every segment's rows
    unknown    number of rows with a value that is not finite
    too_short  number of rows between two gaps with fewer than LEAST_ROWS between them
    """

    slices: tuple[slice, ...]
    unknown: int
    too_short: int


def find_segments(time: Array, values: Array) -> Segments:
    """Find the gap-free segments of values (rows, columns) at even times (rows,) with gaps."""
    is_known: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(values), axis=1)
    changes = np.diff(is_known) | _jumps(time)
    starts = np.concatenate([[0], np.flatnonzero(changes) + 1]).tolist()
    runs = [slice(start, end) for start, end in zip(starts, [*starts[1:], len(time)], strict=True) if is_known[start]]
    kept = tuple(run for run in runs if run.stop - run.start >= LEAST_ROWS)
    known = int(is_known.sum())
    return Segments(kept, len(time) - known, known - sum(run.stop - run.start for run in kept))


@dataclass(frozen=True, eq=False)
class Filled:
    """A table whose gaps are interpolated linearly.

    time, values        (rows,) and (rows, columns), from the first known row to the last
    unknown, lost       number of rows that had an unknown value, and of rows added for lost samples
    longest             longest time between two known rows [s]
    """

    time: Array
    values: Array
    unknown: int
    lost: int
    longest: float


def fill_gaps(time: Array, values: Array) -> Filled:
    """Interpolate every column separately between its known rows; rows before the first or after the last are cut."""
    whole = np.flatnonzero(np.isfinite(values).all(axis=1))
    inner = slice(whole[0], whole[-1] + 1)
    time, values, known_time = time[inner], values[inner], time[whole]
    step = float(np.median(np.diff(time)))
    parts = [time]
    for i in np.flatnonzero(_jumps(time)).tolist():
        count = round((time[i + 1] - time[i]) / step)
        parts.append(np.linspace(time[i], time[i + 1], count + 1)[1:-1])
    dense = np.sort(np.concatenate(parts))
    is_known = np.isfinite(values)
    columns = [np.interp(dense, time[ok], column[ok]) for column, ok in zip(values.T, is_known.T, strict=True)]
    return Filled(
        time=dense,
        values=np.column_stack(columns),
        unknown=int((~is_known.all(axis=1)).sum()),
        lost=len(dense) - len(time),
        longest=float(np.diff(known_time).max()),
    )


def _jumps(time: Array) -> NDArray[np.bool_]:
    steps = np.diff(time)
    is_jump: NDArray[np.bool_] = steps > JUMP * np.median(steps)
    return is_jump


def pull_on_cuff(trial: Trial) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Direction (n, 3) of the force on the cuff, and the centroid of its markers (n, 3) [m], at the force times.

    The direction is that of the rope if it has markers, otherwise the direction of the cuff displacement, fixed in the
    frame of the anchor; NaN while the markers are hidden. Raises UnusableTrial if the anchor does not define a frame.
    """
    reference = reference_posture(trial)
    motion = cuff_motion(trial, reference)
    along = np.broadcast_to(pull_direction([trial], [motion]), motion.displacement.shape)
    if motion.rope is not None:
        along = motion.rope * np.sign(np.nansum(motion.rope, axis=0) @ along[0])
    rotation = fit_pose(reference.anchor, trial.positions(trial.cuff.anchor_markers)).rotation
    direction = _at(trial.force_time, trial.marker_time, np.einsum("fij,fj->fi", rotation, along))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    cuff = trial.positions(trial.cuff.cuff_markers)
    seen = np.isfinite(cuff[..., 0])
    count = np.where(seen.any(axis=1), seen.sum(axis=1), np.nan)
    middle = np.where(seen[..., None], cuff, 0.0).sum(axis=1) / count[:, None]
    return direction, _at(trial.force_time, trial.marker_time, middle)


def _at(time: NDArray[np.float64], frames: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate vectors (frames, 3) linearly; NaN next to a frame without a vector."""
    return np.column_stack([np.interp(time, frames, component) for component in vectors.T])
