"""Check EMG channels before they are processed: flat, clipped, interrupted and rectified ones are unusable, hum is
doubtful."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
import scipy
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
LARGEST_NEGATIVE = 0.01
RECTIFIED_SKEW, SMOOTHED_SHARE = 3.0, 0.1
"""A channel is rectified if no value is below −LARGEST_NEGATIVE of its largest one, which allows for the overshoot of a
filter, and either its 99 % quantile is more than RECTIFIED_SKEW times as far above the median as the 1 % quantile is
below, or less than SMOOTHED_SHARE of its power is above LOWEST_HZ. Raw EMG with an offset may have no negative value,
but is symmetric about its median (ratio up to 2.3 in the public trials; rectified, 4.4 and more), and is fast: of the
power of envelopes, the RMS over 50 ms included, at most 0.07 are there."""
LOWEST_HZ = 20.0
"""Below it, the power of surface EMG is that of moving electrodes and of firing rates."""
HUM_SHARE = 0.5
"""Share of the power at harmonics of the mains frequency; noise has less than 0.1 there."""
MAINS_HZ = (50.0, 60.0)


class ChannelFinding(StrEnum):
    """Fault of a channel. Codes are stable.

    FLAT       constant: no electrode, or the amplifier is off
    CLIPPED    limited by the range of the converter
    RECTIFIED  rectified, or an envelope: no raw EMG
    GAP        samples are missing for longer than LONGEST_GAP_S
    HUM        most of its power is at harmonics of the mains frequency
    ABOVE_MVC  its envelope exceeds the MVC, which therefore was not maximal
    NO_MVC     its MVC is not known
    """

    FLAT = "flat"
    CLIPPED = "clipped"
    RECTIFIED = "rectified"
    GAP = "gap"
    HUM = "hum"
    ABOVE_MVC = "above_mvc"
    NO_MVC = "no_mvc"


UNUSABLE = frozenset({ChannelFinding.FLAT, ChannelFinding.CLIPPED, ChannelFinding.RECTIFIED, ChannelFinding.GAP})


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
    inside, at_extremes = _flat_shares(whole, rate)
    if inside > FLAT_SHARE or np.ptp(whole) == 0:
        return [ChannelFinding.FLAT]
    found = [ChannelFinding.CLIPPED] if at_extremes > FLAT_SHARE or _is_clipped(whole) else []
    found += [ChannelFinding.RECTIFIED] if _is_rectified(whole, rate) else []
    return found + ([ChannelFinding.HUM] if _hum_share(whole, rate) > HUM_SHARE else [])


def _longest_run(is_true: NDArray[np.bool_]) -> int:
    return int(max(_runs(is_true), default=0))


def _runs(is_true: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Lengths of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], is_true.astype(np.int8), [0]))))
    return np.diff(edges.reshape(-1, 2), axis=1)[:, 0]


def _flat_shares(channel: Array, rate: float) -> tuple[float, float]:
    """Shares of the samples in runs of equal ones: within the range of the channel, and at its extreme values."""
    starts = np.flatnonzero(np.diff(channel, prepend=np.nan) != 0)
    lengths, values = np.diff(starts, append=len(channel)), channel[starts]
    is_long = lengths > FLAT_RUN_S * rate
    is_extreme = (values == channel.min()) | (values == channel.max())
    inside, at_extremes = lengths[is_long & ~is_extreme].sum(), lengths[is_long & is_extreme].sum()
    return float(inside) / len(channel), float(at_extremes) / len(channel)


def _is_clipped(channel: Array) -> bool:
    """By the histogram of values: it decreases towards both extremes, unless the signal is clipped there."""
    levels, counts = np.unique(channel, return_counts=True)
    if len(levels) < 3:
        return True
    extremes = ((counts[0], counts[1]), (counts[-1], counts[-2]))
    return any(
        count > CLIPPED_SHARE * len(channel) and count > CLIPPED_EXCESS * neighbour for count, neighbour in extremes
    )


def _is_rectified(channel: Array, rate: float) -> bool:
    if channel.min() < -LARGEST_NEGATIVE * channel.max():
        return False
    low, median, high = np.quantile(channel, (0.01, 0.5, 0.99))
    frequency, power = _spectrum(channel, rate)
    is_smooth = power[frequency >= LOWEST_HZ].sum() < SMOOTHED_SHARE * power.sum()
    return bool(is_smooth or high - median > RECTIFIED_SKEW * (median - low))


def _spectrum(channel: Array, rate: float) -> tuple[Array, Array]:
    """Frequency [Hz] and power of a channel about its mean."""
    return scipy.signal.welch(channel - channel.mean(), rate, nperseg=min(len(channel), round(rate)))


def _hum_share(channel: Array, rate: float) -> float:
    """The larger share of the power above 20 Hz that lies within 1.5 Hz of the harmonics of 50 or 60 Hz."""
    frequency, power = _spectrum(channel, rate)
    is_band = frequency >= LOWEST_HZ
    total = power[is_band].sum()
    shares = []
    for mains in MAINS_HZ:
        harmonic = np.maximum(np.rint(frequency / mains), 1.0)
        shares.append(float(power[is_band & (np.abs(frequency - harmonic * mains) <= 1.5)].sum()))
    return max(shares) / total if total > 0 else 0.0
