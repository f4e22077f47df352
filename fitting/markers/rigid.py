"""The rigid pose of a cluster of markers, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting import quality


@dataclass(frozen=True)
class Pose:
    """p = R (reference − reference_centre) + centre, per frame; NaN where fewer than three markers were seen."""

    rotation: NDArray[np.float64]
    centre: NDArray[np.float64]
    reference_centre: NDArray[np.float64]
    residual: NDArray[np.float64]

    def to_reference(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (frames, points, 3) of the mocap frame, seen from the body in its reference posture."""
        return np.asarray(
            np.einsum("fji,fpj->fpi", self.rotation, points - self.centre[:, None]) + self.reference_centre[:, None]
        )

    def to_laboratory(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """A point (3,) of the body in its reference posture → (frames, 3) in the mocap frame."""
        return np.asarray(np.einsum("fij,fj->fi", self.rotation, point - self.reference_centre) + self.centre)


def fit_pose(reference: NDArray[np.float64], points: NDArray[np.float64]) -> Pose:
    """Kabsch's rotation per frame of (frames, markers, 3) over the markers seen there and in the reference."""
    seen = is_seen(points) & is_seen(reference)
    weight = seen / np.maximum(seen.sum(axis=1), 1)[:, None]
    here = np.where(seen[..., None], points, 0.0)
    there = np.where(seen[..., None], reference, 0.0)
    centre = np.einsum("fm,fmi->fi", weight, here)
    reference_centre = np.einsum("fm,fmi->fi", weight, there)
    there = np.where(seen[..., None], there - reference_centre[:, None], 0.0)
    here = np.where(seen[..., None], here - centre[:, None], 0.0)
    left, spread, right = np.linalg.svd(here.transpose(0, 2, 1) @ there)
    mirror = np.ones_like(spread)
    mirror[:, 2] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    rotation = left * mirror[:, None] @ right
    miss = here - there @ rotation.transpose(0, 2, 1)
    residual = np.sqrt(np.einsum("fm,fmi->f", weight, miss**2))
    # A frame needs three markers, and two directions in which they are apart.
    is_frame = (seen.sum(axis=1) >= quality.MIN_ANCHOR_MARKERS) & (spread[:, 1] > quality.MIN_ANCHOR_WIDTH**2)
    rotation = np.where(is_frame[:, None, None], rotation, np.nan)
    return Pose(rotation, centre, reference_centre, np.where(is_frame, residual, np.nan))


def is_seen(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each of (..., 3) was seen: (...)."""
    return np.asarray(np.isfinite(points).all(axis=-1))
