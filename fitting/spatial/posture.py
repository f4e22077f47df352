"""How well the reference posture is known, in whose frame a tensor is given."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitting.markers.frames import reference_posture
from fitting.spatial.tensor import entries_of
from fitting.trial import Trial


def posture_error(tensor: NDArray[np.float64], first: Trial, anchor_rms: float) -> NDArray[np.float64]:
    """(6, 6) covariance that noise of the reference posture adds to a tensor (3, 3): a turn of the whole.

    A small turn θ adds θ× T − T θ×. Its covariance is s² (Σ |r|² − r rᵀ)⁻¹ for anchor markers at r about their
    middle, with noise s in the one frame over which the posture's others are laid; anchor_rms [m] is about the rigid
    fit, which takes six degrees of freedom.
    """
    anchor = reference_posture(first).anchor
    places = anchor[np.isfinite(anchor).all(axis=1)]
    places = places - places.mean(axis=0)
    count = len(places)
    noise = anchor_rms**2 * 3 * count / max(3 * count - 6, 1) / 3
    inertia = np.sum(places**2) * np.eye(3) - places.T @ places
    turns = [np.cross(np.eye(3), axis) for axis in -np.eye(3)]
    slopes = np.array([entries_of(turn @ tensor - tensor @ turn) for turn in turns]).T
    return np.asarray(slopes @ np.linalg.inv(inertia) @ slopes.T * noise)
