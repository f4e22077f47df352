"""A table over time in gap-free pieces: OpenSim's Storage stops reading at the first number that is not finite.

A gap is where values are not known, or where samples were lost and the times jump. OpenSim draws a spline through a
gap, and on beyond the end of what it read; nothing in its files marks either.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_ROWS = 4  # of a piece: a cubic spline goes through four points
JUMP = 1.5  # steps between two rows from which on a sample was lost


@dataclass(frozen=True, eq=False)
class Pieces:
    """What is known of a table.

    slices     (start, end) of each piece's rows
    unknown    rows that hold something that is not finite
    too_short  rows between two gaps that are fewer than LEAST_ROWS
    """

    slices: tuple[slice, ...]
    unknown: int
    too_short: int


def find_pieces(time: Array, values: Array) -> Pieces:
    """The gap-free pieces of values (rows, columns) at evenly sampled times (rows,) of which some may be lost."""
    is_known: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(values), axis=1)
    changes = np.diff(is_known) | _jumps(time)
    starts = np.concatenate([[0], np.flatnonzero(changes) + 1]).tolist()
    runs = [slice(start, end) for start, end in zip(starts, [*starts[1:], len(time)], strict=True) if is_known[start]]
    kept = tuple(run for run in runs if run.stop - run.start >= LEAST_ROWS)
    known = int(is_known.sum())
    return Pieces(kept, len(time) - known, known - sum(run.stop - run.start for run in kept))


@dataclass(frozen=True, eq=False)
class Filled:
    """A table whose gaps are filled along straight lines.

    time, values        (rows,) and (rows, columns), from the first known row to the last
    unknown, lost       how many of the rows held something unknown, or stand for samples that were lost
    longest             greatest time between two known rows [s]
    """

    time: Array
    values: Array
    unknown: int
    lost: int
    longest: float


def fill_gaps(time: Array, values: Array) -> Filled:
    """Fill each column on its own between its known rows; rows before the first known one or after the last are cut."""
    whole = np.flatnonzero(np.isfinite(values).all(axis=1))
    inner = slice(whole[0], whole[-1] + 1)
    time, values, known_time = time[inner], values[inner], time[whole]
    step = float(np.median(np.diff(time)))
    every = [time]
    for i in np.flatnonzero(_jumps(time)).tolist():
        count = round((time[i + 1] - time[i]) / step)
        every.append(np.linspace(time[i], time[i + 1], count + 1)[1:-1])
    dense = np.sort(np.concatenate(every))
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
