"""Plateaus: stretches of steady force, with their mean force and displacement."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.trial.calibration import level_bias

BIN = 0.05
SIDE, SHORT_SIDE = 1.0, 0.5
"""Seconds of force before and after an instant whose means are compared; the shorter one where holds are short."""
CROWDED = 2.5
"""Length of a change over SIDE from which it may contain several steps."""
MIN_STEP, STEP_PART = 3.0, 0.05
"""Smallest step of the load [N], or part of the force's range if that is less, as the weights may be small or the scale
wrong. A step must also exceed six times the noise."""
SETTLING, MARGIN, MIN_HOLD = 1.0, 0.5, 1.0
"""Seconds left out after a step and before the next, and least ones in between."""
FULL_HOLD = SETTLING + MARGIN + MIN_HOLD
SHORT_HOLD, SHORT_PART, SHORT_STRETCH = 1.0, 0.5, 0.25
"""In a hold shorter than FULL_HOLD, SETTLING and MARGIN are shorter in proportion, and SHORT_STRETCH [s] suffices.
Below SHORT_HOLD [s], or SHORT_PART of the trial's median hold, the load is not held but still being changed."""
TREND_SIGNIFICANCE = 3.0
LATE = 2.0
UNLOADED, MIN_TOLERANCE = 0.1, 3.0
"""A plateau is unloaded if its force is within this part of the load range, or 3 N, of the lowest."""
SAME_LOAD = 0.3
"""Newtons by which loads of the same weights may differ."""


@dataclass(frozen=True)
class Plateau:
    """One held load.

    start, end           session time [s] of the stretch that was averaged
    force, force_sd      N; force_sd includes noise and quantisation
    displacement, displacement_sd  m
    late                 displacement [m] and its standard error at the end of the hold, when slip has almost stopped
    codes                N, the part of force_sd due to quantisation, common to all trials
    step                 session time [s] of the change of load before it, None for the first
    hold                 s between the changes of load before and after it, or the ends of the record
    """

    start: float
    end: float
    force: float
    force_sd: float
    displacement: float
    displacement_sd: float
    late: tuple[float, float]
    codes: float = 0.0
    step: float | None = None
    hold: float = math.inf

    @property
    def unsettled(self) -> float:
        """Distance [m] from the mean to the end of a hold that is too short for the cuff to rest; 0 in others."""
        return self.late[0] - self.displacement if self.hold < FULL_HOLD else 0.0


@dataclass(frozen=True)
class Step:
    """A change of the load: steepest at `time` [s], detected from `first` to `last` [s]."""

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
    """The held loads of a trial in time order: force (n,) [N], displacement (frames,) [m], NaN if not seen.

    steps are the times [s] at which the load changed, None to detect them.
    """
    changes = find_steps(force_time, force) if steps is None else [Step(time, time, time) for time in steps]
    least_step = _least_step(force)
    holds = []
    for stretch in _steady_stretches(float(force_time[0]), float(force_time[-1]), changes):
        in_force = (force_time >= stretch.start) & (force_time <= stretch.end)
        in_frames = (marker_time >= stretch.start) & (marker_time <= stretch.end) & np.isfinite(displacement)
        if np.count_nonzero(in_force) < 5 or not _is_seen_to_its_end(marker_time[in_frames]):
            continue
        if steps is not None or _is_steady(force[in_force], least_step):
            holds.append((stretch, in_force, in_frames))
    slow = slow_noise([batch_means(marker_time[seen], displacement[seen]) for *_, seen in holds])
    found = []
    for stretch, in_force, in_frames in holds:
        load, load_noise = _mean(force_time[in_force], force[in_force])
        codes = level_bias(force_step, float(np.std(force[in_force])))
        time, place = marker_time[in_frames], displacement[in_frames]
        found.append(
            Plateau(
                stretch.start,
                stretch.end,
                load,
                math.hypot(load_noise, codes),
                *_mean(time, place, slow),
                _at_end(time, place, slow),
                codes,
                stretch.step,
                stretch.hold,
            )
        )
    return tuple(found)


def find_steps(time: NDArray[np.float64], force: NDArray[np.float64]) -> list[Step]:
    """Steps of the load in force (n,) [N] at time [s]: the means over SIDE before and after differ.

    If holds are so short that a SIDE reaches over two steps, SHORT_SIDE is used.
    """
    width = max(BIN, 1.01 * float(np.median(np.diff(time))))
    index = ((time - time[0]) / width).astype(np.intp)
    count = np.bincount(index)
    middle = time[0] + width * (np.arange(len(count)) + 0.5)
    binned = np.interp(middle, middle[count > 0], np.bincount(index, force)[count > 0] / count[count > 0])
    found = _steps(middle, binned, width, SIDE)
    is_crowded = any(step.last - step.first > CROWDED for step in found)
    if not is_crowded and all(after.first - before.last >= MIN_HOLD for before, after in pairwise(found)):
        return found
    finer = _steps(middle, binned, width, SHORT_SIDE)
    return finer if len(finer) >= len(found) else found


def is_unloaded(plateau: Plateau, loads: Sequence[Plateau]) -> bool:
    """Whether a plateau is that of the bare hook, compared with all loads of the trial."""
    forces = [plateau.force for plateau in loads]
    return plateau.force <= min(forces) + max(UNLOADED * (max(forces) - min(forces)), MIN_TOLERANCE)


def _steps(middle: NDArray[np.float64], binned: NDArray[np.float64], width: float, side: float) -> list[Step]:
    """Steps in force (bins,) [N], whose means over `side` [s] before and after differ by more than limit and noise.

    Between two steps the difference falls below half of this. The noise is that of the sensor, from second differences:
    with short holds, most bins are near a step.
    """
    change, roughness = _change_of_mean(
        scipy.ndimage.median_filter(binned, 5, mode="nearest"), max(2, round(side / width))
    )
    noise = float(np.median(np.abs(np.diff(binned, 2)))) / 0.6745 / math.sqrt(6) * math.sqrt(2 * width / side)
    size = np.abs(change) / np.maximum(_least_step(binned), 6 * noise * roughness)
    regions, count = scipy.ndimage.label(size > 0.5)
    runs = [np.flatnonzero((regions == region + 1) & (size > 1)) for region in range(count)]
    return [
        Step(float(middle[run[0]]), float(middle[run[np.argmax(size[run])]]), float(middle[run[-1]]))
        for run in runs
        if len(run)
    ]


def _least_step(force: NDArray[np.float64]) -> float:
    """Smallest change of the load [N] that counts as a step."""
    low, high = np.percentile(force, [0.5, 99.5])
    return min(MIN_STEP, STEP_PART * float(high - low))


def _is_steady(force: NDArray[np.float64], least_step: float) -> bool:
    """Whether the quarters of a hold have the same force (n,) [N]: in others, a step was not found."""
    quarters = np.array_split(force, 4)
    noise = math.sqrt(2 * float(np.mean([np.var(quarter) / len(quarter) for quarter in quarters])))
    return bool(np.ptp([quarter.mean() for quarter in quarters]) <= max(least_step, 6 * noise))


@dataclass(frozen=True)
class _Stretch:
    """Steady force from start to end [s], in a hold of so many seconds after the step [s], None for the first."""

    start: float
    end: float
    step: float | None
    hold: float


def _steady_stretches(start: float, end: float, steps: Sequence[Step]) -> Iterator[_Stretch]:
    """Stretches between steps of the load in a record from start to end [s], without settling time and margin."""
    times = [start, *(step.time for step in steps), end]
    holds = np.diff(times)
    shortest = max(SHORT_HOLD, SHORT_PART * float(np.median(holds[1:-1]))) if len(holds) > 2 else SHORT_HOLD
    for i, hold in enumerate(holds.tolist()):
        before, after = steps[i - 1] if i else None, steps[i] if i < len(steps) else None
        if before and after and hold < shortest:
            continue
        part = min(1.0, hold / FULL_HOLD)
        first = max(before.time + part * SETTLING, before.last) if before else start
        last = min(after.time - part * MARGIN, after.first) if after else end
        if last - first >= (MIN_HOLD if part == 1.0 else SHORT_STRETCH):
            yield _Stretch(first, last, before.time if before else None, hold)


def _change_of_mean(values: NDArray[np.float64], side: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of the next `side` values minus mean of the previous ones, and its relative noise, (n,) each.

    At the ends there are fewer values, so the noise is larger.
    """
    total = np.concatenate(([0.0], np.cumsum(values)))
    here = np.arange(len(values) + 1)[1:-1]
    before, after = np.maximum(here - side, 0), np.minimum(here + side, len(values))
    change = (total[after] - total[here]) / (after - here) - (total[here] - total[before]) / (here - before)
    roughness = np.sqrt((1 / (after - here) + 1 / (here - before)) * side / 2)
    return np.concatenate(([0.0], change)), np.concatenate(([1.0], roughness))


def _mean(time: NDArray[np.float64], values: NDArray[np.float64], slow: float = 0.0) -> tuple[float, float]:
    """Mean and its standard error from the means of half seconds, as noise may be coloured and holds may creep.

    slow is the error of a mean over one second, estimated from all holds [s^½ × unit of the values]; 0 if unknown.
    """
    white = float(np.std(values, ddof=1)) / math.sqrt(len(values))
    means = batch_means(time, values)
    batched = float(np.std(means, ddof=1)) / math.sqrt(len(means)) if len(means) >= 4 else 0.0
    return float(np.mean(values)), max(white, batched, slow / math.sqrt(BATCH * len(means)))


def _is_seen_to_its_end(time: NDArray[np.float64]) -> bool:
    """Whether the frames of a hold suffice for its mean and, in its last seconds, for the value at its end."""
    return len(time) >= 20 and int(np.count_nonzero(time >= time[-1] - LATE)) >= 5


def _at_end(time: NDArray[np.float64], values: NDArray[np.float64], slow: float) -> tuple[float, float]:
    """The value at the end of a hold and its standard error: mean of the last seconds, extrapolated if it changes."""
    is_last = time >= time[-1] - LATE
    time, values = time[is_last], values[is_last]
    half = (time[-1] - time[0]) / 2
    slope, mean = np.polyfit(time - time.mean(), values, 1)
    _, error = _mean(time, values - slope * (time - time.mean()), slow)
    if abs(slope) * half < TREND_SIGNIFICANCE * math.sqrt(3) * error:
        return float(mean), error
    return float(mean + slope * half), math.hypot(2 * error, slope * half / 2)


BATCH = 0.5
"""Seconds."""
LONG_HOLD = 6
"""Half seconds of a hold from which the correlation of their noise is estimated."""
CORRELATED = 2.0
"""Standard errors from which a correlation of neighbours is significant."""
CORRELATIONS = np.linspace(0.0, 0.7, 15)


def batch_means(time: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of values (n,) at time (n,) [s] over half seconds, without half seconds that have few samples."""
    batch = ((time - time[0]) / BATCH).astype(np.intp)
    count = np.bincount(batch)
    return np.asarray((np.bincount(batch, values) / np.maximum(count, 1))[count > 0.5 * count.max()])


def slow_noise(holds: Sequence[NDArray[np.float64]]) -> float:
    """Standard error of a mean over one second, from the half-second means of all holds; a single hold has too few.

    A parabola, which may be creep, is removed from every hold. The correlation r of neighbours and the variance v of
    first-order autoregressive noise are fitted to the residuals by moments; the same parabolas are removed from the
    expected moments. Means of such noise have the variance v (1 + r) / (1 - r) / n. 0 for fewer than two long holds.
    """
    long = [means for means in holds if len(means) >= LONG_HOLD]
    if len(long) < 2:
        return 0.0
    projectors = [_without_parabola(len(means)) for means in long]
    residuals = [projector @ means for projector, means in zip(projectors, long, strict=True)]
    squares = sum(float(residual @ residual) for residual in residuals)
    products = sum(float(residual[1:] @ residual[:-1]) for residual in residuals)
    expected = np.array([_moments(projectors, r) for r in CORRELATIONS])
    if squares == 0:
        return 0.0
    pairs = sum(len(means) - 1 for means in long)
    ratio = products / squares
    if ratio - expected[0, 1] / expected[0, 0] < CORRELATED / math.sqrt(pairs):
        ratio = expected[0, 1] / expected[0, 0]
    r = float(np.interp(ratio, expected[:, 1] / expected[:, 0], CORRELATIONS))
    variance = squares / float(np.interp(r, CORRELATIONS, expected[:, 0]))
    return math.sqrt(BATCH * variance * (1 + r) / (1 - r))


def _without_parabola(count: int) -> NDArray[np.float64]:
    basis, _ = np.linalg.qr(np.vander(np.arange(count), 3))
    return np.asarray(np.eye(count) - basis @ basis.T)


def _moments(projectors: Sequence[NDArray[np.float64]], r: float) -> tuple[float, float]:
    """Expected sums of squares and of products of neighbours, for noise of variance 1 without parabolas."""
    covariances = [
        projector @ r ** np.abs(np.subtract.outer(*2 * [np.arange(len(projector))])) @ projector
        for projector in projectors
    ]
    squares = sum(float(np.trace(covariance)) for covariance in covariances)
    return squares, sum(float(np.trace(covariance, 1)) for covariance in covariances)
