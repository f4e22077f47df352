"""Motions: coordinates over time from .mot, .sto or .csv, smoothed and differentiated as the published study did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from documents.regular_file import LARGEST_TABLE, read_regular
from solver.coded_finding import CodedFinding, describe_codes
from solver.errors import SolverCode, SolverError
from solver.model import Model
from solver.option_values import ensure_at_least
from solver.time_grid import even_grid, interpolated, is_even

Array = NDArray[np.float64]
Derivatives = Literal["differences", "splines"]
LARGEST_COORDINATE = 1e6
"""[rad or m] Beyond any motion, also one in degrees or millimetres; a filter would spread it over all frames."""
_FILLING = " \t,;"


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
    steps        shortest and longest step of the recorded times [s], if they were uneven; None if they were even
    largest_degrees  largest angle [°] of a file in degrees; None of one in radians
    """

    names: tuple[str, ...]
    time: Array
    coordinates: Array
    missing: tuple[str, ...] = ()
    steps: tuple[float, float] | None = None
    largest_degrees: float | None = None


@dataclass(frozen=True, repr=False)
class Kinematics:
    """Time, coordinates, speeds and accelerations of a motion.

    time          (frames,) [s];  interval [s] between neighbours
    positions     q (frames, coordinates) [rad or m]
    speeds        u [rad/s or m/s];  accelerations [rad/s² or m/s²]
    cutoff        of the low-pass filter [Hz], None where none was used
    derivatives   by central differences (differentiate) or by splines (motion_splines.py), which use different filters
    steps, missing, largest_degrees  of the recorded motion, as in Motion
    findings      of cuffstation.load_motion: what is unusual in the motion

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
    steps: tuple[float, float] | None = None
    missing: tuple[str, ...] = ()
    largest_degrees: float | None = None
    findings: tuple[CodedFinding, ...] = ()

    def __post_init__(self) -> None:
        """Raise MotionError without a frame: there is nothing to check, to solve or to average."""
        if not len(self.time):
            sentence = "a motion should have at least one frame and has none; choose other frames"
            raise MotionError(sentence, SolverCode.NO_FRAMES)

    def cut(self, frames: slice) -> Kinematics:
        """These frames alone, without a step between them. Raises MotionError if there are none."""
        return replace(
            self,
            time=self.time[frames],
            positions=self.positions[frames],
            speeds=self.speeds[frames],
            accelerations=self.accelerations[frames],
        )

    def __repr__(self) -> str:
        frames, coordinates = self.positions.shape
        span = f"{self.time[0]:g} to {self.time[-1]:g} s"
        described = f"Kinematics: {frames} frames of {coordinates} coordinates, {span}; low-pass filter: {self.filter}"
        if self.steps is not None:
            described += f"; interpolated from steps of {self.steps[0]:.6g} to {self.steps[1]:.6g} s"
        if self.missing:
            described += f"; without data: {', '.join(self.missing)}"
        return described + describe_codes(self.findings)

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
    missing. A motion with uneven steps, as OpenSim's RRA and CMC write it, is interpolated to an even grid; one with a
    gap is refused. Raises MotionError, which names the file and the missing or malformed part.
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
    doubled = [name for name in ("time", *names) if columns.count(name) > 1]
    if doubled:
        sentence = f"{path.name} should have one column for each coordinate and has several for {', '.join(doubled)}"
        raise MotionError(f"{sentence}; keep one of them", SolverCode.MALFORMED_TABLE)
    time = table[:, columns.index("time")]
    coordinates = np.tile(model.default_coordinates, (len(time), 1))
    largest_degrees = 0.0 if in_degrees else None
    for index, coordinate in enumerate(model.coordinates):
        if coordinate.name not in missing:
            values = table[:, columns.index(coordinate.name)]
            if largest_degrees is not None and coordinate.motion == "rotation":
                largest_degrees = max(largest_degrees, float(np.abs(values).max()))
                values = np.radians(values)
            coordinates[:, index] = values
    _ensure_possible(path, model, coordinates)
    if is_even(time):
        return Motion(names, time, coordinates, missing, largest_degrees=largest_degrees)
    steps, grid = np.diff(time), even_grid(time)
    if steps.min() <= 0:
        later = float(time[int(np.flatnonzero(steps <= 0)[0]) + 1])
        sentence = f"{path.name} should have times that increase and has {later:g} s after a time as late or later"
        raise MotionError(f"{sentence}; sort the frames, or leave out repeated ones", SolverCode.UNEVEN_TIME)
    if grid is None:
        raise MotionError(
            f"{path.name} should be evenly sampled and has steps of {steps.min():g} to {steps.max():g} s; fill the gap",
            SolverCode.UNEVEN_TIME,
        )
    limits = (float(steps.min()), float(steps.max()))
    return Motion(names, grid, interpolated(time, coordinates, grid), missing, limits, largest_degrees)


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
    moved = (positions[kept], speeds[kept], accelerations[kept])
    recorded = (motion.steps, motion.missing, motion.largest_degrees)
    return Kinematics(motion.time[kept], interval, *moved, cutoff, "differences", *recorded)


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
    ensure_at_least("every", every, 1)
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
        raw = read_regular(path, LARGEST_TABLE)
    except OSError as error:
        sentence = f"{path} should be a motion file and cannot be read ({error}); check the path"
        raise MotionError(sentence, SolverCode.UNREADABLE_TABLE) from error
    try:
        lines = raw.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:  # a name with an accent in the header of an older program
        lines = raw.decode("latin-1").splitlines()
    if path.suffix.lower() == ".trc":
        sentence = f"{path.name} should be a table over time (.mot, .sto, .csv) and holds markers; see `station ik`"
        raise MotionError(sentence, SolverCode.MALFORMED_TABLE)
    in_degrees, first = False, 0
    if path.suffix != ".csv":
        ends = [i for i, line in enumerate(lines) if line.strip(_FILLING) == "endheader"]
        if not ends:
            sentence = f"{path.name} should have a line 'endheader' above its table and has none; check it"
            raise MotionError(sentence, SolverCode.MALFORMED_TABLE)
        first = ends[0] + 1
        in_degrees = _is_in_degrees(lines[: ends[0]], is_mot=path.suffix == ".mot")
    given = [line for line in lines[first:] if line.strip() and line[0] != "#"]
    rows = [line.replace(",", " ") for line in given]
    if len(rows) < 3:
        sentence = f"{path.name} should have a row of names and at least two frames and has {len(rows)} rows"
        raise MotionError(sentence, SolverCode.NO_FRAMES)
    names = rows[0].split()
    try:
        table = np.loadtxt(rows[1:], comments=None, ndmin=2)
    except ValueError as error:
        _ensure_same_length(path, rows)
        sentence = f"{path.name} should hold numbers below its names ({error}); check the file"
        raise MotionError(sentence, SolverCode.MALFORMED_TABLE) from error
    if table.shape[1] != len(names):
        names = _names_with_spaces(given[0])
    if table.shape[1] != len(names):
        _ensure_same_length(path, rows)
    if not np.isfinite(table).all():
        frame, column = np.argwhere(~np.isfinite(table))[0]
        sentence = f"{path.name} should hold finite numbers and has {names[column]} {table[frame, column]}"
        raise MotionError(f"{sentence} in frame {frame + 1}; fill or cut the gap", SolverCode.NOT_FINITE)
    return names, table, in_degrees


def _names_with_spaces(row: str) -> list[str]:
    """Names that tabs separate, or else commas, as a name may contain spaces."""
    separator = "\t" if "\t" in row else ","
    return [name.strip() for name in row.strip(_FILLING).split(separator)]


def _ensure_same_length(path: Path, rows: Sequence[str]) -> None:
    """Raise MotionError for the first row that has not as many columns as the row of names."""
    lengths = [len(row.split()) for row in rows]
    for number, length in enumerate(lengths):
        if length != lengths[0]:
            raise MotionError(
                f"{path.name} should have {lengths[0]} columns in every row and has {length} in frame {number}; "
                "the file may be cut",
                SolverCode.MALFORMED_TABLE,
            )


def _is_in_degrees(header: Sequence[str], *, is_mot: bool) -> bool:
    """As the header says. A motion file of SIMM, as OpenSim 1 wrote it, has no version and is in degrees.

    Spreadsheets fill the lines of a header with tabs or commas, up to the number of columns.
    """
    fields = {}
    for line in header:
        key, *value = line.strip(_FILLING).lower().replace("=", " ").split() or [""]
        fields[key] = " ".join(value)
    if "indegrees" in fields:
        return fields["indegrees"] in ("yes", "y")
    return "version" not in fields and (is_mot or fields.get("angles") == "are in degrees.")


def _ensure_possible(path: Path, model: Model, coordinates: Array) -> None:
    """Raise MotionError for a value beyond LARGEST_COORDINATE, such as the mark of a gap."""
    frame, index = np.unravel_index(int(np.abs(coordinates).argmax()), coordinates.shape)
    value, coordinate = coordinates[frame, index], model.coordinates[int(index)]
    if abs(value) > LARGEST_COORDINATE:
        unit = {"rotation": "rad", "translation": "m"}.get(coordinate.motion, "rad or m")
        raise MotionError(
            f"{path.name} should have {coordinate.name} below {LARGEST_COORDINATE:g} {unit} and has {value:.3g} {unit} "
            f"in frame {frame + 1}; correct the value or cut the frame",
            SolverCode.IMPOSSIBLE_VALUE,
        )


def _coordinate_of(column: str) -> str:
    """Name of the coordinate of a column: OpenSim 4 writes /jointset/JOINT/COORDINATE/value into tables of states."""
    parts = column.split("/")
    return parts[-2] if len(parts) > 2 and parts[-1] == "value" else column


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
