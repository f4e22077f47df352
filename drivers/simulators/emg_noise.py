"""Surface EMG by its simplest model: band-limited noise with an amplitude proportional to the activation.

N. Hogan, R. W. Mann, "Myoelectric signal processing: optimal estimation applied to electromyography", IEEE Trans.
Biomed. Eng. 27(7) (1980). Does not imitate: motor units, cross-talk between muscles, motion artefacts, mains hum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PERIOD_S = 16.0
RATE_HZ = 4096.0  # of the table, which is interpolated linearly
LOWEST_HZ, HIGHEST_HZ = 20.0, 450.0


class EmgNoise:
    """Noise of variance 1 as a function of time, periodic with PERIOD_S."""

    def __init__(self, rng: np.random.Generator) -> None:
        count = round(PERIOD_S * RATE_HZ)
        frequency = np.fft.rfftfreq(count, 1 / RATE_HZ)
        is_in_band = (frequency >= LOWEST_HZ) & (frequency <= HIGHEST_HZ)
        phases = rng.uniform(0.0, 2 * np.pi, len(frequency))
        table = np.fft.irfft(is_in_band * np.exp(1j * phases), count)
        self._table = np.append(table, table[0]) / np.std(table)

    def __call__(self, t: Floats) -> Floats:
        """(n,) at t (n,) [s]."""
        place = np.mod(t, PERIOD_S) * RATE_HZ
        low = np.minimum(place.astype(np.int64), len(self._table) - 2)
        part = place - low
        return np.asarray((1 - part) * self._table[low] + part * self._table[low + 1])
