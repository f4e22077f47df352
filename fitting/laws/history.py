"""What a cuff went through in a record, smoothed and on an even grid, for laws that remember."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from fitting.curves import TrialCurves
from fitting.static.migration import is_unloaded
from fitting.timing.clocks import DECLARED

STEP = 0.04
SWING_WINDOW, HELD_WINDOW = 0.2, 1.0
"""Seconds over which a parabola smooths a swing's displacement, a mean that of held loads: it has no overshoot."""
SWING_PLAY, HELD_PLAY = 1.0, 3.0
"""Standard deviations of the smoothed displacement that a turn must exceed to be one: a cuff at rest would seem to
turn all the time."""
DOUBTED_LAG = 10e-3
"""Seconds by which the lag may be off where no bounce measured it: a law must not hang on what was only declared."""


@dataclass(frozen=True)
class History:
    """A record on an even grid [s]: force (n,) [N], displacement (n,) [m] and velocity (n,) [m/s] without NaN.

    force      without the inertia of the cuff's mass, and the drift of the cell's zero where the trial tells it
    drifts     whether it does not: then a drift may be in the force
    force_rate (n,) [N/s], by which a lag of a second changes the force
    lag_sd     s, what is not known of the lag of force against markers
    kept       (n,) samples that count: held loads, or the swing
    is_held    whether those are held loads, of which whole seconds count
    repeat     its number; all records of one repeat are left out together
    play       m of displacement that noise crosses
    """

    time: NDArray[np.float64]
    force: NDArray[np.float64]
    drifts: bool
    force_rate: NDArray[np.float64]
    lag_sd: float
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    kept: NDArray[np.bool_]
    is_held: bool
    repeat: int
    play: float


def history_of(curves: TrialCurves) -> History:
    """The history of one used trial; hidden frames are bridged by straight lines."""
    seen = np.isfinite(curves.displacement)
    frame = float(np.median(np.diff(curves.marker_time)))
    filled = np.interp(curves.marker_time, curves.marker_time[seen], curves.displacement[seen])
    is_held = curves.dynamic is None
    longest = 2 * ((len(filled) - 1) // 2) + 1  # of a record of which little is left
    window = max(5, min(longest, 2 * round((HELD_WINDOW if is_held else SWING_WINDOW) / frame / 2) + 1))
    smooth = savgol_filter(filled, window, 0 if is_held else 2)
    speed = savgol_filter(filled, window, 2, deriv=1, delta=frame)
    step = max(STEP, float(np.median(np.diff(curves.force_time))))
    first = max(curves.force_time[0], curves.marker_time[0])
    time = np.arange(first, min(curves.force_time[-1], curves.marker_time[-1]), step)
    drift = _zero_rate(curves)
    force = _averaged(curves.force_time, curves.force, time, step) - (drift or 0.0) * (time - first)
    if not is_held:
        inertia = curves.trial.cuff_mass * savgol_filter(filled, window, 2, deriv=2, delta=frame)
        force = force - np.interp(time, curves.marker_time, inertia)
    return History(
        time=time,
        force=force,
        drifts=drift is None,
        force_rate=np.gradient(force, step),
        lag_sd=_lag_sd(curves),
        displacement=np.interp(time, curves.marker_time, smooth),
        velocity=np.interp(time, curves.marker_time, speed),
        kept=_kept(curves, time),
        is_held=is_held,
        repeat=curves.trial.repeat,
        play=(HELD_PLAY if is_held else SWING_PLAY) * _noise_left(filled - smooth, window, 0 if is_held else 2),
    )


def _zero_rate(curves: TrialCurves) -> float | None:
    """N/s by which the cell's zero drifts, from held loads that begin and end with the bare hook; None without both."""
    held = curves.static.plateaus if curves.static else ()
    if len(held) < 3 or not is_unloaded(held[0], held) or not is_unloaded(held[-1], held):
        return None
    ends = [(curves.force_time >= each.start) & (curves.force_time <= each.end) for each in (held[0], held[-1])]
    time, force = ([float(np.mean(values[end])) for end in ends] for values in (curves.force_time, curves.force))
    return (force[1] - force[0]) / (time[1] - time[0])


def _lag_sd(curves: TrialCurves) -> float:
    """Loads that are held know no lag."""
    if curves.dynamic is None:
        return 0.0
    lag = curves.trial.lag
    known = lag.total(curves.dynamic.oscillation.middle)
    return max(known, DOUBTED_LAG) if lag.source == DECLARED else known


def _averaged(
    time: NDArray[np.float64], values: NDArray[np.float64], at: NDArray[np.float64], width: float
) -> NDArray[np.float64]:
    """Means of the values within half a width of each instant; between them where there are too few."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    low, high = np.searchsorted(time, at - width / 2), np.searchsorted(time, at + width / 2)
    count = high - low
    means = (total[high] - total[low]) / np.maximum(count, 1)
    return np.where(count >= 4, means, np.interp(at, time, values))


def _kept(curves: TrialCurves, time: NDArray[np.float64]) -> NDArray[np.bool_]:
    if curves.dynamic is not None:
        swing = curves.dynamic.oscillation
        return np.asarray((time >= swing.start) & (time <= swing.end))
    held = curves.static.plateaus if curves.static else ()
    return np.asarray(sum(((time >= each.start) & (time <= each.end) for each in held), np.zeros(len(time), bool)))


def _noise_left(residual: NDArray[np.float64], window: int, order: int) -> float:
    """Standard deviation that white noise keeps in the smoothed displacement, from what smoothing took off."""
    kept = float(savgol_coeffs(window, order)[window // 2])
    removed = 1.4826 * float(np.median(np.abs(residual)))
    return removed * math.sqrt(kept / (1 - kept))
