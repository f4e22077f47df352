"""Find the oscillation of the force in a dynamic trial, and its frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode

BIN = 0.05
WINDOW = 2.0
"""Seconds over which the standard deviation of the force is computed."""
TRANSIENT = 1.5
"""Seconds left out at both ends, in which the weight is added or removed."""


@dataclass(frozen=True)
class Oscillation:
    """The stretch from start to end [s] in which the force oscillates at `frequency` [Hz] with `amplitude` [N]."""

    start: float
    end: float
    frequency: float
    amplitude: float

    @property
    def middle(self) -> float:
        """Session time [s]."""
        return (self.start + self.end) / 2

    @property
    def cycles(self) -> float:
        return self.frequency * (self.end - self.start)


def find_oscillation(time: NDArray[np.float64], force: NDArray[np.float64]) -> Oscillation:
    """The longest stretch of force (n,) [N] at time [s] that oscillates. Raises UnusableTrial without one."""
    width = max(BIN, 1.01 * float(np.median(np.diff(time))))
    grid = np.arange(time[0], time[-1], width)
    side = round(WINDOW / 2 / width)
    if len(grid) < 4 * side:
        raise UnusableTrial(RejectionCode.SHORT, {"duration_s": float(time[-1] - time[0])})
    index = np.minimum(((time - time[0]) / width).astype(np.intp), len(grid) - 1)
    count = np.bincount(index, minlength=len(grid))
    means = np.bincount(index, force, minlength=len(grid))[count > 0] / count[count > 0]
    binned = np.interp(grid, grid[count > 0], means)
    swing = _moving_deviation(binned, side)
    is_swinging = swing > 0.5 * float(np.percentile(swing, 75))
    if not is_swinging.any():
        raise UnusableTrial(RejectionCode.NO_SWING)
    bounds = np.flatnonzero(np.diff(np.concatenate(([0], is_swinging.astype(np.int8), [0])))).reshape(-1, 2)
    first, last = bounds[np.argmax(bounds[:, 1] - bounds[:, 0])]
    start, end = float(grid[first]), float(grid[last - 1])
    start = time[0] if first == 0 else start + TRANSIENT
    end = time[-1] if last == len(grid) else end - TRANSIENT
    inside = binned[(grid >= start) & (grid <= end)]
    if len(inside) < 4 * side:
        raise UnusableTrial(RejectionCode.NO_SWING)
    return Oscillation(float(start), float(end), *_main_swing(inside, width))


def _moving_deviation(values: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """Moving standard deviation (n,) over `side` values on both sides, fewer at the ends."""
    centred = values - values.mean()
    sums = np.concatenate(([[0.0, 0.0]], np.cumsum(np.column_stack((centred, centred**2)), axis=0)))
    here = np.arange(len(values))
    low, high = np.maximum(here - side, 0), np.minimum(here + side + 1, len(values))
    mean, square = ((sums[high] - sums[low]) / (high - low)[:, None]).T
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0.0)))


def _main_swing(values: NDArray[np.float64], width: float) -> tuple[float, float]:
    """Frequency [Hz] of the spectral maximum, and √2 × standard deviation as amplitude."""
    straight = np.polyval(np.polyfit(np.arange(len(values)), values, 1), np.arange(len(values)))
    swing = values - straight
    spectrum = np.abs(np.fft.rfft(swing * np.hanning(len(swing)), 4 * len(swing)))
    frequency = float(np.fft.rfftfreq(4 * len(swing), width)[np.argmax(spectrum)])
    return frequency, float(np.sqrt(2) * np.std(swing))
