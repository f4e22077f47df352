"""Joint force measured by an instrumented implant, as Orthoload publishes it (.txt): relative to the implant, or to the
glenoid.

    BodyWeight [N]:<tab>830                         in the header of the implant's record only
    Time<tab>Fx<tab>Fy<tab>Fz<tab>F<tab>…<tab>Marker        Fgx … Fg relative to the glenoid
    [s]<tab>[N]<tab>[N]<tab>[N]<tab>[N]<tab>…<tab>[0/1]
    0.000<tab>00135.85<tab>…

Numbers have decimal commas in the header and decimal points in the rows, or commas in both. Marker is 1 in the samples
that belong to the motion that was captured with it; the record relative to the glenoid has only these. There 2 marks
jumps in the kinematic data, and 3 that they are missing: then the force relative to the glenoid is unknown.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.text import listed, read_lines, read_numbers

Array = NDArray[np.float64]

ROUNDING_N = 0.05
"""Largest difference between |F| and the resultant in the file; its numbers have two decimals."""
FEWEST_SAMPLES = 2
NO_KINEMATICS = 3
"""Marker of samples that are left out."""
LARGEST_GAP_S = 0.05
"""Between samples; five are measured in that time."""
WEIGHT, NEWTONS = r"body ?weight", r"\s*\[N\]"
"""Regular expressions, without regard to capitals."""
LEAST_WEIGHT_N, LARGEST_WEIGHT_N = 200.0, 2500.0
"""Of a patient: 20 to 255 kg. A mass in kg under a header of newtons is below."""


@dataclass(frozen=True, eq=False)
class JointForceRecord:
    """Samples of a joint force that belong to a captured motion, at the file's own uneven times.

    time_s        (samples,) from the first frame of the motion
    force         (samples, 3) [N]: relative to implant (medial, anterior, superior) or glenoid (forward, up, lateral)
    resultant     (samples,) [N]
    body_weight   [N]; None where the header has none
    is_cut        whether the motion begins with the first sample of the file
    """

    time_s: Array
    force: Array
    resultant: Array
    body_weight: float | None
    is_cut: bool

    def at(self, time: Array) -> tuple[Array, Array]:
        """Force (frames, 3) and resultant (frames,) [N] at time (frames,) [s], as by interpolate_samples."""
        table = np.column_stack([self.force, self.resultant])
        found = interpolate_samples(time, self.time_s, table, LARGEST_GAP_S)
        return found[:, :3], found[:, 3]


def interpolate_samples(time: Array, sampled: Array, table: Array, largest_gap: float) -> Array:
    """Columns of a table (samples, columns) of times `sampled` [s] at time (frames,) [s], linear between samples.

    NaN between samples that are more than largest_gap [s] apart, and further than that from the first or the last one.
    """
    found = np.column_stack([np.interp(time, sampled, column) for column in table.T])
    place = np.searchsorted(sampled, time)
    before, after = (place - 1).clip(min=0), place.clip(max=len(sampled) - 1)
    is_in_gap = (time != sampled[after]) & (sampled[after] - sampled[before] > largest_gap)
    is_outside = (time < sampled[0] - largest_gap) | (time > sampled[-1] + largest_gap)
    found[is_in_gap | is_outside] = np.nan
    return found


def read_joint_force(path: Path) -> JointForceRecord:
    """Read either record. Raises ForeignFile with a code where columns, units, rows, times or marker are wrong."""
    lines = read_lines(path)
    first = _titles_line(lines, path)
    titles = lines[first].split()
    columns = _columns(titles, lines[first + 1].split(), path)
    numbers = np.array([i for i, line in enumerate(lines, start=1) if i > first + 2 and line.strip()], dtype=int)
    _ensure_announced(lines[:first], len(numbers), path)
    table = read_numbers([lines[i - 1] for i in numbers], "\t", columns, path, int(numbers.min(initial=len(lines))))
    marked, is_cut = table[table[:, -1] > 0, 0], bool((table[:1, -1] > 0).all())
    is_known = table[:, -1] != NO_KINEMATICS
    table = table[is_known]
    _ensure_plausible(table, numbers[is_known], path)
    captured = np.flatnonzero(table[:, -1] > 0)
    if len(captured) < FEWEST_SAMPLES:
        raise ForeignFile(
            f"{path} has Marker 1 in {counted(len(captured), 'sample')}, expected it in those of the "
            "captured motion; use a "
            "record with motion data",
            RecordingCode.FOREIGN_NO_MOTION,
        )
    kept = table[captured[0] : captured[-1] + 1]
    weight = _body_weight(lines[:first], path)
    return JointForceRecord(kept[:, 0] - marked[0], kept[:, 1:4], kept[:, 4], weight, is_cut)


def _titles_line(lines: Sequence[str], path: Path) -> int:
    for number, line in enumerate(lines[:-1]):
        if line.split("\t")[0].strip() == "Time" and lines[number + 1].startswith("["):
            return number
    raise ForeignFile(
        f"{path} has no line of titles that begins with Time, with units below it, expected a joint force as published "
        "by Orthoload; download it again",
        RecordingCode.FOREIGN_NO_HEADER,
    )


def _columns(titles: Sequence[str], units: Sequence[str], path: Path) -> list[int]:
    """Columns of time, three components, resultant and marker."""
    expected = ("Time", "Fx", "Fy", "Fz", "F", "Marker")
    found = [title.replace("Fg", "F") for title in titles]
    missing = [title for title in expected if found.count(title) != 1]
    if missing:
        raise ForeignFile(
            f"{path} has the columns {listed(titles)}, expected one {', one '.join(missing)}; use a joint force",
            RecordingCode.FOREIGN_MISSING_COLUMN,
        )
    columns = [found.index(title) for title in expected]
    wrong = [titles[column] for column in columns[:-1] if column >= len(units) or units[column] != _unit(found[column])]
    if wrong:
        raise ForeignFile(
            f"{path} has another unit than s and N, or none, for {', '.join(wrong)}; convert it",
            RecordingCode.FOREIGN_UNIT,
        )
    return columns


def _unit(title: str) -> str:
    return "[s]" if title == "Time" else "[N]"


def _ensure_announced(header: Sequence[str], found: int, path: Path) -> None:
    announced = _header_number(header, "Number of Data Sets", path)
    if announced is not None and announced != found:
        raise ForeignFile(
            f"{path} announces {counted(announced, 'sample')} and has {found}; download it again",
            RecordingCode.FOREIGN_CUT,
        )


def _ensure_plausible(table: Array, numbers: NDArray[np.int64], path: Path) -> None:
    """Raise ForeignFile for holes, times that do not increase, and a resultant that is not that of the components.

    numbers (samples,) are those of the lines.
    """
    holes = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(holes) or not len(table):
        place = f"line {numbers[holes[0]]}" if len(holes) else "its table"
        raise ForeignFile(
            f"{path} has no number somewhere in {place}, expected every sample; it may be cut, download it again",
            RecordingCode.FOREIGN_NOT_A_NUMBER,
        )
    backwards = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if len(backwards):
        raise ForeignFile(
            f"{path} has {table[backwards[0] + 1, 0]:g} s after {table[backwards[0], 0]:g} s, expected times that "
            "increase; download it again",
            RecordingCode.FOREIGN_TIME_NOT_RISING,
        )
    difference = np.abs(np.linalg.norm(table[:, 1:4], axis=1) - table[:, 4])
    worst = int(difference.argmax())
    if difference[worst] > ROUNDING_N:
        raise ForeignFile(
            f"{path} gives a resultant of {table[worst, 4]:g} N at {table[worst, 0]:g} s, expected that of its "
            f"components within {ROUNDING_N:g} N; check its columns",
            RecordingCode.FOREIGN_CONTRADICTORY,
        )


def _body_weight(header: Sequence[str], path: Path) -> float | None:
    """The body weight [N], None where the header has none."""
    weight = _header_number(header, WEIGHT, path)
    if weight is None:
        return None
    if _header_line(header, WEIGHT + NEWTONS) is None:
        raise ForeignFile(
            f"{path} has no [N] behind BodyWeight in its header; convert the number to newtons, and correct the line",
            RecordingCode.FOREIGN_UNIT,
        )
    if not LEAST_WEIGHT_N <= weight <= LARGEST_WEIGHT_N:
        raise ForeignFile(
            f"{path} has a body weight of {weight:g} N in its header, expected {LEAST_WEIGHT_N:g} to "
            f"{LARGEST_WEIGHT_N:g} N; is it a mass in kg?",
            RecordingCode.FOREIGN_UNIT,
        )
    return weight


def _header_number(header: Sequence[str], key: str, path: Path) -> float | None:
    """The number at the end of the header's line of a key, None where there is no such line."""
    line = _header_line(header, key)
    if line is None:
        return None
    field = re.split(r"[\s:]", line.strip())[-1].replace(",", ".")
    try:
        number = float(field)
    except ValueError:
        number = np.nan
    if not 0 < number < np.inf:
        raise ForeignFile(
            f"{path} has {line.strip()!r} in its header, expected a positive number at its end; correct the line",
            RecordingCode.FOREIGN_NOT_A_NUMBER,
        )
    return number


def _header_line(header: Sequence[str], key: str) -> str | None:
    """The first line that begins with a key, a regular expression."""
    return next((line for line in header if re.match(key, line, re.IGNORECASE)), None)
