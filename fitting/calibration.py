"""Raw force → newtons, and what the converter's codes leave unknown."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from recordings.manifest import LoadCell


def to_newtons(raw: NDArray[np.float64], cell: LoadCell) -> NDArray[np.float64]:
    """Force [N] from the device's unit, any shape. The zero stays in: every fit has a free offset."""
    return cell.polarity * cell.newtons_per_unit * raw


def code_width(raw: NDArray[np.float64]) -> float:
    """The converter's step in the unit of raw (n,): the smallest distance between values that occur.

    0 if values are so dense that no step shows (a 24-bit indicator, a recording of floats).
    """
    levels = np.unique(raw)
    if len(levels) < 2:
        return 0.0
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * np.abs(levels).max()]  # equal codes may differ by rounding of the volts
    if not len(gaps):
        return 0.0
    step = float(gaps.min())
    codes = gaps / step
    # Volts of one converter sit on one grid; noise does not.
    return step if np.all(np.abs(codes - np.round(codes)) < 0.05) else 0.0


def level_bias(step: float, scatter: float) -> float:
    """Standard uncertainty of a mean of many samples read with codes `step` wide, same unit.

    scatter is the standard deviation of the samples as read. Noise of half a code dithers the error away, a still
    signal keeps up to half a code: step/√12 · exp(−2π²(σ/step)²), the first harmonic of the staircase.
    """
    if step <= 0:
        return 0.0
    dither = max(0.0, scatter**2 - step**2 / 12)  # Sheppard: what the codes themselves add to the scatter
    return step / math.sqrt(12) * math.exp(-2 * math.pi**2 * dither / step**2)
