"""Check EMG channels before they are processed: flat, clipped and interrupted ones are unusable, hum is doubtful."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fitting.errors import CodedError
from fitting.results.codes import FitErrorCode

Array = NDArray[np.float64]

SLOWEST_HZ = 500.0
"""Surface EMG has power up to 400 to 500 Hz; below this rate most of it is aliased (SENIAM recommends 1000 Hz)."""
SHORTEST_S = 0.5
LONGEST_GAP_S = 0.01
"""Longest gap that is interpolated linearly: shorter than a motor unit's action potential at the skin."""
FLAT_RUN_S, FLAT_SHARE = 0.05, 0.05
"""A channel is flat if runs of equal samples longer than FLAT_RUN_S are more than FLAT_SHARE of it."""
CLIPPED_SHARE, CLIPPED_EXCESS = 1e-3, 3.0
"""A channel is clipped if an extreme value has more than CLIPPED_SHARE of the samples and more than CLIPPED_EXCESS
times as many as the value next to it."""
HUM_SHARE = 0.5
"""Share of the power at harmonics of the mains frequency; noise has less than 0.1 there."""
MAINS_HZ = (50.0, 60.0)


class ChannelFinding(StrEnum):
    """Fault of a channel. Codes are stable.

    FLAT       constant: no electrode, or the amplifier is off
    CLIPPED    limited by the range of the converter
    GAP        samples are missing for longer than LONGEST_GAP_S
    HUM        most of its power is at harmonics of the mains frequency
    ABOVE_MVC  its envelope exceeds the MVC, which therefore was not maximal
    NO_MVC     its MVC is not known
    """

    FLAT = "flat"
    CLIPPED = "clipped"
    GAP = "gap"
    HUM = "hum"
    ABOVE_MVC = "above_mvc"
    NO_MVC = "no_mvc"


UNUSABLE = frozenset({ChannelFinding.FLAT, ChannelFinding.CLIPPED, ChannelFinding.GAP})


class UnusableEmg(CodedError):
    """EMG that cannot be processed or compared."""


def find_faults(values: Array, rate: float) -> tuple[tuple[ChannelFinding, ...], ...]:
    """Findings by channel of raw EMG (n, channels) at the rate [Hz]; NaN where a sample was lost.

    Raises UnusableEmg for a rate below SLOWEST_HZ and for less than SHORTEST_S.
    """
    if rate < SLOWEST_HZ:
        raise UnusableEmg(FitErrorCode.EMG_RATE, {"rate_hz": rate, "lowest_hz": SLOWEST_HZ})
    if len(values) < SHORTEST_S * rate:
        raise UnusableEmg(FitErrorCode.EMG_SHORT, {"duration_s": len(values) / rate, "least_s": SHORTEST_S})
    return tuple(tuple(_faults(channel, rate)) for channel in values.T)


def bridge_gaps(values: Array) -> Array:
    """Interpolate lost samples (NaN) of raw EMG (n, channels) linearly; a channel without any sample stays NaN."""
    whole = values.copy()
    for channel in whole.T:
        lost = np.isnan(channel)
        if lost.any() and not lost.all():
            channel[lost] = np.interp(np.flatnonzero(lost), np.flatnonzero(~lost), channel[~lost])
    return whole


def _faults(channel: Array, rate: float) -> list[ChannelFinding]:
    if _longest_run(np.isnan(channel)) > LONGEST_GAP_S * rate:
        return [ChannelFinding.GAP]
    whole = bridge_gaps(channel[:, None])[:, 0]
    if _is_flat(whole, rate):
        return [ChannelFinding.FLAT]
    found = [ChannelFinding.CLIPPED] if _is_clipped(whole) else []
    return found + ([ChannelFinding.HUM] if _hum_share(whole, rate) > HUM_SHARE else [])


def _longest_run(is_true: NDArray[np.bool_]) -> int:
    return int(max(_runs(is_true), default=0))


def _runs(is_true: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Lengths of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], is_true.astype(np.int8), [0]))))
    return np.diff(edges.reshape(-1, 2), axis=1)[:, 0]


def _is_flat(channel: Array, rate: float) -> bool:
    runs = _runs(np.diff(channel) == 0)
    return float(runs[runs > FLAT_RUN_S * rate].sum()) > FLAT_SHARE * len(channel)


def _is_clipped(channel: Array) -> bool:
    """By the histogram of values: it decreases towards both extremes, unless the signal is clipped there."""
    levels, counts = np.unique(channel, return_counts=True)
    if len(levels) < 3:
        return True
    extremes = ((counts[0], counts[1]), (counts[-1], counts[-2]))
    return any(
        count > CLIPPED_SHARE * len(channel) and count > CLIPPED_EXCESS * neighbour for count, neighbour in extremes
    )


def _hum_share(channel: Array, rate: float) -> float:
    """The larger share of the power above 20 Hz that lies within 1.5 Hz of the harmonics of 50 or 60 Hz."""
    from scipy import signal

    frequency, power = signal.welch(channel - channel.mean(), rate, nperseg=min(len(channel), round(rate)))
    is_band = frequency >= 20.0
    total = power[is_band].sum()
    shares = []
    for mains in MAINS_HZ:
        harmonic = np.maximum(np.rint(frequency / mains), 1.0)
        shares.append(float(power[is_band & (np.abs(frequency - harmonic * mains) <= 1.5)].sum()))
    return max(shares) / total if total > 0 else 0.0
