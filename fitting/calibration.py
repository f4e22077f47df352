"""Raw force → newtons, what the converter's codes leave unknown, and what bounce trials say of the load cell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g

from fitting.uncertainty import Estimate
from recordings.manifest import DataOrigin, LoadCell

MAX_GAIN_ERROR = 0.05
"""A load cell that is off by more is not out of calibration: a setting or a weight is wrong, and gain stays alone."""


@dataclass(frozen=True)
class Calibration:
    """What the bounce trials of a session say of the load cell and of time.

    lag      [s] a force sample stamped t was taken at t + lag by the markers' clock
    gain     newtons read for one newton, against the configured scale
    zero     [N] read where nothing hangs on the cell
    middle   [s] session time for which the lag was found
    recorded_utc_ns  host's UTC at the arming of the newest: how old the calibration is
    sources  file → SHA-256
    origin   measured or simulated
    notes    what a reader should know
    """

    lag: Estimate
    gain: Estimate
    zero: Estimate
    middle: float
    recorded_utc_ns: int
    sources: Mapping[str, str]
    notes: tuple[str, ...] = ()
    origin: DataOrigin = DataOrigin.UNKNOWN

    @property
    def is_gain_believed(self) -> bool:
        return abs(self.gain.value - 1) <= MAX_GAIN_ERROR

    def gain_with(self, certificate_sd: float) -> tuple[float, float]:
        """The gain by which force is to be divided, and its relative standard uncertainty.

        certificate_sd is that of the configured scale, 0 where no certificate says any.
        """
        if not self.is_gain_believed:
            return 1.0, certificate_sd
        sd = self.gain.standard_error / self.gain.value
        if certificate_sd == 0:
            return self.gain.value, sd
        weight = certificate_sd**2 / (certificate_sd**2 + sd**2)
        return 1 + weight * (self.gain.value - 1), math.sqrt(weight) * sd


POUND = 4.4482216152605
MISTAKES = {
    2.0: "as if load_cell.capacity_kg were twice the cell's",
    0.5: "as if load_cell.capacity_kg were half the cell's",
    10.0: "as if load_cell.capacity_kg were ten times the cell's",
    0.1: "as if load_cell.capacity_kg were a tenth of the cell's",
    25 * POUND / g / 10: "as if the cell were one of 25 lb and not of 10 kg, or the reverse",
    10 * POUND / g / 10: "as if pounds were taken for kilograms",
    g / POUND: "as if kilograms were taken for pounds",
    POUND: "as if newtons were taken for pounds",
    1 / POUND: "as if pounds were taken for newtons",
    g: "as if newtons were taken for kilograms",
    1 / g: "as if kilograms were taken for newtons",
}
"""Force read over force exerted → how that happens."""


MISTAKE_REACH = 0.03
"""How far (relative) a ratio may be from a mistake's: what weights and a sound cell may be off by together."""


def blame(ratio: float) -> str:
    """What mistake reads `ratio` newtons for one, in words."""
    likely = min(MISTAKES, key=lambda known: abs(math.log(abs(ratio) / known)))
    if abs(math.log(abs(ratio) / likely)) < MISTAKE_REACH:
        return MISTAKES[likely]
    return "which no common mistake explains; check load_cell.capacity_kg, full_scale_v and the weights"


def to_newtons(raw: NDArray[np.float64], cell: LoadCell) -> NDArray[np.float64]:
    """Force [N] from the device's unit, any shape. The zero stays in: every fit has a free offset."""
    return cell.polarity * cell.newtons_per_unit * raw


def full_scale(cell: LoadCell, converter: float) -> float:
    """The largest reading that is a measurement: the converter's full scale or the cell's capacity, in its unit.

    Beyond its capacity no certificate holds, and an amplifier is near its own end; inf where neither is known.
    """
    capacity = math.inf if cell.capacity_kg is None else cell.capacity_kg * g / cell.newtons_per_unit
    return min(converter, capacity)


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
