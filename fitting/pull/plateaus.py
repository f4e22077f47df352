"""Plateaus: stretches of steady force, with their mean force and displacement.

Comparison of the held loads with the weights of the protocol, which detects wrong settings:

    force above the bare hook = r (1 − μ d) w + b t      w: weights on the hook; d = 1 after adding, −1 after removing

r is the gain of the cell, μ the friction of a pulley as part of the load, b the drift of the zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.message import Figures
from fitting.results.sentences import Note
from fitting.results.trial_codes import TrialNoteCode
from fitting.trial.calibration import find_mistake, level_bias
from fitting.uncertainty import Estimate, normal_estimate
from recordings.standard_gravity import g

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


MAX_SCALE_ERROR = 0.03
"""Relative error of weights and hook that is tolerated."""
MAX_FRICTION = 0.03
"""Friction of a pulley, as part of the load, from which it is reported."""
MAX_STEP_ERROR = 0.25
"""Tolerated error of a single load if the others are right, as part of a weight."""
SIGNIFICANCE = 3.0
LEAST_SCALE = 0.03
"""Smallest gain of the cell; below it, no weight was added."""
BACK = 0.3
"""Part of a weight: the hook is bare again if its load is as near as this to the first load."""
SKIPPED = 0.15
"""Part of a weight, rms, by which the loads must fit better if two weights are assumed to change at once."""


@dataclass(frozen=True)
class LoadScale:
    """Scale of the load cell from the weights of the protocol.

    gain      newtons read per newton of weight
    friction  of the pulley, part of the load; None if unknown
    on        (plateaus,) number of weights on the hook
    expected  (plateaus,) N above the bare hook, with gain, friction and drift
    """

    gain: Estimate
    friction: Estimate | None
    on: NDArray[np.intp]
    expected: NDArray[np.float64]

    @property
    def is_off(self) -> bool:
        """Whether the gain differs from 1 by more than the errors of the weights explain."""
        return abs(self.gain.value - 1) > max(MAX_SCALE_ERROR, SIGNIFICANCE * self.gain.standard_error)

    @property
    def has_friction(self) -> bool:
        """Whether the friction of the pulley exceeds that of a good one."""
        mu = self.friction
        return mu is not None and abs(mu.value) > max(MAX_FRICTION, SIGNIFICANCE * mu.standard_error)


def load_scale(plateaus: Sequence[Plateau], masses: Sequence[float]) -> LoadScale | None:
    """Scale for weights [kg] that are added in this order and removed again; None if no weight was added."""
    if len(plateaus) < 2 or not masses:
        return None
    force = np.array([plateau.force for plateau in plateaus]) - plateaus[0].force
    levels = g * np.concatenate(([0.0], np.cumsum(masses)))
    if force.max() < max(LEAST_SCALE * levels[1], SIGNIFICANCE * _noise(plateaus)):
        return None
    scales = [_fitted(plateaus, force, levels, on) for on in _orders(force, levels)]
    return min(scales, key=lambda scale: _disorder(scale, force, levels))


def last_step(plateaus: Sequence[Plateau], masses: Sequence[float]) -> tuple[int, int] | None:
    """Weights that were added, and those of them that were removed again; None if the loads do not show it."""
    if len(plateaus) < 2:
        return 0, 0
    scale = load_scale(plateaus, masses)
    return (int(scale.on.max()), int(scale.on.max() - scale.on[-1])) if scale is not None else None


def check_steps(plateaus: Sequence[Plateau], masses: Sequence[float]) -> tuple[Note, ...]:
    """Notes on loads that differ from those of the weights [kg], which are added in this order and removed again."""
    if len(plateaus) < 2 or not masses:
        return ()
    weight = g * masses[0]
    fall = plateaus[0].force - min(plateau.force for plateau in plateaus)
    rise = max(plateau.force for plateau in plateaus) - plateaus[0].force
    if fall > max(2 * rise, LEAST_SCALE * weight, SIGNIFICANCE * _noise(plateaus)):
        figures = {"fall_n": fall, "mass_kg": masses[0], "weight_n": weight}
        return (Note(TrialNoteCode.LOAD_FALLS, figures),)
    scale = load_scale(plateaus, masses)
    if scale is None:
        return (Note(TrialNoteCode.NO_WEIGHT, {"weight_n": weight}),)
    notes = tuple(_setting_notes(scale, masses))
    notes += tuple(_step_notes(plateaus, scale, masses)) if not notes else ()
    if scale.on.max() < len(masses):
        notes += (Note(TrialNoteCode.FEW_WEIGHTS, {"count": int(scale.on.max()), "total": len(masses)}),)
    return notes


def _setting_notes(scale: LoadScale, masses: Sequence[float]) -> Iterator[Note]:
    gain, mu, weight = scale.gain, scale.friction, g * masses[0]
    if scale.is_off:
        figures: Figures = {
            "rise_n": gain.value * weight,
            "mass_kg": masses[0],
            "weight_n": weight,
            "gain": gain.value,
            "standard_error": gain.standard_error,
            "mistake": find_mistake(gain.value),
        }
        yield Note(TrialNoteCode.WEIGHT_GAIN, figures)
    if scale.has_friction and mu is not None:
        figures = {"hysteresis": 2 * mu.value, "friction": abs(mu.value), "standard_error": mu.standard_error}
        yield Note(TrialNoteCode.PULLEY, figures)


def _step_notes(plateaus: Sequence[Plateau], scale: LoadScale, masses: Sequence[float]) -> Iterator[Note]:
    """Notes on single wrong loads."""
    levels = g * np.concatenate(([0.0], np.cumsum(masses)))
    limit = MAX_STEP_ERROR * g * float(np.median(masses))
    for plateau, k, expected in zip(plateaus, scale.on, scale.expected, strict=True):
        read = plateau.force - plateaus[0].force
        if abs(read - levels[k]) > limit and abs(read - expected) > limit / 2:  # not a drift
            figures = {"start_s": plateau.start, "found_n": read, "expected_n": float(levels[k]), "count": int(k)}
            yield Note(TrialNoteCode.WRONG_LOAD, figures)


def _noise(plateaus: Sequence[Plateau]) -> float:
    """Standard error [N] of a load above the hook."""
    return math.sqrt(2) * float(np.median([plateau.force_sd for plateau in plateaus]))


def _orders(force: NDArray[np.float64], levels: NDArray[np.float64]) -> Iterator[NDArray[np.intp]]:
    """Candidates for the number of weights at every load: as in the protocol, one per step, or from the load."""
    most, top = len(levels) - 1, float(force.max())
    up, down = np.arange(most + 1), np.arange(most)[::-1]
    # With friction of the pulley, the load may stay or rise when the first weight is removed.
    yield from (order for order in (np.append(up, down), np.append(up, down[1:])) if len(order) == len(force))
    on = [0]
    for before, now in pairwise(force.tolist()):
        is_back = now < BACK * top / max(on[-1], 1)
        on.append(min(on[-1] + 1, most) if now > before else 0 if is_back else max(on[-1] - 1, 0))
    yield np.array(on)
    for count in range(1, most + 1):
        yield np.argmin(np.abs(force[:, None] - top / levels[count] * levels), axis=1)


def _fitted(
    plateaus: Sequence[Plateau], force: NDArray[np.float64], levels: NDArray[np.float64], on: NDArray[np.intp]
) -> LoadScale:
    """Gain, friction and drift by least squares, as far as the order of the weights distinguishes them."""
    weight = levels[on]
    is_removed = np.concatenate(([False], np.diff(on) < 0)) & (on > 0)
    middle = np.array([plateau.start + plateau.end for plateau in plateaus]) / 2
    columns = [weight]
    if is_removed.any():
        columns.append(np.where(is_removed, weight, -weight))
    if on[-1] == 0 and len(force) > len(columns) + 2:
        columns.append(middle - middle[0])
    design = np.column_stack(columns)
    solved, _, rank, _ = np.linalg.lstsq(design, force, rcond=None)
    residual = force - design @ solved
    dof = max(1, len(force) - 1 - int(rank))
    variance = max(float(residual @ residual) / dof, _noise(plateaus) ** 2)
    covariance = variance * np.linalg.pinv(design.T @ design)
    gain = normal_estimate(float(solved[0]), math.sqrt(covariance[0, 0]))
    friction = None
    if is_removed.any() and gain.value > 0:
        friction = normal_estimate(float(solved[1]) / gain.value, math.sqrt(covariance[1, 1]) / gain.value)
    return LoadScale(gain, friction, on, design @ solved)


def _disorder(scale: LoadScale, force: NDArray[np.float64], levels: NDArray[np.float64]) -> float:
    """RMS error of the loads for this order, in weights; an order that skips weights is penalised."""
    if scale.gain.value <= 0:
        return math.inf
    steps, top = np.diff(scale.on), int(scale.on.max())
    from_top = (scale.on[:-1] == top) & ((scale.on[1:] == 0) | (scale.on[1:] == top - 2))
    skips = np.count_nonzero((np.abs(steps) != 1) & ~from_top)
    off = float(np.std(force - scale.expected)) / (scale.gain.value * float(np.min(np.diff(levels))))
    return off + SKIPPED * skips
