"""Envelope of EMG: band-pass or high-pass filter, rectification, smoothing; all zero-phase but Seth's high-pass.

The default band is SENIAM's for surface EMG (10-20 to 500 Hz), up to 450 Hz so that 1 kHz suffices. The cut-off of
the low-pass is usually 3 to 10 Hz (Winter 2009, Biomechanics and Motor Control of Human Movement, ch. 10). PUBLISHED
is the processing of Seth, Dong, Matias and Delp (2019), Front. Neurorobot. 13:90, as Belli et al. (2023) used it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.emg.channels import UnusableEmg, bridge_gaps
from fitting.results.codes import FitErrorCode

Array = NDArray[np.float64]

RMS_BANDWIDTH = 0.6
"""A moving average over w seconds halves the amplitude at 0.6/w Hz (sin πx = πx/2 at x = 0.603)."""


@dataclass(frozen=True)
class EnvelopeSettings:
    """Filters of an envelope.

    band_hz             cut-offs of the band-pass; None as the second: a high-pass
    band_order          of the Butterworth filter, per pass
    is_band_zero_phase  forwards and backwards; otherwise forwards only
    smoothing           "low_pass": of the rectified signal, forwards and backwards; "rms": root mean square of a window
    low_pass_hz         cut-off of one pass; the amplitude there is halved by both passes together
    low_pass_order      of the Butterworth filter, per pass
    window_s            of the RMS, centred
    """

    band_hz: tuple[float, float | None] = (20.0, 450.0)
    band_order: int = 2
    is_band_zero_phase: bool = True
    smoothing: Literal["low_pass", "rms"] = "low_pass"
    low_pass_hz: float = 6.0
    low_pass_order: int = 2
    window_s: float = 0.1

    @property
    def bandwidth(self) -> float:
        """Frequency [Hz] at which the smoothing halves an amplitude."""
        return self.low_pass_hz if self.smoothing == "low_pass" else RMS_BANDWIDTH / self.window_s


LINEAR_ENVELOPE = EnvelopeSettings()
PUBLISHED = EnvelopeSettings(band_hz=(100.0, None), band_order=4, is_band_zero_phase=False, low_pass_hz=2.5)


def emg_envelope(values: Array, rate: float, settings: EnvelopeSettings = LINEAR_ENVELOPE) -> Array:
    """Envelope (n, channels) of raw EMG (n, channels) at the rate [Hz], in the unit of the raw EMG, never negative.

    Lost samples (NaN) are interpolated; `find_faults` finds gaps that are too long for it. Raises UnusableEmg for a
    band above half the rate.
    """
    low, high = settings.band_hz
    top = low if high is None else high
    if top >= rate / 2:
        raise UnusableEmg(FitErrorCode.EMG_BAND, {"highest_hz": top, "rate_hz": rate})
    kind: Literal["highpass", "bandpass"] = "highpass" if high is None else "bandpass"
    cutoffs = low if high is None else (low, high)
    band = scipy.signal.butter(settings.band_order, cutoffs, kind, fs=rate, output="sos")
    pass_band = scipy.signal.sosfiltfilt if settings.is_band_zero_phase else scipy.signal.sosfilt
    filtered = np.asarray(pass_band(band, bridge_gaps(values), axis=0), dtype=np.float64)
    if settings.smoothing == "rms":
        return _moving_rms(filtered, max(round(settings.window_s * rate), 1))
    return np.maximum(smooth(np.abs(filtered), rate, settings.low_pass_hz, settings.low_pass_order), 0.0)


def smooth(values: Array, rate: float, cutoff: float, order: int = 2) -> Array:
    """Butterworth low-pass of values (n, …) forwards and backwards, as MATLAB's filtfilt: odd padding of 3 · order."""
    b, a = scipy.signal.butter(order, cutoff, fs=rate)
    found: Array = scipy.signal.filtfilt(b, a, values, axis=0, padtype="odd", padlen=3 * order)
    return found


def _moving_rms(values: Array, window: int) -> Array:
    """Root mean square of a centred window, which is shorter at both ends of the trial."""
    total = np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(values**2, axis=0)))
    place = np.arange(len(values))
    first, last = np.maximum(place - window // 2, 0), np.minimum(place - window // 2 + window, len(values))
    return np.asarray(np.sqrt(np.maximum(total[last] - total[first], 0.0) / (last - first)[:, None]))
