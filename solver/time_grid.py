"""Times of a motion: whether they are even, and the even grid that replaces the variable steps of an integrator."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

LONGEST_STEP, SHORT_STEP_S = 1.5, 0.01
"""Over the step of the grid, of a motion that is interpolated: one frame that is missing makes a step of 2. Any step is
interpolated that is a tenth of a period at 10 Hz, more than is left of a motion after its low-pass filter."""
LEAST_STEP = 0.05
"""Over the step of the grid. A spline through two times that are closer multiplies the rounding of their values."""


def is_even(time: Array) -> bool:
    """Whether steps are within 1 % of each other, or were before the times (frames,) were printed with few decimals."""
    steps = np.diff(time)
    step = float(np.median(steps))
    return step > 0 and (np.abs(steps - step).max() <= 0.01 * step or _is_rounded_grid(time))


def even_grid(time: Array) -> Array | None:
    """Times (frames,) at the median step, or the mean if that is longer, from the first to the last at most.

    None where times do not increase, or where a step is longer than LONGEST_STEP and SHORT_STEP_S.
    """
    steps = np.diff(time)
    median = float(np.median(steps))
    step = max(median, float(np.mean(steps)))
    if steps.min() <= 0 or steps.max() > max(LONGEST_STEP * median, SHORT_STEP_S):
        return None
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
