"""Raw EMG of a trial → envelopes of its channels, normalised where a maximum voluntary contraction (MVC) is known."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitting.emg.channels import UNUSABLE, ChannelFinding, UnusableEmg, find_faults
from fitting.emg.envelope import LINEAR_ENVELOPE, EnvelopeSettings, emg_envelope
from fitting.emg.maximum import MVC_WINDOW_S, maximum_voluntary_contraction
from fitting.results.codes import FitErrorCode
from recordings.manifest import DataOrigin

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


def envelopes_of(
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
