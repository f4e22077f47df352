"""An anchor marker that comes off: the others keep their distances, and it moves among them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitting.markers.ghosts import each_left_out
from fitting.markers.rigid import fit_pose

LOOSE = 0.5e-3
"""Metres rms by which a marker may move among the others without a word: skin does, and their noise looks like it."""
TIGHTER = 0.75
"""Part of the rigid fit's residual that is left without it; of noise alone all markers leave as much."""
EVERY = 10
"""Frames of which one is looked at: a rigid fit for each marker takes its time."""


def loose_marker(
    labels: tuple[str, ...], reference: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[str, float] | None:
    """The marker of (frames, markers, 3) that moves among the others, and by how many metres rms; None if none does.

    One of three cannot be told: no two of them make a frame.
    """
    if len(labels) < 4:
        return None
    poses = [fit_pose(reference, without) for without in each_left_out(points[::EVERY])]
    if not all(np.isfinite(pose.residual).any() for pose in poses):
        return None
    left = np.array([np.sqrt(np.nanmean(pose.residual**2)) for pose in poses])
    suspect = int(np.argmin(left))
    positions = poses[suspect].to_reference(points[::EVERY])[:, suspect]
    positions = positions[np.isfinite(positions).all(axis=1)]
    moves = float(np.sqrt(np.sum(np.var(positions, axis=0)))) if len(positions) else 0.0
    is_loose = moves > LOOSE and left[suspect] < TIGHTER * np.delete(left, suspect).min()
    return (labels[suspect], moves) if is_loose else None
