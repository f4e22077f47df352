"""Motions: coordinates over time from .mot, .sto or .csv, smoothed and differentiated as the published study did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.interval import counted
from documents.message import Code, Message
from documents.results import EqualByFields, labelled_dataset
from solver.checks import ensure_at_least, ensure_known, ensure_type
from solver.errors import MotionError, SolverCode, describe_codes
from solver.model import Array, Model
from solver.time_series_table import FEWEST_SAMPLED, LONGEST_STEP_S, TableHeader, ensure_seconds, read_table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Derivatives = Literal["differences", "splines"]
SHORT_STEP_PERIODS = 0.1
"""Longest gap, in periods of the cut-off, that a spline bridges."""
HIGHEST_RATE_HZ, HIGHEST_SPEED = 1200.0, 40.0
"""Of a captured motion [frames/s], and of a joint at such a rate [rad/s]: 20 frames/s and 0.7 rad/s if in minutes."""
LARGEST_COORDINATE = 1e6
"""[rad or m] Beyond any motion, also one in degrees or millimetres; a filter would spread it over all frames."""
_SCALES = {"": 1.0, "s": 1.0, "rad": 1.0, "m": 1.0, "deg": np.pi / 180, "mm": 1e-3}
"""Unit of a column of a DataFrame → factor to SI."""
_TIMES = ("time", "time_s")
"""Names of the column of times of a DataFrame."""
LONGEST_STEP, SHORT_STEP_S = 1.5, 0.01
"""A step is a gap above 1.5 steps of the even grid, since a missing frame makes a step of 2, and above 10 ms without a
cut-off."""
LEAST_STEP = 0.05
"""Over the step of the grid. A spline through two times that are closer multiplies the rounding of their values."""


@dataclass(frozen=True)
class Motion:
    """Coordinates of a model over time, as they were recorded.

    names        of the coordinates, in the model's order
    time         (frames,) [s], evenly spaced
    coordinates  (frames, coordinates) [rad], translations [m]
    missing      names of the coordinates without data, which keep their default values
    unused       columns that are no coordinate, without the other states of a table that OpenSim wrote
    steps        shortest and longest step of the recorded times [s], if they were uneven; None if they were even
    largest_degrees  largest angle [°] of a file in degrees; None of one in radians
    row_counts  rows by the header of the file and rows that it has, if they differ; all of them are used
    repeated_rows  rows that are left out because they are those before them
    """

    names: tuple[str, ...]
    time: Array
    coordinates: Array
    missing: tuple[str, ...] = ()
    steps: tuple[float, float] | None = None
    largest_degrees: float | None = None
    row_counts: tuple[int, int] | None = None
    repeated_rows: int = 0
    unused: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Kinematics(EqualByFields):
    """Time, coordinates, speeds and accelerations of a motion.

    time          (frames,) [s];  interval [s] between neighbours
    positions     q (frames, coordinates) [rad or m]
    speeds        u [rad/s or m/s];  accelerations [rad/s² or m/s²]
    cutoff        of the low-pass filter [Hz], None where none was used
    derivatives   by central differences (differentiate) or by splines (motion_splines.py), which use different filters
    steps, missing, largest_degrees, row_counts, repeated_rows, unused  of the recorded motion, as in Motion
    findings      of cuffstation.load_motion: unusual properties of the motion
    units         name of a coordinate → rad or m, in the order of positions; of cuffstation.load_motion, else empty

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
    row_counts: tuple[int, int] | None = None
    repeated_rows: int = 0
    unused: tuple[str, ...] = ()
    findings: tuple[Message[Code], ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)

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
        described = (
            f"Kinematics: {counted(frames, 'frame')} of {counted(coordinates, 'coordinate')}, "
            f"{span}; low-pass filter: {self.filter}"
        )
        if self.steps is not None:
            described += f"; interpolated from steps of {self.steps[0]:.6g} to {self.steps[1]:.6g} s"
        if self.missing:
            described += f"; without data: {', '.join(self.missing)}"
        return described + describe_codes(self.findings)

    def to_dataframe(self, quantity: Literal["positions", "speeds", "accelerations"] = "positions") -> pd.DataFrame:
        """A row per frame: time_s, then a column per coordinate, with its unit in attrs["units"].

        cuffstation.load_motion(model, table) reads a table of positions.
        """
        import pandas as pd

        per_quantity = {"positions": "", "speeds": "/s", "accelerations": "/s²"}
        ensure_known("quantity", quantity, per_quantity)
        table = pd.DataFrame(getattr(self, quantity), columns=self._coordinates)
        table.insert(0, "time_s", self.time)
        table.attrs["units"] = {"time_s": "s"} | {
            name: unit + per_quantity[quantity] for name, unit in self.units.items()
        }
        return table

    def to_xarray(self) -> xr.Dataset:
        """positions, speeds and accelerations (time, coordinate). Needs the extra xarray."""
        dims, names = ("time", "coordinate"), ("positions", "speeds", "accelerations")
        variables = {name: (dims, getattr(self, name), "SI") for name in names}
        return labelled_dataset(variables, {"time": (self.time, "s"), "coordinate": (self._coordinates, "")})

    @property
    def _coordinates(self) -> list[str]:
        """Names of the coordinates, or their numbers where they are not known."""
        return list(self.units) or [f"q{number}" for number in range(self.positions.shape[1])]

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
    Angles are converted to radians if the header has inDegrees=yes. Columns without a coordinate are not read. A
    coordinate without a column is refused; with_defaults it keeps its default value, as in OpenSim, unless all are
    missing. A motion with uneven steps, as OpenSim's RRA and CMC write it, is interpolated to an even grid, and a row
    that repeats the one before is left out; a motion with times in ms is refused. The functions that differentiate a
    motion refuse one with a gap that is long for their cut-off. Raises MotionError, which names the file and the
    missing or malformed part.
    """
    columns, table, header = read_table(path)
    names = [_coordinate_name(column) for column in columns]
    return _motion(path, names, table, header, model, with_defaults=with_defaults)


def motion_from_dataframe(table: pd.DataFrame, model: Model) -> Motion:
    """Motion of a table with the column or the index "time" (or "time_s") [s] and the names of coordinates [rad or m].

    attrs["units"] of the table may name the unit of a column: rad, deg, m or mm. Other columns are not read, and a
    coordinate without a column keeps its default. Raises MotionError as read_motion does.
    """
    if table.index.name in _TIMES and table.index.name not in table.columns:
        table = table.reset_index()
    units = table.attrs.get("units", {})
    ensure_type("attrs['units']", units, Mapping, "a mapping from columns to units")
    columns = ["time" if column in _TIMES else _coordinate_name(str(column)) for column in table.columns]
    _ensure_columns_with_units(units, [*columns, *table.columns, *model.coordinate_names, *_TIMES])
    values = np.zeros(table.shape)
    for index, (name, column) in enumerate(zip(columns, table.columns, strict=True)):
        if name in ("time", *model.coordinate_names):
            values[:, index] = _in_si(table.iloc[:, index], str(column), units.get(column, ""))
    if len(values) < 2:
        sentence = f"the DataFrame should have at least 2 rows and has {len(values)}; give more frames"
        raise MotionError(sentence, SolverCode.NO_FRAMES)
    return _motion(Path("the DataFrame"), columns, values, TableHeader(), model, with_defaults=True)


def _in_si(column: pd.Series[Any], name: str, unit: object) -> Array:
    """The values of a column in s, rad or m. Raises MotionError for a text, a gap and an unknown unit."""
    if not isinstance(unit, str) or unit not in _SCALES:
        expected = ", ".join(filter(None, _SCALES))
        sentence = f"the DataFrame has {name} in {unit}, expected {expected}; correct attrs['units']"
        raise MotionError(sentence, SolverCode.MALFORMED_TABLE)
    try:
        values = column.to_numpy(dtype=float)
    except (TypeError, ValueError) as error:
        sentence = f"the DataFrame should have numbers in {name} ({error}); convert the column"
        raise MotionError(sentence, SolverCode.MALFORMED_TABLE) from error
    gaps = np.flatnonzero(~np.isfinite(values))
    if len(gaps):
        sentence = f"the DataFrame should have finite numbers in {name} and has none in {len(gaps)} of {len(values)} "
        raise MotionError(f"{sentence}rows, the first in row {gaps[0]}; fill or cut them", SolverCode.NOT_FINITE)
    return values * _SCALES[unit]


def _ensure_columns_with_units(units: Mapping[Any, object], names: Sequence[Any]) -> None:
    """Raise MotionError if a unit other than the SI one is that of no column: a name is misspelt, or was changed."""
    in_si = [unit for unit, factor in _SCALES.items() if factor == 1.0]
    lost = [name for name, unit in units.items() if name not in names and unit not in in_si]
    if lost:
        sentence = f"attrs['units'] of the DataFrame has {lost[0]} in {units[lost[0]]}, and there is no such column"
        raise MotionError(f"{sentence}; correct the name, or leave it out", SolverCode.MALFORMED_TABLE)


def _motion(
    path: Path, columns: list[str], table: Array, header: TableHeader, model: Model, *, with_defaults: bool
) -> Motion:
    """The motion of columns; path is the source that messages name."""
    missing = _missing(path, model, columns, with_defaults=with_defaults)
    time = table[:, columns.index("time")]
    coordinates = np.tile(model.default_coordinates, (len(time), 1))
    largest_degrees = 0.0 if header.in_degrees else None
    for index, coordinate in enumerate(model.coordinates):
        if coordinate.name not in missing:
            values = table[:, columns.index(coordinate.name)]
            if largest_degrees is not None and coordinate.motion == "rotation":
                largest_degrees = max(largest_degrees, float(np.abs(values).max()))
                values = np.radians(values)
            coordinates[:, index] = values
    _ensure_possible(path, model, coordinates)
    counts = header.row_counts(len(time))
    ensure_seconds(path, time)
    _ensure_not_minutes(path, model, time, coordinates)
    time, coordinates, steps = _on_even_grid(path, time, coordinates)
    names = model.coordinate_names
    unused = tuple(column for column in columns if column not in ("time", *names) and not column.startswith("/"))
    return Motion(names, time, coordinates, missing, steps, largest_degrees, counts, header.repeated, unused)


def differentiate(
    motion: Motion, cutoff: float | None = 3.0, start: float | None = None, end: float | None = None
) -> Kinematics:
    """Smooth a motion, take speeds and accelerations by central differences, and keep the frames from start to end [s].

    The filter is the published one: Butterworth of order 4 at `cutoff` [Hz], forwards and backwards over the whole
    motion, both ends extended by odd reflection over 12 samples (MATLAB's filtfilt; SciPy alone would take 15).
    """
    interval = float(motion.time[-1] - motion.time[0]) / (len(motion.time) - 1)
    ensure_steps(motion, cutoff)
    positions = motion.coordinates if cutoff is None else _smooth(motion.coordinates, cutoff, 1 / interval)
    speeds = np.gradient(positions, interval, axis=0)
    accelerations = np.gradient(speeds, interval, axis=0)
    kept = frames_between(motion.time, start, end)
    return Kinematics(
        time=motion.time[kept],
        interval=interval,
        positions=positions[kept],
        speeds=speeds[kept],
        accelerations=accelerations[kept],
        cutoff=cutoff,
        steps=motion.steps,
        missing=motion.missing,
        largest_degrees=motion.largest_degrees,
        row_counts=motion.row_counts,
        repeated_rows=motion.repeated_rows,
        unused=motion.unused,
    )


def ensure_steps(motion: Motion, cutoff: float | None) -> None:
    """Raise MotionError where an interpolated motion has a gap that is long for the cut-off [Hz]; None: no filter."""
    if motion.steps is None or len(motion.time) < 2 or (cutoff is not None and cutoff <= 0):
        return
    longest, interval = motion.steps[1], float(motion.time[1] - motion.time[0])
    limit = SHORT_STEP_S if cutoff is None else SHORT_STEP_PERIODS / cutoff
    if longest > max(LONGEST_STEP * interval, limit) * (1 + 1e-6):  # times are printed with few decimals
        condition = "without a filter" if cutoff is None else f"for a cut-off of {cutoff:g} Hz"
        raise MotionError(
            f"the motion should have steps of at most {1e3 * limit:.3g} ms {condition} and has one of "
            f"{1e3 * longest:.3g} ms; fill the gap, or choose a {'' if cutoff is None else 'lower '}cut-off",
            SolverCode.UNEVEN_TIME,
        )


def ensure_cutoff(cutoff: float, rate: float) -> None:
    """Raise MotionError where the cut-off is not below half the motion's rate, both in Hz."""
    if not 0 < cutoff < rate / 2:
        in_ms = f"; the steps are {1 / rate:g} s: if the times are in ms, divide them by 1000"
        raise MotionError(
            f"the cutoff should lie between 0 and {rate / 2:g} Hz, half the motion's rate, and is {cutoff:g} Hz"
            f"{in_ms if 1 / rate >= LONGEST_STEP_S else ''}",
            SolverCode.WRONG_CUTOFF,
        )


def frames_between(time: Array, start: float | None, end: float | None) -> NDArray[np.bool_]:
    """(frames,) whether a frame lies between start and end [s], None for no limit. Raises MotionError if none does."""
    first, last = -np.inf if start is None else start, np.inf if end is None else end
    ensure_interval(first, last)
    tolerance = (time[-1] - time[0]) / (len(time) - 1) / 1e3
    kept: NDArray[np.bool_] = (time >= first - tolerance) & (time <= last + tolerance)
    if not kept.any():
        raise MotionError(
            f"the motion lasts from {time[0]:g} to {time[-1]:g} s and has no frame {_listed(start, end)}; choose other "
            "limits",
            SolverCode.NO_FRAMES,
        )
    return kept


def limits_outside(time: Array, start: float | None, end: float | None) -> str:
    """`from 0 s to 9 s`: finite limits [s] that lie outside the times (frames,) by more than a step; "" if none."""
    step = (time[-1] - time[0]) / max(1, len(time) - 1)
    is_early = start is not None and -np.inf < start < time[0] - step
    is_late = end is not None and time[-1] + step < end < np.inf
    return _listed(start if is_early else None, end if is_late else None)


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


def _missing(path: Path, model: Model, columns: Sequence[str], *, with_defaults: bool) -> tuple[str, ...]:
    """Coordinates without a column. Raises MotionError for columns that are missing, or there more than once."""
    names = model.coordinate_names
    if not names:
        sentence = f"the model {model.name} should have coordinates that {path.name} moves and has none"
        raise MotionError(f"{sentence}; give a model with joints", SolverCode.MISSING_COLUMN)
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
    return missing


def _on_even_grid(path: Path, time: Array, coordinates: Array) -> tuple[Array, Array, tuple[float, float] | None]:
    """Times and coordinates, interpolated where steps are uneven, and then the shortest and the longest step."""
    if is_even(time):
        return time, coordinates, None
    steps = np.diff(time)
    if steps.min() <= 0:
        later = float(time[int(np.flatnonzero(steps <= 0)[0]) + 1])
        sentence = f"{path.name} should have times that increase and has {later:g} s after an equal or later time"
        raise MotionError(f"{sentence}; sort the frames, or leave out repeated ones", SolverCode.UNEVEN_TIME)
    grid = even_grid(time)
    return grid, interpolated(time, coordinates, grid), (float(steps.min()), float(steps.max()))


def _listed(start: float | None, end: float | None) -> str:
    limits = [f"from {start:g} s"] if start is not None else []
    return " ".join(limits + ([f"to {end:g} s"] if end is not None else []))


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


def _ensure_not_minutes(path: Path, model: Model, time: Array, coordinates: Array) -> None:
    """Raise MotionError where joints are faster than a person's at a rate that no capture has: times in minutes.

    A joint's speed is that over a twentieth of the motion, where neither noise nor a jump of an angle counts.
    """
    frames, duration = len(time), float(time[-1] - time[0])
    if frames < FEWEST_SAMPLED or frames - 1 < HIGHEST_RATE_HZ * duration or (np.diff(time) <= 0).any():
        return
    angles = coordinates[:, [coordinate.motion == "rotation" for coordinate in model.coordinates]]
    apart = frames // FEWEST_SAMPLED
    speeds = np.abs(angles[apart:] - angles[:-apart]) / (time[apart:] - time[:-apart])[:, None]
    fastest = float(speeds.max(initial=0.0))
    if fastest > HIGHEST_SPEED:
        raise MotionError(
            f"{path.name} should have times in s and has {(frames - 1) / duration:.0f} frames/s with a joint at "
            f"{fastest:.3g} rad/s, as of times in min; multiply them by 60",
            SolverCode.TIME_UNIT,
        )


def _coordinate_name(column: str) -> str:
    """Name of the coordinate of a column: OpenSim 4 writes /jointset/JOINT/COORDINATE/value into tables of states."""
    parts = column.split("/")
    return parts[-2] if len(parts) > 2 and parts[-1] == "value" else column


def _smooth(coordinates: Array, cutoff: float, rate: float) -> Array:
    padding = 12
    ensure_cutoff(cutoff, rate)
    if len(coordinates) <= padding:
        sentence = f"the filter needs more than {padding} frames and the motion has {len(coordinates)}; turn it off"
        raise MotionError(sentence, SolverCode.NO_FRAMES)
    b, a = scipy.signal.butter(4, cutoff / (rate / 2))
    return np.asarray(scipy.signal.filtfilt(b, a, coordinates, axis=0, padtype="odd", padlen=padding))


def is_even(time: Array) -> bool:
    """Whether steps are within 1 % of each other, or were before the times (frames,) were printed with few decimals."""
    steps = np.diff(time)
    step = float(np.median(steps))
    return step > 0 and (np.abs(steps - step).max() <= 0.01 * step or _is_rounded_grid(time))


def even_grid(time: Array) -> Array:
    """Increasing times (frames,) at the median step, from the first to the last at most.

    The mean step is used if it is longer by more than a tenth: an integrator may take most of its steps in a moment.
    """
    steps = np.diff(time)
    median, mean = float(np.median(steps)), float(np.mean(steps))
    step = median if median > 0.9 * mean else mean
    grid: Array = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
    return grid.clip(max=time[-1])


def interpolated(time: Array, values: Array, grid: Array) -> Array:
    """Values (frames, columns) at other times, by cubic splines through those that are LEAST_STEP apart."""
    kept = _apart(time, LEAST_STEP * float(grid[1] - grid[0]))
    return np.asarray(scipy.interpolate.CubicSpline(time[kept], values[kept])(grid))


def _apart(time: Array, least: float) -> list[int]:
    """Indices of the times that are so far [s] after the last one that is kept, and the last of all."""
    kept = [0]
    for i in range(1, len(time)):
        if time[i] - time[kept[-1]] >= least:
            kept.append(i)
    if kept[-1] != len(time) - 1:
        kept[-1:] = [len(time) - 1] if len(kept) > 1 else [0, len(time) - 1]
    return kept


def _is_rounded_grid(time: Array) -> bool:
    """Whether times are those of an even grid, rounded to a decimal that is at most a tenth of a step: 60 Hz in ms."""
    decimal = next((10.0**-digits for digits in range(10) if np.allclose(time, time.round(digits), 0, 1e-12)), 0.0)
    grid = np.linspace(time[0], time[-1], len(time))
    return bool(decimal <= 0.1 * (grid[1] - grid[0]) and float(np.abs(time - grid).max()) <= 1.001 * decimal)
