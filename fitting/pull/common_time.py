"""Whether force and displacement of held loads change at the same times: otherwise they are not on one clock."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode

BIN, SIDE = 0.05, 0.5
"""Step of the grid, and stretch before and after an instant whose means are compared [s]."""
MOST_OFFSET, TOLERANCE = 10.0, 0.5
"""Largest offset that is tried, and largest one without effect on a hold, whose first second is left out [s]."""
CLEAR, LEAST_PART = 0.7, 0.7
"""Correlation of the steps from which their offset is certain, and the part of it that they need without an offset.
Cuffs that creep, slip or have friction have 0.8 to 1 without one; steps of the load 1 s apart have 0.4."""


def require_common_steps(
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
    marker_time: NDArray[np.float64],
    displacement: NDArray[np.float64],
) -> None:
    """Raise UnusableTrial if displacement (frames,) [m] follows the steps of force (n,) [N] at other times [s]."""
    seen = np.isfinite(displacement)
    if np.count_nonzero(seen) < 2:
        return
    grid = np.arange(max(force_time[0], marker_time[0]), min(force_time[-1], marker_time[-1]), BIN)
    reach, tolerated = round(MOST_OFFSET / BIN), round(TOLERANCE / BIN)
    if len(grid) <= 2 * reach:
        return
    position = np.interp(grid, marker_time[seen], displacement[seen])
    correlation = _correlation(_steps(np.interp(grid, force_time, force)), _steps(position), reach)
    best = int(np.argmax(correlation))
    aligned = float(correlation[reach - tolerated : reach + tolerated + 1].max())
    if correlation[best] > CLEAR and aligned < LEAST_PART * correlation[best]:
        raise UnusableTrial(RejectionCode.STEPS_APART, {"offset_s": (best - reach) * BIN})


def _steps(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) difference of the means after and before every instant."""
    half = round(SIDE / BIN) // 2
    mean = scipy.ndimage.uniform_filter1d(values, 2 * half)
    stepped = np.zeros_like(mean)
    stepped[half:-half] = mean[2 * half :] - mean[: -2 * half]
    return stepped


def _correlation(force: NDArray[np.float64], displacement: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """(2 reach + 1,) correlation of force (n,) with displacement (n,) that is −reach to reach samples later."""
    scale = float(np.linalg.norm(force) * np.linalg.norm(displacement))
    return np.correlate(np.pad(displacement, reach), force, "valid") / scale if scale > 0 else np.zeros(2 * reach + 1)
