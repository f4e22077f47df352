"""EMG of a known muscle: Gaussian noise of EMG's band whose standard deviation is the muscle's activation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Array = NDArray[np.float64]
RATE = 1000.0


def activation(time: Array, *, peak: float = 3.0, width: float = 1.2) -> Array:
    """A raise of the arm: rest, a burst that rises faster than it falls, rest; 0.02 to 0.4."""
    late = np.where(time > peak, 1.6, 1.0)
    bump = np.exp(-0.5 * ((time - peak) / (width * late)) ** 2)
    return np.asarray(0.02 + 0.38 * bump)


def raw_emg(level: Array, random: np.random.Generator, channels: int = 1) -> Array:
    """(n, channels) at RATE, band of 40 to 200 Hz; level (n,) is the standard deviation."""
    band = signal.butter(2, (40.0, 200.0), "bandpass", fs=RATE, output="sos")
    noise = signal.sosfilt(band, random.standard_normal((len(level) + 500, channels)), axis=0)[500:]
    return np.asarray(level[:, None] * noise / noise.std())
