"""Where the load is held: steady stretches of the force, and what force and displacement are there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from fitting.calibration import level_bias
from fitting.static.slow_noise import BATCH, batch_means, slow_noise

BIN = 0.05
SIDE = 1.0
"""Seconds of force on each side of a moment whose means are compared."""
MIN_STEP, STEP_PART = 3.0, 0.05
"""Newtons between the means that count as a step of the load, or this part of the force's range if that is less: the
weights may be small, or the scale wrong; six times their noise if that is more."""
SETTLING = 1.0
MARGIN = 0.5
MIN_HOLD = 1.0
TREND_SIGNIFICANCE = 3.0
LATE = 2.0


@dataclass(frozen=True)
class Plateau:
    """One held load.

    start, end           session time [s] of the stretch that was averaged
    force, force_sd      N; force_sd holds noise and what the converter's codes leave unknown
    displacement, displacement_sd  m
    late                 displacement and its uncertainty at the hold's end, [m]: where slip had (nearly) stopped
    codes                N, the part of force_sd that the converter's codes leave: the same in every trial
    """

    start: float
    end: float
    force: float
    force_sd: float
    displacement: float
    displacement_sd: float
    late: tuple[float, float]
    codes: float = 0.0


@dataclass(frozen=True)
class Step:
    """A change of the load: most of it at `time`, and the means of a second differ from `first` to `last` [s]."""

    first: float
    time: float
    last: float


def find_plateaus(
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
    force_step: float,
    marker_time: NDArray[np.float64],
    displacement: NDArray[np.float64],
    steps: Sequence[float] | None = None,
) -> tuple[Plateau, ...]:
    """The held loads of a trial in time order: force (n,) [N], displacement (frames,) [m] with NaN where not seen.

    steps are the times [s] at which the load changed where somebody knows them, None to find them.
    """
    changes = find_steps(force_time, force) if steps is None else [Step(time, time, time) for time in steps]
    holds = []
    for start, end in _steady_stretches(float(force_time[0]), float(force_time[-1]), changes):
        in_force = (force_time >= start) & (force_time <= end)
        in_frames = (marker_time >= start) & (marker_time <= end) & np.isfinite(displacement)
        if np.count_nonzero(in_force) >= 5 and np.count_nonzero(in_frames) >= 20:
            holds.append((start, end, in_force, in_frames))
    slow = slow_noise([batch_means(marker_time[seen], displacement[seen]) for *_, seen in holds])
    found = []
    for start, end, in_force, in_frames in holds:
        load, load_noise = _mean(force_time[in_force], force[in_force])
        codes = level_bias(force_step, float(np.std(force[in_force])))
        time, way = marker_time[in_frames], displacement[in_frames]
        force_sd = math.hypot(load_noise, codes)
        found.append(Plateau(start, end, load, force_sd, *_mean(time, way, slow), _at_end(time, way, slow), codes))
    return tuple(found)


def find_steps(time: NDArray[np.float64], force: NDArray[np.float64]) -> list[Step]:
    """Where the load changes in force (n,) [N] at time [s]: means of a second before and after differ by far."""
    width = max(BIN, 1.01 * float(np.median(np.diff(time))))
    index = ((time - time[0]) / width).astype(np.intp)
    count = np.bincount(index)
    middle = time[0] + width * (np.arange(len(count)) + 0.5)
    binned = np.interp(middle, middle[count > 0], np.bincount(index, force)[count > 0] / count[count > 0])
    change, roughness = _change_of_mean(median_filter(binned, 5, mode="nearest"), max(2, round(SIDE / width)))
    noise = 1.4826 * float(np.median(np.abs(change - np.median(change))))
    low, high = np.percentile(binned, [0.5, 99.5])
    is_moving = np.abs(change) > np.maximum(min(MIN_STEP, STEP_PART * float(high - low)), 6 * noise * roughness)

    bounds = np.flatnonzero(np.diff(np.concatenate(([0], is_moving.astype(np.int8), [0])))).reshape(-1, 2)
    return [
        Step(*(float(middle[i]) for i in (first, first + int(np.argmax(np.abs(change[first:last]))), last - 1)))
        for first, last in bounds
    ]


def _steady_stretches(start: float, end: float, steps: Sequence[Step]) -> list[tuple[float, float]]:
    """Stretches (start, end) [s] between steps of the load, settling and margin taken off."""
    starts = [start] + [max(step.time + SETTLING, step.last) for step in steps]
    ends = [min(step.time - MARGIN, step.first) for step in steps] + [end]
    return [(a, b) for a, b in zip(starts, ends, strict=True) if b - a >= MIN_HOLD]


def _change_of_mean(values: NDArray[np.float64], side: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of the next `side` values minus mean of those before, and how much rougher for being of fewer at the ends.

    Both are (n,).
    """
    total = np.concatenate(([0.0], np.cumsum(values)))
    here = np.arange(len(values) + 1)[1:-1]
    before, after = np.maximum(here - side, 0), np.minimum(here + side, len(values))
    change = (total[after] - total[here]) / (after - here) - (total[here] - total[before]) / (here - before)
    roughness = np.sqrt((1 / (after - here) + 1 / (here - before)) * side / 2)
    return np.concatenate(([0.0], change)), np.concatenate(([1.0], roughness))


def _mean(time: NDArray[np.float64], values: NDArray[np.float64], slow: float = 0.0) -> tuple[float, float]:
    """Mean and its standard error from the means of half seconds: noise may be coloured, and holds may creep.

    slow is the error [s^½ times the values' unit] of a mean over a second as all holds tell it, where they do.
    """
    white = float(np.std(values, ddof=1)) / math.sqrt(len(values))
    means = batch_means(time, values)
    batched = float(np.std(means, ddof=1)) / math.sqrt(len(means)) if len(means) >= 4 else 0.0
    return float(np.mean(values)), max(white, batched, slow / math.sqrt(BATCH * len(means)))


def _at_end(time: NDArray[np.float64], values: NDArray[np.float64], slow: float) -> tuple[float, float]:
    """The value reached at the end of a hold, and its uncertainty: the last seconds, led on if they still move."""
    is_last = time >= time[-1] - LATE
    time, values = time[is_last], values[is_last]
    half = (time[-1] - time[0]) / 2
    slope, mean = np.polyfit(time - time.mean(), values, 1)
    _, error = _mean(time, values - slope * (time - time.mean()), slow)
    if abs(slope) * half < TREND_SIGNIFICANCE * math.sqrt(3) * error:
        return float(mean), error
    return float(mean + slope * half), math.hypot(2 * error, slope * half / 2)
