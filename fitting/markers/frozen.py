"""A mocap stream that stands still: the same positions frame after frame, to the last digit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitting.quality import STUCK, UnusableTrial


def require_live_markers(
    marker_time: NDArray[np.float64],
    markers: NDArray[np.float64],
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
) -> None:
    """Raises UnusableTrial if markers (frames, labels, 3) keep their places for a second while force (n,) [N] moves.

    Under a force that rests they may: a simulator has no noise, a real camera has some.
    """
    same = (np.diff(markers, axis=0) == 0) | np.isnan(markers[1:]) & np.isnan(markers[:-1])
    still = same.all(axis=(1, 2)) & np.isfinite(markers[1:]).any(axis=(1, 2))
    bounds = np.flatnonzero(np.diff(np.concatenate(([False], still, [False]))))
    travel = _spread(force)
    for first, last in zip(bounds[::2], bounds[1::2], strict=True):
        start, end = float(marker_time[first]), float(marker_time[last])
        meanwhile = force[(force_time >= start) & (force_time <= end)]
        if end - start > STUCK and len(meanwhile) > 1 and _spread(meanwhile) > travel / 2:
            raise UnusableTrial(
                f"the markers stand still to the last digit for {end - start:.1f} s from {start:.1f} s on while the "
                "force moves; check that QTM was measuring, and record again"
            )


def _spread(force: NDArray[np.float64]) -> float:
    """Newtons between its 0.5 and 99.5 %."""
    low, high = np.percentile(force, [0.5, 99.5])
    return float(high - low)
