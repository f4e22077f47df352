"""Maximum voluntary contraction (MVC) of every channel, which normalises the envelopes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fitting.emg.channels import UnusableEmg
from fitting.results.codes import FitErrorCode

Array = NDArray[np.float64]

MVC_WINDOW_S = 0.5
"""A contraction lasts seconds; the largest mean over half a second is not a spike."""


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
