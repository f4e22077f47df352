"""Agreement of a predicted joint force with a measured or a published one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ForceAgreement:
    """Size of a predicted force beside that of a reference, over the frames in which both are known.

    rmse         root mean square difference [N]
    correlation  Pearson's r
    peak_ratio   largest predicted over largest reference
    """

    rmse: float
    correlation: float
    peak_ratio: float


def force_agreement(predicted: Array, reference: Array) -> ForceAgreement:
    """Compare sizes (frames,) [N]. A frame with NaN in either is left out; without two frames all figures are NaN."""
    is_known = np.isfinite(predicted) & np.isfinite(reference)
    ours, theirs = predicted[is_known], reference[is_known]
    if len(ours) < 2:
        return ForceAgreement(np.nan, np.nan, np.nan)
    deviations = ours - ours.mean(), theirs - theirs.mean()
    spread = float(np.linalg.norm(deviations[0]) * np.linalg.norm(deviations[1]))
    return ForceAgreement(
        rmse=float(np.sqrt(np.mean((ours - theirs) ** 2))),
        correlation=float(deviations[0] @ deviations[1]) / spread if spread > 0 else np.nan,
        peak_ratio=float(ours.max() / theirs.max()),
    )


def angle_between(first: Array, second: Array) -> Array:
    """Angle (frames,) [rad] between forces (frames, 3) in the same axes."""
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    angle: Array = np.arctan2(across, (first * second).sum(axis=-1))
    return angle


def glenoid_axes(axis: Array, edge: Array) -> Array:
    """Rows (3, 3) forward, up, lateral of the measured force, in the scapula, from the cone of glenoid.py.

    axis points from the head to the glenoid's centre, edge to its edge marker at the back.
    """
    lateral, forward = -axis, -edge
    return np.vstack([forward, np.cross(lateral, forward), lateral])
