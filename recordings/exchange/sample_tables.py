"""Content of files of other programs, as arrays on the file's own clock; no alignment, no calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.text import MISSING

RATE_TOLERANCE, SLIGHT = 0.01, 1e-4
"""Relative differences of two rates: of one that is meant to be the same, and of one that is not worth a note."""
HIDDEN_FROM_MM = 1e9
"""A position beyond a thousand kilometres is the mark of a missing one, or damage."""
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
SPELLED_OUT = {
    "millimeter": "mm",
    "millimetre": "mm",
    "centimeter": "cm",
    "centimetre": "cm",
    "meter": "m",
    "metre": "m",
}

TIME_UNITS = {"ms": 1e3, "µs": 1e6, "min": 1 / 60, "frames": 0.0}
"""Number of them in a second; frames are counted."""
ABOUT = 1.5
"""Largest ratio of the durations of two files of one measurement for which their ratio names a unit."""
FEWEST_LETTERS = 4
"""Of a spelled unit; C3D cuts it to the width of its parameter."""


@dataclass(frozen=True)
class MarkerTable:
    """Marker trajectories.

    labels     of the markers, each once
    rate_hz    frame rate: nominal, or that of the times where these differ from it by more than their last digit
    time_s     (frames,) strictly rising; without times in the file frame n is at (n − 1)/rate_hz
    positions  (frames, markers, 3) float64 mm in the mocap frame, NaN where a marker was missing
    residuals  (frames, markers) mm, 0 if the file has none
    notes      sentences on what was not read as it is in the file
    """

    labels: tuple[str, ...]
    rate_hz: float
    time_s: NDArray[np.float64]
    positions: NDArray[np.float64]
    residuals: NDArray[np.float64]
    notes: tuple[str, ...] = ()

    @property
    def missing(self) -> NDArray[np.bool_]:
        """(frames, markers) where a marker was not seen."""
        return np.isnan(self.positions[..., 0])

    @property
    def frame_numbers(self) -> NDArray[np.int64]:
        """(frames,) from 1 for time 0, counted from the times as samples are: a gap is a jump."""
        return count_samples(self.time_s)[0] + round(float(self.time_s[0]) * self.rate_hz) + 1


@dataclass(frozen=True)
class SignalTable:
    """Scalar signals that were sampled together.

    time_s   (n,) strictly rising
    signals  name → (n,) float64, of those that were asked for and are there
    units    name → unit, "" where the file declares none
    names    of everything in the file
    """

    time_s: NDArray[np.float64]
    signals: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str]
    names: tuple[str, ...]


def require_rising(time_s: NDArray[np.float64], where: str, first_line: int = 1) -> None:
    """Raises ForeignFile at the first time (n,) that is no number or not later than the one before.

    where names file and column; the times are in consecutive lines from first_line on.
    """
    if len(time_s) < 2:
        raise ForeignFile(
            f"{where} holds {counted(len(time_s), 'sample')}, expected at least 2; export the complete file",
            RecordingCode.FOREIGN_TOO_SHORT,
        )
    broken = np.flatnonzero(~np.isfinite(time_s))
    if len(broken):
        raise ForeignFile(
            f"{where} has no number in line {first_line + broken[0]}; every sample needs its time",
            RecordingCode.FOREIGN_NOT_A_NUMBER,
        )
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if len(back):
        at = int(back[0]) + 1
        what = "again" if time_s[at] == time_s[at - 1] else f"after {time_s[at - 1]:.9g} s"
        raise ForeignFile(
            f"{where} has {time_s[at]:.9g} s {what} in line {first_line + at}, expected increasing times; "
            "export it again, with enough digits, or repair the line",
            RecordingCode.FOREIGN_TIME_NOT_RISING,
        )


def require_labels(labels: tuple[str, ...], where: str) -> None:
    """Raises ForeignFile where there is no label, an empty one, or one twice."""
    twice = next((label for i, label in enumerate(labels) if label in labels[:i]), None)
    if not labels:
        raise ForeignFile(
            f"{where} names no markers; export the labelled trajectories", RecordingCode.FOREIGN_NO_MARKERS
        )
    if twice is not None:
        raise ForeignFile(
            f"{where} names the marker {twice!r} twice; give each trajectory a label of its own",
            RecordingCode.FOREIGN_REPEATED_NAME,
        )


def require_single_channels(names: Sequence[str], where: str) -> None:
    """Raises ForeignFile where a file has two channels, or columns, of one of the names."""
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise ForeignFile(
            f"{where} names the channel {twice!r} twice; give each a title of its own",
            RecordingCode.FOREIGN_REPEATED_NAME,
        )


def distinct_labels(labels: Sequence[str], where: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Labels, of which repeated ones are numbered (RTHI#1, RTHI#2), and a note if there are any.

    The operator decides which of them is meant: neither keeps the name. Raises ForeignFile as require_labels.
    """
    twice = [label for label in dict.fromkeys(labels) if label and labels.count(label) > 1]
    numbered = tuple(
        f"{label}#{labels[: i + 1].count(label)}" if label in twice else label for i, label in enumerate(labels)
    )
    require_labels(numbered, where)
    if not twice:
        return numbered, ()
    return numbered, (
        f"{where} names more than one marker {', '.join(twice)}: they are numbered {twice[0]}#1, {twice[0]}#2 in the "
        f"file's order; rename one in the file, or import it with --label {twice[0]}#1={twice[0]}",
    )


def require_whole_positions(rows: Sequence[str], before: int, columns: int, path: Path, first_line: int) -> None:
    """Raises ForeignFile at the first row of tabs that ends within a position: its last number may be cut as well.

    before, columns: in front of the first marker, and in all. Fields may be missing where the last markers are hidden.
    """
    for i, row in enumerate(rows):
        fields = row.rstrip().split("\t")
        found = len(fields)
        if before < found < columns and (found - before) % 3 and fields[-1].lower() not in MISSING:
            raise ForeignFile(
                f"{path}, line {first_line + i}, ends within the position of a marker: it has {found} fields, expected "
                f"{columns}; export the file again, whole",
                RecordingCode.FOREIGN_CUT,
            )


def without_origin(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions (frames, markers, 3) [mm] with NaN where a coordinate is missing or all three are exactly zero.

    Zeros are how several programs write a marker that was not seen; no real one is exactly in the origin.
    """
    missing = ~(np.abs(positions) < HIDDEN_FROM_MM).all(axis=2) | (positions == 0).all(axis=2)
    return np.where(missing[..., None], np.nan, positions)


def note_on_far(positions: NDArray[np.float64], where: str) -> tuple[str, ...]:
    """A note on positions (frames, markers, 3) [mm] that without_origin removes because of their size."""
    far = int((np.abs(positions) >= HIDDEN_FROM_MM).any(axis=2).sum())
    if not far:
        return ()
    return (f"{where} has {far} positions beyond {HIDDEN_FROM_MM:g} mm, which are read as missing",)


def unit_of_times(durations: float) -> str | None:
    """The unit of times, of a duration over that in seconds of about the same measurement; None for seconds or none."""
    for unit, in_second in TIME_UNITS.items():
        if in_second and 1 / ABOUT < durations / in_second < ABOUT:
            return unit
    return None


def settle_times(
    numbers: NDArray[np.float64], time: NDArray[np.float64] | None, rate: float, where: str, first_line: int
) -> tuple[float, NDArray[np.float64], tuple[str, ...]]:
    """Frame rate [Hz] and times (frames,) [s] of a file, and a note where its rate is not that of its times.

    numbers (frames,) count the frames, the first of the capture is 1; time (frames,) [s] or None, which decides; rate
    [Hz], 0 where the file has none. Raises ForeignFile where times do not rise, or are in ms by the rate.
    """
    if time is None:
        if rate <= 0:
            raise ForeignFile(
                f"{where} has neither a frame rate nor times; export it with its time column",
                RecordingCode.FOREIGN_NO_RATE,
            )
        require_rising(numbers, f"{where}, frame numbers,", first_line)
        return rate, (numbers - 1) / rate, ()
    require_rising(time, f"{where}, times,", first_line)
    counted, measured = count_samples(time)
    if rate > 0 and abs(counted[-1] / rate - np.ptp(time)) <= last_digit(time):
        return rate, time, ()
    measured = float(f"{measured:.9g}")
    for unit, in_second in TIME_UNITS.items():
        if rate > 0 and abs(measured * (in_second or rate) / rate - 1) < RATE_TOLERANCE and measured != rate:
            raise ForeignFile(
                f"{where} states {rate:g} frames a second and has its times in {unit}; export them in s",
                RecordingCode.FOREIGN_CONTRADICTORY,
            )
    if rate <= 0 or abs(measured / rate - 1) < SLIGHT:
        return measured, time, ()
    note = f"{where} states {rate:g} frames a second, and its times give {measured:.6g}: the times are used"
    return measured, time, (note,)


def last_digit(time_s: NDArray[np.float64]) -> float:
    """[s] Unit of the last decimal of the times, not below 1 ns."""
    for decimals in range(9):
        if np.allclose(time_s, np.round(time_s, decimals), rtol=0, atol=1e-10):
            return float(10.0**-decimals)
    return 1e-9


def count_samples(time_s: NDArray[np.float64]) -> tuple[NDArray[np.int64], float]:
    """Sample numbers (n,) from 0 and the rate [Hz] of times (n,) whose counting was lost: a gap is a jump.

    The step is the median over twenty samples, so that neither gaps nor times rounded to milliseconds move it.
    """
    stride = min(20, len(time_s) - 1)
    step = float(np.median(time_s[stride:] - time_s[:-stride])) / stride
    steps = np.maximum(1, np.rint(np.diff(time_s) / step)).astype(np.int64)
    numbers = np.concatenate(([0], np.cumsum(steps)))
    return numbers, float(numbers[-1] / (time_s[-1] - time_s[0]))


def millimetres(unit: str, where: str) -> float:
    """Millimetres in a unit of a file; 1 where it names none, as mocap systems export in millimetres.

    Raises ForeignFile for an unknown unit.
    """
    name = unit.strip().lower().removesuffix("s") or "mm"
    cut = (short for spelled, short in SPELLED_OUT.items() if len(name) >= FEWEST_LETTERS and spelled.startswith(name))
    known = MILLIMETRES.get(next(cut, name))
    if known is None:
        raise ForeignFile(
            f"{where} has positions in {unit!r}, expected {', '.join(MILLIMETRES)}; export it in one of them, "
            "or import it with --mocap-unit",
            RecordingCode.FOREIGN_UNIT,
        )
    return known


def write_parquet(
    path: Path, columns: Mapping[str, NDArray[np.float64]], units: Mapping[str, str], notes: Mapping[str, str]
) -> None:
    """Columns (n,) of one length under their names; units in the fields' metadata, notes in the file's."""
    import pyarrow as pa
    from pyarrow import parquet

    fields = [pa.field(name, pa.float64(), metadata={"unit": units[name]}) for name in columns]
    arrays = [pa.array(values, from_pandas=True) for values in columns.values()]
    parquet.write_table(pa.table(arrays, schema=pa.schema(fields, metadata=dict(notes))), path)
