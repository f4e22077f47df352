"""How many independent observations a trial holds.

Skin and model errors follow the posture, so frames of similar posture repeat the same error: a hundred frames of one
pose are one observation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def effective_frames(observed: Array, scatter: float) -> float:
    """Of observed (frames, markers, 3) [m], NaN where hidden; scatter [m] of a marker along each axis.

    n / (1 + 2 Σ ρ) with the autocorrelation ρ of the markers' motion up to its first zero, as far as the motion (its
    variance γ) exceeds the scatter: 1 + (n / (1 + 2 Σ ρ) − 1) γ / (γ + scatter²). So a static pose counts once.
    """
    flat = observed.reshape(len(observed), -1)
    flat = flat[:, np.isfinite(flat).any(axis=0)]
    if flat.size == 0 or len(flat) < 2:
        return 1.0
    centred = flat - np.nanmean(flat, axis=0)
    centred = np.where(np.isfinite(centred), centred, 0.0)
    variance = float((centred**2).mean())
    if variance == 0.0:
        return 1.0
    spectrum = np.fft.rfft(centred, 2 * len(centred), axis=0)
    correlation = np.fft.irfft((np.abs(spectrum) ** 2).sum(axis=1))[: len(centred)]
    correlation = correlation / correlation[0]
    is_negative = correlation <= 0.0
    end = int(np.argmax(is_negative)) if is_negative.any() else len(correlation)
    independent = len(centred) / (1.0 + 2.0 * float(correlation[1:end].sum()))
    return 1.0 + max(independent - 1.0, 0.0) * variance / (variance + scatter**2)
