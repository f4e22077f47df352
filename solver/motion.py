"""Motions: coordinates over time from .mot, .sto or .csv, smoothed and differentiated as the published study did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from documents.regular_file import LARGEST_TABLE, read_regular
from solver.errors import SolverCode, SolverError
from solver.model import Model

Array = NDArray[np.float64]
Derivatives = Literal["differences", "splines"]


class MotionError(SolverError):
    """A motion that cannot be used; one sentence."""

    general_code = SolverCode.MOTION


@dataclass(frozen=True)
class Motion:
    """Coordinates of a model over time, as they were recorded.

    names        of the coordinates, in the model's order
    time         (frames,) [s], evenly spaced
    coordinates  (frames, coordinates) [rad], translations [m]
    missing      names of the coordinates without data, which keep their default values
    """

    names: tuple[str, ...]
    time: Array
    coordinates: Array
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class Kinematics:
    """Time, coordinates, speeds and accelerations of a motion.

    time          (frames,) [s];  interval [s] between neighbours
    positions     q (frames, coordinates) [rad or m]
    speeds        u [rad/s or m/s];  accelerations [rad/s² or m/s²]
    cutoff        of the low-pass filter [Hz], None where none was used
    derivatives   by central differences (differentiate) or by splines (motion_splines.py), which use different filters

    The published convention is kept: u is dq/dt also for the scapula, whose speeds in the model are components of an
    angular velocity. Over a slow arm raise the two differ by up to 0.1 rad/s; published activations compare only so.
    """

    time: Array
    interval: float
    positions: Array
    speeds: Array
    accelerations: Array
    cutoff: float | None
    derivatives: Derivatives = "differences"

    def __repr__(self) -> str:
        frames, coordinates = self.positions.shape
        span = f"{self.time[0]:g} to {self.time[-1]:g} s" if frames else "no frames"
        return f"Kinematics: {frames} frames of {coordinates} coordinates, {span}; low-pass filter: {self.filter}"

    @property
    def filter(self) -> str:
        """As results state it."""
        if self.cutoff is None:
            return "none"
        order = {"differences": 4, "splines": 3}[self.derivatives]
        return f"Butterworth low-pass at {self.cutoff:g} Hz, order {order}, forwards and backwards"


def read_motion(path: Path, model: Model, *, with_defaults: bool = False) -> Motion:
    """Read the model's coordinates from an OpenSim .mot or .sto, or from a .csv in radians and metres.

    A column has the name of its coordinate, or the path of its value as OpenSim 4 writes it
    (/jointset/hip_r/hip_flexion_r/value).
    Angles are converted to radians if the header has inDegrees=yes. Columns without a coordinate are ignored. A
    coordinate without a column is refused; with_defaults it keeps its default value, as in OpenSim, unless all are
    missing. Raises MotionError, which names the file and the missing or malformed part.
    """
    names = model.coordinate_names
    columns, table, in_degrees = read_table(path)
    columns = [_coordinate_of(column) for column in columns]
    if "time" not in columns:
        sentence = f"{path.name} should have a column named time and has {', '.join(columns[:3])}, …; add it"
        raise MotionError(sentence, SolverCode.MISSING_COLUMN)
    missing = tuple(name for name in names if name not in columns)
    if len(missing) == len(names):
        raise MotionError(
            f"{path.name} has no coordinate of the model {model.name}, only columns such as {', '.join(columns[:4])}; "
            f"give a motion of this model, with columns such as {', '.join(names[:3])}, or the model of this motion",
            SolverCode.MISSING_COLUMN,
        )
    if missing and not with_defaults:
        raise MotionError(
            f"{path.name} should have a column for each of the model's {len(names)} coordinates and lacks "
            f"{', '.join(missing)}; add {'it' if len(missing) == 1 else 'them'} or use another model",
            SolverCode.MISSING_COLUMN,
        )
    time = table[:, columns.index("time")]
    _ensure_even_time(path, time)
    coordinates = np.tile(model.default_coordinates, (len(time), 1))
    for index, coordinate in enumerate(model.coordinates):
        if coordinate.name not in missing:
            is_angle = in_degrees and coordinate.motion == "rotation"
            coordinates[:, index] = table[:, columns.index(coordinate.name)] * (np.pi / 180 if is_angle else 1.0)
    return Motion(names=names, time=time, coordinates=coordinates, missing=missing)


def differentiate(
    motion: Motion, cutoff: float | None = 3.0, start: float | None = None, end: float | None = None
) -> Kinematics:
    """Smooth a motion, take speeds and accelerations by central differences, and keep the frames from start to end [s].

    The filter is the published one: Butterworth of order 4 at `cutoff` [Hz], forwards and backwards over the whole
    motion, both ends extended by odd reflection over 12 samples (MATLAB's filtfilt; SciPy alone would take 15).
    """
    interval = float(motion.time[-1] - motion.time[0]) / (len(motion.time) - 1)
    positions = motion.coordinates if cutoff is None else _smooth(motion.coordinates, cutoff, 1 / interval)
    speeds = np.gradient(positions, interval, axis=0)
    accelerations = np.gradient(speeds, interval, axis=0)
    kept = frames_between(motion.time, start, end)
    return Kinematics(motion.time[kept], interval, positions[kept], speeds[kept], accelerations[kept], cutoff)


def frames_between(time: Array, start: float | None, end: float | None) -> NDArray[np.bool_]:
    """(frames,) whether a frame lies between start and end [s], None for no limit. Raises MotionError if none does."""
    first, last = -np.inf if start is None else start, np.inf if end is None else end
    ensure_interval(first, last)
    tolerance = (time[-1] - time[0]) / (len(time) - 1) / 1e3
    kept: NDArray[np.bool_] = (time >= first - tolerance) & (time <= last + tolerance)
    if not kept.any():
        limits = [f"from {first:g} s"] * (start is not None) + [f"to {last:g} s"] * (end is not None)
        raise MotionError(
            f"the motion lasts from {time[0]:g} to {time[-1]:g} s and has no frame {' '.join(limits)}; choose other "
            "limits",
            SolverCode.NO_FRAMES,
        )
    return kept


def ensure_interval(start: float, end: float) -> None:
    """Raise MotionError unless start and end [s] are numbers, which may be infinite, in this order."""
    if np.isnan(start) or np.isnan(end):
        limit = "start" if np.isnan(start) else "end"
        sentence = f"the {limit} of the interval is not a number; give a time in seconds"
        raise MotionError(sentence, SolverCode.NO_FRAMES)
    if start > end:
        sentence = f"the start {start:g} s should be before the end {end:g} s; exchange them"
        raise MotionError(sentence, SolverCode.NO_FRAMES)


def decimate(kinematics: Kinematics, every: int) -> Kinematics:
    """Every N-th frame, the first included; the interval grows with it, speeds and accelerations stay."""
    return replace(
        kinematics,
        time=kinematics.time[::every],
        interval=kinematics.interval * every,
        positions=kinematics.positions[::every],
        speeds=kinematics.speeds[::every],
        accelerations=kinematics.accelerations[::every],
    )


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
    lines += [separator.join(f"{value:.10g}" for value in row) for row in np.column_stack([time, values])]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_table(path: Path) -> tuple[list[str], Array, bool]:
    """Names of the columns, their values (frames, columns), and whether angles are in degrees.

    Of a .mot or .sto with OpenSim's header, or a .csv, where lines that begin with # are skipped. Raises MotionError.
    """
    try:
        lines = read_regular(path, LARGEST_TABLE).decode("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        sentence = f"{path} should be a motion file and cannot be read ({error}); check the path"
        raise MotionError(sentence, SolverCode.UNREADABLE_TABLE) from error
    in_degrees, first = False, 0
    if path.suffix != ".csv":
        ends = [i for i, line in enumerate(lines) if line.strip() == "endheader"]
        if not ends:
            sentence = f"{path.name} should have a line 'endheader' above its table and has none; check it"
            raise MotionError(sentence, SolverCode.MALFORMED_TABLE)
        first = ends[0] + 1
        header = {line.replace(" ", "").lower() for line in lines[:first]}
        in_degrees = "indegrees=yes" in header or (path.suffix == ".mot" and _is_of_simm(header))
    rows = [line.replace(",", " ").split() for line in lines[first:] if line.strip() and line[0] != "#"]
    if len(rows) < 3:
        sentence = f"{path.name} should have a row of names and at least two frames and has {len(rows)} rows"
        raise MotionError(sentence, SolverCode.NO_FRAMES)
    for number, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise MotionError(
                f"{path.name} should have {len(rows[0])} columns in every row and has {len(row)} in frame {number}; "
                "the file may be cut",
                SolverCode.MALFORMED_TABLE,
            )
    try:
        table = np.array(rows[1:], dtype=np.float64)
    except ValueError as error:
        sentence = f"{path.name} should hold numbers below its names ({error}); check the file"
        raise MotionError(sentence, SolverCode.MALFORMED_TABLE) from error
    if not np.isfinite(table).all():
        frame = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        sentence = f"{path.name} should hold finite numbers and frame {frame} does not; fill or cut the gap"
        raise MotionError(sentence, SolverCode.NOT_FINITE)
    return rows[0], table, in_degrees


def _is_of_simm(header: set[str]) -> bool:
    """Whether it is that of a motion file of SIMM, as OpenSim 1 wrote it: without a version and in degrees."""
    return not any(line.startswith(("version=", "indegrees=")) for line in header)


def _coordinate_of(column: str) -> str:
    """Name of the coordinate of a column: OpenSim 4 writes /jointset/JOINT/COORDINATE/value into tables of states."""
    parts = column.split("/")
    return parts[-2] if len(parts) > 2 and parts[-1] == "value" else column


def _ensure_even_time(path: Path, time: Array) -> None:
    """Steps within 1 % of each other, or times that were even before they were printed with few decimals."""
    steps = np.diff(time)
    step = float(np.median(steps))
    if step <= 0 or (np.abs(steps - step).max() > 0.01 * step and not _is_rounded_grid(time)):
        raise MotionError(
            f"{path.name} should be evenly sampled and has steps of {steps.min():g} to {steps.max():g} s; resample it",
            SolverCode.UNEVEN_TIME,
        )


def _is_rounded_grid(time: Array) -> bool:
    """Whether times are those of an even grid, rounded to a decimal that is at most a tenth of a step: 60 Hz in ms."""
    decimal = next((10.0**-digits for digits in range(10) if np.allclose(time, time.round(digits), 0, 1e-12)), 0.0)
    grid = np.linspace(time[0], time[-1], len(time))
    return decimal <= 0.1 * (grid[1] - grid[0]) and float(np.abs(time - grid).max()) <= 1.001 * decimal


def _smooth(coordinates: Array, cutoff: float, rate: float) -> Array:
    from scipy import signal  # half a second to import, which solving alone does not need

    padding = 12
    if len(coordinates) <= padding:
        sentence = f"the filter needs more than {padding} frames and the motion has {len(coordinates)}; turn it off"
        raise MotionError(sentence, SolverCode.NO_FRAMES)
    if not 0 < cutoff < rate / 2:
        raise MotionError(
            f"the cutoff should lie between 0 and {rate / 2:g} Hz, half the motion's rate, and is {cutoff:g} Hz",
            SolverCode.WRONG_CUTOFF,
        )
    b, a = signal.butter(4, cutoff / (rate / 2))
    smooth: Array = signal.filtfilt(b, a, coordinates, axis=0, padtype="odd", padlen=padding)
    return smooth
