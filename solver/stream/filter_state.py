"""The state of the fixed-lag smoother, and the frames that it smooths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

START_SD = (0.3, 2.0, 10.0)
"""Of q, q̇, q̈ where a coordinate starts [rad or m, s]."""


class Window(NamedTuple):
    """Frames from the first that was not given out to the latest.

    values, variances (frames, coordinates) of the postures, NaN where there is none
    steps     (frames,) [s] from the frame before, that of the first from the state
    restarts  (frames, coordinates) where a coordinate starts anew
    """

    values: Array
    variances: Array
    steps: Array
    restarts: NDArray[np.bool_]


class FilterState(NamedTuple):
    """means (coordinates, 3) of q, q̇, q̈ and covariances (coordinates, 3, 3) after a frame, given those before it."""

    means: Array
    covariances: Array
