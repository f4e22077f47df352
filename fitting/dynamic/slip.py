"""Detect slip during the oscillation, and compute its apparent damping.

Averaged over a whole cycle, x − F/k is constant if the cuff does not slip. If it increases by s per cycle, the peak of
the force, A above its mean, does the work A s, which a damper of A s / (π ω X²) dissipates in a swing of ± X.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.trial.oscillation import Oscillation

MIN_SETTLED = 4
"""Least number of cycles without slip."""
SIGNIFICANCE = 3.0


@dataclass(frozen=True)
class Slip:
    """Slip by `distance` [m] in the first `cycles`, after which it ends if `settles`.

    damping [N s/m] is the apparent damping in the other cycles. If slip does not end, cycles is 0.
    """

    settles: bool
    cycles: int
    distance: float
    damping: float


def find_slip(
    time: NDArray[np.float64],
    offset: NDArray[np.float64],
    noise: float,
    oscillation: Oscillation,
    stiffness: float,
    negligible: float,
) -> Slip:
    """Slip in the offsets x − F/k (frames,) [m] at time [s]; noise is that of one frame [m], stiffness k [N/m].

    Slip with an apparent damping below `negligible` [N s/m] is ignored.
    """
    means, error = _cycle_means(time, offset, noise, oscillation)
    if len(means) < MIN_SETTLED:
        return Slip(settles=True, cycles=0, distance=0.0, damping=0.0)
    amplitude = oscillation.amplitude / stiffness
    apparent_damping = oscillation.amplitude / (2 * math.pi**2 * oscillation.frequency * amplitude**2)
    for first in range(len(means) - MIN_SETTLED + 1):
        slope, slope_sd = _slope(means[first:], error)
        if slope < SIGNIFICANCE * slope_sd or apparent_damping * slope < negligible:
            moved = float(np.mean(means[first:]) - means[0]) if first else 0.0
            return Slip(settles=True, cycles=first, distance=moved, damping=apparent_damping * abs(slope))
    slope, _ = _slope(means, error)
    return Slip(settles=False, cycles=0, distance=float(means[-1] - means[0]), damping=apparent_damping * slope)


def _cycle_means(
    time: NDArray[np.float64], offset: NDArray[np.float64], noise: float, oscillation: Oscillation
) -> tuple[NDArray[np.float64], float]:
    """Means of the offset over whole cycles (cycles,), and their standard deviation from differences of neighbours."""
    whole = int(oscillation.cycles)
    cycle = ((time - oscillation.start) * oscillation.frequency).astype(np.intp)
    inside = cycle < whole
    count = np.bincount(cycle[inside], minlength=whole)
    means = np.bincount(cycle[inside], offset[inside], minlength=whole) / np.maximum(count, 1)
    is_seen = count > 0.5 * count.max(initial=1)
    means = np.interp(np.arange(whole), np.flatnonzero(is_seen), means[is_seen])
    white = noise / math.sqrt(max(1.0, float(np.median(count))))
    rough = 1.4826 * float(np.median(np.abs(np.diff(means, 2)))) / math.sqrt(6) if whole > 2 else 0.0
    return means, max(white, rough)


def _slope(values: NDArray[np.float64], error: float) -> tuple[float, float]:
    """Slope of the line through values (n,) at 0, 1, …, and its standard error."""
    u = np.arange(len(values)) - (len(values) - 1) / 2
    return float(u @ values / (u @ u)), error / math.sqrt(float(u @ u))
