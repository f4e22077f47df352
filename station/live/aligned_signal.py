"""A signal of the DAQ or the EMG amplifier at the times of camera frames, by the arrival of both at the station."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recordings.samples import Samples

Array = NDArray[np.float64]

KEPT_S = 1.0
RMS_WINDOW_S = 0.1


class ArrivalClock:
    """Device time → host time [s] by the block with the least delay so far: the clocks of a trial in progress.

    The offline fit uses the sync edges instead; here the delays of the devices remain, some milliseconds.
    """

    def __init__(self) -> None:
        self._offset_ns: int | None = None

    def times(self, samples: Samples) -> Array:
        """(samples,) host time [s] since 1970."""
        offset_ns = samples.host_time_ns - int(samples.device_time_ns[-1])
        self._offset_ns = offset_ns if self._offset_ns is None else min(self._offset_ns, offset_ns)
        return np.asarray((samples.device_time_ns + self._offset_ns) * 1e-9)


class AlignedSignal:
    """The last KEPT_S seconds of a signal."""

    def __init__(self) -> None:
        self._clock = ArrivalClock()
        self._times = np.zeros(0)
        self._values = np.zeros((0, 0))

    def add(self, samples: Samples) -> None:
        if not len(samples.device_time_ns):
            return
        times, values = self._clock.times(samples), samples.values.astype(np.float64)
        if values.shape[1] != self._values.shape[1]:
            self._times, self._values = np.zeros(0), np.zeros((0, values.shape[1]))
        times = np.concatenate([self._times, times])
        kept = times > times[-1] - KEPT_S
        self._times, self._values = times[kept], np.concatenate([self._values, values])[kept]

    def at(self, host_s: float) -> Array | None:
        """(channels,) interpolated; None where no samples have arrived for this time."""
        if not len(self._times) or not self._times[0] <= host_s <= self._times[-1]:
            return None
        return np.array([np.interp(host_s, self._times, column) for column in self._values.T])

    def rms_until(self, host_s: float) -> Array | None:
        """(channels,) RMS about the mean of the RMS_WINDOW_S before this time; None where they have not arrived."""
        if not len(self._times) or not self._times[0] <= host_s <= self._times[-1]:
            return None
        window = self._values[(self._times > host_s - RMS_WINDOW_S) & (self._times <= host_s)]
        return np.asarray(window.std(axis=0)) if len(window) > 1 else None
