"""Gap-free segments of a table over time: OpenSim's Storage stops reading at the first number that is not finite.

A gap is where values are unknown, or where samples were lost and the times jump. OpenSim interpolates a spline across
a gap and extrapolates beyond the last row; its files cannot mark either.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_ROWS = 4  # of a segment: a cubic spline needs four points
JUMP = 1.5  # time steps between two rows from which on a sample is lost


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
    """Find the gap-free segments of values (rows, columns) at even times (rows,), of which some may be lost."""
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
