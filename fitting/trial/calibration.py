"""Calibration of the load cell: raw force to newtons, faulty samples, quantisation error, results of bounce trials."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from documents.message import Code, Figures
from fitting.errors import UnusableTrial
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.uncertainty import Estimate
from recordings.manifest import DataOrigin, LoadCell
from recordings.standard_gravity import g

MAX_GAIN_ERROR = 0.05
"""A larger error of the gain indicates a wrong setting or weight, not a drifted cell; the gain is then not used."""


class GainMistake(Code, prefix="gain_mistake."):
    """A common mistake in the scale of the load cell."""

    CAPACITY_DOUBLED = "as if the configured capacity were twice the cell's"
    CAPACITY_HALVED = "as if the configured capacity were half the cell's"
    CAPACITY_TENFOLD = "as if the configured capacity were ten times the cell's"
    CAPACITY_TENTH = "as if the configured capacity were a tenth of the cell's"
    CAPACITY_25_LB = "gain_mistake.cell_of_25_lb", "as if the cell were one of 25 lb and not of 10 kg, or the reverse"
    POUNDS_FOR_KILOGRAMS = "as if pounds were taken for kilograms"
    KILOGRAMS_FOR_POUNDS = "as if kilograms were taken for pounds"
    NEWTONS_FOR_POUNDS = "as if newtons were taken for pounds"
    POUNDS_FOR_NEWTONS = "as if pounds were taken for newtons"
    NEWTONS_FOR_KILOGRAMS = "as if newtons were taken for kilograms"
    KILOGRAMS_FOR_NEWTONS = "as if kilograms were taken for newtons"
    MILLINEWTONS_FOR_NEWTONS = "as if millinewtons were taken for newtons, or grams for kilograms"
    UNKNOWN = "which no common mistake explains; check capacity and full scale of the cell, and the weights"


@dataclass(frozen=True)
class Calibration:
    """Result of the bounce trials of a session.

    lag      [s] a force sample stamped t was taken at t + lag by the markers' clock
    gain     newtons read per newton, with the configured scale
    zero     [N] reading of the unloaded cell
    middle   [s] session time for which the lag was determined
    recorded_utc_ns  UTC of the host when the newest was armed, which gives the age of the calibration
    sources  file → SHA-256
    origin   measured or simulated
    notes    remarks on the bounces
    """

    lag: Estimate
    gain: Estimate
    zero: Estimate
    middle: float
    recorded_utc_ns: int
    sources: Mapping[str, str]
    notes: tuple[Note, ...] = ()
    origin: DataOrigin = DataOrigin.UNKNOWN

    @property
    def is_gain_used(self) -> bool:
        return abs(self.gain.value - 1) <= MAX_GAIN_ERROR

    def gain_with(self, certificate_sd: float) -> tuple[float, float]:
        """The gain by which force is divided, and its relative standard uncertainty.

        It is the weighted mean of the bounces and the certificate, whose gain is 1 ± certificate_sd (0: unknown).
        """
        if not self.is_gain_used:
            return 1.0, certificate_sd
        sd = self.gain.standard_error / self.gain.value
        if certificate_sd == 0:
            return self.gain.value, sd
        weight = certificate_sd**2 / (certificate_sd**2 + sd**2)
        return 1 + weight * (self.gain.value - 1), math.sqrt(weight) * sd


POUND = 4.4482216152605
MISTAKES = {
    2.0: GainMistake.CAPACITY_DOUBLED,
    0.5: GainMistake.CAPACITY_HALVED,
    10.0: GainMistake.CAPACITY_TENFOLD,
    0.1: GainMistake.CAPACITY_TENTH,
    25 * POUND / g / 10: GainMistake.CAPACITY_25_LB,
    10 * POUND / g / 10: GainMistake.POUNDS_FOR_KILOGRAMS,
    g / POUND: GainMistake.KILOGRAMS_FOR_POUNDS,
    POUND: GainMistake.NEWTONS_FOR_POUNDS,
    1 / POUND: GainMistake.POUNDS_FOR_NEWTONS,
    g: GainMistake.NEWTONS_FOR_KILOGRAMS,
    1 / g: GainMistake.KILOGRAMS_FOR_NEWTONS,
    1000.0: GainMistake.MILLINEWTONS_FOR_NEWTONS,
}
"""Force read over true force → mistake."""
MISTAKE_REACH = 0.03
"""Tolerance of the ratio (relative), for errors of the weights and of a correct cell."""


def find_mistake(ratio: float) -> GainMistake:
    """The mistake with which the cell reads `ratio` newtons per newton."""
    likely = min(MISTAKES, key=lambda known: abs(math.log(abs(ratio) / known)))
    return MISTAKES[likely] if abs(math.log(abs(ratio) / likely)) < MISTAKE_REACH else GainMistake.UNKNOWN


def to_newtons(raw: NDArray[np.float64], cell: LoadCell) -> NDArray[np.float64]:
    """Force [N] from the device's unit, any shape. The zero is not removed, because every fit has a free offset."""
    return cell.polarity * cell.newtons_per_unit * raw


SPIKE_NEIGHBOURS, SPIKE_RATE_HZ = 5, 40.0
"""Samples whose median a spike of one or two samples does not change, and the rate above which no load is so short."""
SPIKE_NOISE, SPIKE_PART, SPIKE_N = 10.0, 0.5, 5.0
"""Least distance of a spike from this median: in median distances, as part of the range of the medians, and [N]."""
MOST_SPIKES = 0.02


def find_spikes(force: NDArray[np.float64], rate_hz: float) -> NDArray[np.float64]:
    """Height (n,) [N] of the spikes in finite force (n,) [N] above or below the samples around; 0 for the others.

    A spike lasts for one or two samples; its cause is a loose contact or interference.

    Raises UnusableTrial if they are more than MOST_SPIKES of the samples.
    """
    if len(force) < SPIKE_NEIGHBOURS or rate_hz < SPIKE_RATE_HZ:
        return np.zeros(len(force))
    padded = np.pad(force, SPIKE_NEIGHBOURS // 2, mode="reflect")  # mode="edge" would hide a spike in an end sample
    median = np.median(sliding_window_view(padded, SPIKE_NEIGHBOURS), axis=1)
    apart = np.abs(force - median)
    low, high = np.percentile(median, [0.5, 99.5])
    is_spike = apart > max(SPIKE_NOISE * float(np.median(apart)), SPIKE_PART * float(high - low), SPIKE_N)
    spikes = np.where(is_spike, apart, 0.0)
    if np.mean(is_spike) > MOST_SPIKES:
        raise UnusableTrial(RejectionCode.FORCE_SPIKES, _spike_figures(spikes))
    return spikes


def spike_notes(spikes: NDArray[np.float64]) -> tuple[Note, ...]:
    """A note if samples of a trial were left out as spikes, from the heights (n,) [N] of find_spikes."""
    return (Note(TrialNoteCode.FORCE_SPIKES, _spike_figures(spikes)),) if spikes.any() else ()


def _spike_figures(spikes: NDArray[np.float64]) -> Figures:
    return {"count": int(np.count_nonzero(spikes)), "total": len(spikes), "most_n": float(spikes.max())}


def require_sound_force(values: NDArray[np.float64], limit: float, unit: str = "V") -> None:
    """Raise UnusableTrial for invalid, saturated or constant force samples (n,), in the device's unit.

    limit is the largest valid reading, inf if unknown.
    """
    total = len(values)
    broken = int(np.count_nonzero(~np.isfinite(values)))
    if broken:
        raise UnusableTrial(RejectionCode.FORCE_NOT_FINITE, {"count": broken, "total": total})
    saturated = int(np.count_nonzero(np.abs(values) >= 0.99 * limit))
    if saturated > 3:  # one or two samples at full scale are an electrical spike, not a load
        figures: Figures = {"count": saturated, "total": total, "limit": limit, "unit": unit}
        raise UnusableTrial(RejectionCode.FORCE_SATURATED, figures)
    if total and np.all(values == values[0]):
        raise UnusableTrial(RejectionCode.FORCE_CONSTANT, {"value": float(values[0]), "total": total})


def full_scale(cell: LoadCell, converter: float) -> float:
    """The largest valid reading: the full scale of the converter or the capacity of the cell, in the device's unit.

    The certificate is not valid beyond the capacity. inf if neither is known.
    """
    capacity = math.inf if cell.capacity_kg is None else cell.capacity_kg * g / cell.newtons_per_unit
    return min(converter, capacity)


def code_width(raw: NDArray[np.float64]) -> float:
    """Quantisation step of the converter in the unit of raw (n,): the smallest difference between its values.

    0 if the values are too dense to show a step (a 24-bit indicator, a recording of floats).
    """
    levels = np.unique(raw)
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * np.abs(levels).max(initial=0.0)]  # equal codes may differ by rounding of the volts
    if not len(gaps):
        return 0.0
    step = float(gaps.min())
    codes = gaps / step
    # Values of a converter are multiples of its step; noise is not.
    return step if np.all(np.abs(codes - np.round(codes)) < 0.05) else 0.0


def level_bias(step: float, scatter: float) -> float:
    """Standard uncertainty of a mean of many samples due to quantisation with `step`, same unit.

    scatter is the standard deviation of the samples as read. Noise of half a step removes the error by dithering; a
    constant signal may be off by half a step: step/√12 · exp(−2π²(σ/step)²), first harmonic of the quantiser.
    """
    if step <= 0:
        return 0.0
    dither = max(0.0, scatter**2 - step**2 / 12)  # Sheppard's correction for the quantisation
    return step / math.sqrt(12) * math.exp(-2 * math.pi**2 * dither / step**2)
