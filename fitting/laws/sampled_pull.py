"""A pull smoothed and sampled on an even grid, for laws with memory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.pull.plateaus import Plateau, is_unloaded
from fitting.pull.pull import Pull
from fitting.trial.clocks import DECLARED
from fitting.trial.oscillation import Oscillation

STEP = 0.04
SWING_WINDOW, HELD_WINDOW = 0.2, 1.0
"""Smoothing windows [s] of the displacement: a parabola for a swing, a mean (no overshoot) for held loads."""
SWING_PLAY, HELD_PLAY = 1.0, 3.0
"""Play over the noise of the smoothed displacement, so that noise of a resting cuff is not a reversal of motion."""
LEAST_DECLARED_LAG_SD = 10e-3
"""Least standard uncertainty [s] of a declared lag: the choice of a law must not depend on it."""


@dataclass(frozen=True)
class SampledPull:
    """A pull on an even grid [s]: force (n,) [N], displacement (n,) [m] and velocity (n,) [m/s] without NaN.

    force      without the inertia of the cuff, and without the drift of the cell's zero if the trial determines it
    drifts     whether the trial does not determine the drift, so that the force may contain it
    force_rate (n,) [N/s], derivative of the force with respect to the lag
    lag_sd     standard uncertainty [s] of the lag of force against markers
    kept       (n,) samples that are used: held loads, or the swing
    is_held    whether the samples are held loads, of which means over seconds are used
    repeat     number of the repeat; all pulls of a repeat are left out together
    play       [m] of the play operator, above the noise of the displacement
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


def sample_pull(pull: Pull, held: Sequence[Plateau], swing: Oscillation | None) -> SampledPull:
    """Sample a pull with its held loads or its swing; hidden frames are interpolated linearly."""
    seen = np.isfinite(pull.displacement)
    frame = float(np.median(np.diff(pull.marker_time)))
    filled = np.interp(pull.marker_time, pull.marker_time[seen], pull.displacement[seen])
    is_held = swing is None
    longest = 2 * ((len(filled) - 1) // 2) + 1  # for a short record
    window = max(5, min(longest, 2 * round((HELD_WINDOW if is_held else SWING_WINDOW) / frame / 2) + 1))
    smooth = scipy.signal.savgol_filter(filled, window, 0 if is_held else 2)
    speed = scipy.signal.savgol_filter(filled, window, 2, deriv=1, delta=frame)
    step = max(STEP, float(np.median(np.diff(pull.force_time))))
    first = max(pull.force_time[0], pull.marker_time[0])
    time = np.arange(first, min(pull.force_time[-1], pull.marker_time[-1]), step)
    drift = _zero_rate(pull, held)
    force = _averaged(pull.force_time, pull.force, time, step) - (drift or 0.0) * (time - first)
    if not is_held:
        inertia = pull.trial.cuff_mass * scipy.signal.savgol_filter(filled, window, 2, deriv=2, delta=frame)
        force = force - np.interp(time, pull.marker_time, inertia)
    return SampledPull(
        time=time,
        force=force,
        drifts=drift is None,
        force_rate=np.gradient(force, step),
        lag_sd=0.0 if swing is None else _lag_sd(pull, swing),
        displacement=np.interp(time, pull.marker_time, smooth),
        velocity=np.interp(time, pull.marker_time, speed),
        kept=_kept(time, held, swing),
        is_held=is_held,
        repeat=pull.trial.repeat,
        play=(HELD_PLAY if is_held else SWING_PLAY) * _noise_left(filled - smooth, window, 0 if is_held else 2),
    )


def _zero_rate(pull: Pull, held: Sequence[Plateau]) -> float | None:
    """Drift of the cell's zero [N/s] from held loads that start and end with the bare hook; otherwise None."""
    if len(held) < 3 or not is_unloaded(held[0], held) or not is_unloaded(held[-1], held):
        return None
    ends = [(pull.force_time >= plateau.start) & (pull.force_time <= plateau.end) for plateau in (held[0], held[-1])]
    time, force = ([float(np.mean(values[end])) for end in ends] for values in (pull.force_time, pull.force))
    return (force[1] - force[0]) / (time[1] - time[0])


def _lag_sd(pull: Pull, swing: Oscillation) -> float:
    """Standard uncertainty [s] of the lag, at least LEAST_DECLARED_LAG_SD for a declared one."""
    lag = pull.trial.lag
    known = lag.total(swing.middle)
    return max(known, LEAST_DECLARED_LAG_SD) if lag.source == DECLARED else known


def _averaged(
    time: NDArray[np.float64], values: NDArray[np.float64], at: NDArray[np.float64], width: float
) -> NDArray[np.float64]:
    """Means of the values within half a width of every instant; interpolated values if there are too few."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    low, high = np.searchsorted(time, at - width / 2), np.searchsorted(time, at + width / 2)
    count = high - low
    means = (total[high] - total[low]) / np.maximum(count, 1)
    return np.where(count >= 4, means, np.interp(at, time, values))


def _kept(time: NDArray[np.float64], held: Sequence[Plateau], swing: Oscillation | None) -> NDArray[np.bool_]:
    if swing is not None:
        return np.asarray((time >= swing.start) & (time <= swing.end))
    stretches = ((time >= plateau.start) & (time <= plateau.end) for plateau in held)
    return np.asarray(sum(stretches, np.zeros(len(time), bool)))


def _noise_left(residual: NDArray[np.float64], window: int, order: int) -> float:
    """Standard deviation of white noise in the smoothed displacement, from the residual of the smoothing."""
    kept = float(scipy.signal.savgol_coeffs(window, order)[window // 2])
    removed = 1.4826 * float(np.median(np.abs(residual)))
    return removed * math.sqrt(kept / (1 - kept))
