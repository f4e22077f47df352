"""Raw EMG of a trial → envelopes of its channels, normalised where a maximum voluntary contraction (MVC) is known.

An envelope is a band-pass or high-pass filter, rectification and smoothing; all zero-phase but Seth's high-pass. The
default band is SENIAM's for surface EMG (10-20 to 500 Hz), up to 450 Hz so that 1 kHz suffices. The cut-off of the
low-pass is usually 3 to 10 Hz (Winter 2009, Biomechanics and Motor Control of Human Movement, ch. 10). PUBLISHED is the
processing of Seth, Dong, Matias and Delp (2019), Front. Neurorobot. 13:90, as Belli et al. (2023) used it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.emg.channels import UNUSABLE, ChannelFinding, UnusableEmg, bridge_gaps, find_faults
from fitting.results.codes import FitErrorCode
from recordings.manifest import DataOrigin


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


MVC_WINDOW_S = 0.5
"""A contraction lasts seconds; the largest mean over half a second is not a spike."""


Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EmgTrial:
    """Raw EMG: values (n, channels), NaN where a sample was lost; start [s] on the trial's clock, rate [Hz].

    unit is "V", or "" if not known; cycles are (start, end) [s] of the arm cycles, if known; unread are further
    channels of the file, in another unit or on another clock.
    """

    name: str
    labels: tuple[str, ...]
    start: float
    rate: float
    values: Array
    unit: str
    origin: DataOrigin = DataOrigin.UNKNOWN
    cycles: tuple[tuple[float, float], ...] = ()
    unread: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class EmgEnvelopes:
    """Envelopes (n, channels) from start [s] at the rate [Hz]; NaN in an unusable channel.

    unit      "1" if normalised, otherwise that of the raw EMG
    findings  by channel
    unread    further channels of the file
    """

    name: str
    labels: tuple[str, ...]
    start: float
    rate: float
    values: Array
    unit: str
    findings: Mapping[str, tuple[ChannelFinding, ...]]
    origin: DataOrigin = DataOrigin.UNKNOWN
    cycles: tuple[tuple[float, float], ...] = ()
    unread: tuple[str, ...] = ()

    @property
    def time(self) -> Array:
        """(n,) [s]."""
        return self.start + np.arange(len(self.values)) / self.rate

    @property
    def usable(self) -> tuple[str, ...]:
        """Channels with an envelope."""
        return tuple(label for label in self.labels if np.isfinite(self.of(label)).all())

    def of(self, label: str) -> Array:
        """(n,)."""
        values: Array = self.values[:, self.labels.index(label)]
        return values

    def means(self, label: str, start: float = -np.inf, end: float = np.inf) -> list[float]:
        """Mean of the envelope: by cycle between start and end [s], or of the whole interval without cycles."""
        spans = [(first, last) for first, last in self.cycles if first >= start and last <= end] or [(start, end)]
        time, values = self.time, self.of(label)
        return [float(values[(time >= first) & (time <= last)].mean()) for first, last in spans]


def compute_envelopes(
    trial: EmgTrial, settings: EnvelopeSettings = LINEAR_ENVELOPE, minimum_subtracted: Collection[str] = ()
) -> EmgEnvelopes:
    """Check the channels, and compute the envelopes of the usable ones.

    minimum_subtracted are channels whose minimum is subtracted. Raises UnusableEmg if no channel is usable.
    """
    findings = dict(zip(trial.labels, find_faults(trial.values, trial.rate), strict=True))
    usable = [i for i, label in enumerate(trial.labels) if not UNUSABLE & set(findings[label])]
    if not usable:
        found = ", ".join(f"{label} {' '.join(codes)}" for label, codes in findings.items())
        raise UnusableEmg(FitErrorCode.EMG_NO_CHANNEL, {"trial": trial.name, "findings": found})
    values = np.full(trial.values.shape, np.nan)
    values[:, usable] = emg_envelope(trial.values[:, usable], trial.rate, settings)
    subtracted = [i for i in usable if trial.labels[i] in minimum_subtracted]
    values[:, subtracted] -= values[:, subtracted].min(axis=0)
    return EmgEnvelopes(
        trial.name,
        trial.labels,
        trial.start,
        trial.rate,
        values,
        trial.unit,
        findings,
        trial.origin,
        trial.cycles,
        trial.unread,
    )


def largest_envelopes(trials: Sequence[EmgEnvelopes], window: float = MVC_WINDOW_S) -> dict[str, float]:
    """Channel → largest mean of its envelope over a window [s] in any of the trials, for usable channels."""
    found: dict[str, float] = {}
    for envelopes in trials:
        largest = maximum_voluntary_contraction([envelopes.values], envelopes.rate, window)
        for label in envelopes.usable:
            found[label] = max(found.get(label, 0.0), float(largest[envelopes.labels.index(label)]))
    return found


def normalised(envelopes: EmgEnvelopes, maxima: Mapping[str, float], window: float = MVC_WINDOW_S) -> EmgEnvelopes:
    """Envelopes as fractions of the maxima by channel; NaN and a finding where no maximum is known.

    A channel that exceeds its maximum, over the same window [s], has a finding too.
    """
    reached = largest_envelopes([envelopes], window)
    findings = dict(envelopes.findings)
    for label in envelopes.usable:
        if label not in maxima:
            findings[label] = (*findings[label], ChannelFinding.NO_MVC)
        elif reached[label] > maxima[label]:
            findings[label] = (*findings[label], ChannelFinding.ABOVE_MVC)
    scale = np.array([maxima.get(label, np.nan) for label in envelopes.labels])
    return replace(envelopes, values=envelopes.values / scale, unit="1", findings=findings)


def resampled(envelopes: EmgEnvelopes, rate: float) -> EmgEnvelopes:
    """Usable channels, interpolated to another rate [Hz], which has to be well above the bandwidth of the smoothing."""
    duration = (len(envelopes.values) - 1) / envelopes.rate
    time = envelopes.start + np.arange(int(duration * rate + 1e-6) + 1) / rate
    columns = [np.interp(time, envelopes.time, envelopes.of(label)) for label in envelopes.usable]
    return replace(envelopes, labels=envelopes.usable, rate=rate, values=np.column_stack(columns))


RMS_BANDWIDTH = 0.6
"""A moving average over w seconds halves the amplitude at 0.6/w Hz (sin πx = πx/2 at x = 0.603)."""


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


def maximum_voluntary_contraction(trials: Sequence[Array], rate: float, window: float = MVC_WINDOW_S) -> Array:
    """Largest mean over a window [s] in any of the trials: envelopes (n, channels) at the rate [Hz] → (channels,).

    A trial in which a channel is NaN is omitted for that channel; NaN if it is NaN in all. Raises UnusableEmg for a
    trial shorter than the window.
    """
    width = max(round(window * rate), 1)
    largest = []
    for envelope in trials:
        if len(envelope) < width:
            figures = {"duration_s": len(envelope) / rate, "window_s": window}
            raise UnusableEmg(FitErrorCode.EMG_MVC_SHORT, figures)
        total = np.concatenate((np.zeros((1, envelope.shape[1])), np.cumsum(envelope, axis=0)))
        largest.append(np.max(total[width:] - total[:-width], axis=0) / width)
    return np.asarray(np.fmax.reduce(largest))
