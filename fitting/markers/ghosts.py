"""Markers that are not where the tracking says: one jumps away, two change places, one is a reflection."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from fitting.markers.rigid import Pose, fit_pose

FACTOR, FLOOR = 5.0, 1e-3
"""A frame whose rigid fit leaves more than 5 times the usual residual, and 1 mm, holds a ghost."""
EXCHANGED, EVERY = 3e-3, 10
"""Metres of residual in most frames that no skin explains; then one frame of ten tells whether labels are exchanged."""
HAMPEL_FRAMES = 11
HAMPEL_FACTOR, HAMPEL_FLOOR = 6.0, 1e-3
"""A position this far from the median of its neighbours, and six times the usual, is a ghost."""


def rigid_without_ghosts(
    reference: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], Pose]:
    """Points (frames, markers, 3) of a rigid cluster with ghosts made NaN, how many each marker had (markers,), and the
    pose of the cluster without them.

    A frame that its rigid fit against the reference (markers, 3) does not suit is cured by leaving out the one marker,
    or by exchanging the two, without which it suits; if nothing does, nobody can tell which marker is right.
    """
    pose = fit_pose(reference, points)
    residual = pose.residual
    none = np.zeros(points.shape[1], np.int64)
    if not np.isfinite(residual).any():
        return points, none, pose
    usual = max(FACTOR * _usual(reference, points, residual), FLOOR)
    suspect = np.flatnonzero(residual > usual)
    if not len(suspect):
        return points, none, pose
    cleaned = points.copy()
    for cures in (each_left_out, _each_pair_exchanged):
        if len(suspect):
            candidates = cures(points[suspect])
            remaining = np.array([fit_pose(reference, candidate).residual for candidate in candidates])
            remaining = np.where(np.isfinite(remaining), remaining, np.inf)
            best = np.argmin(remaining, axis=0)
            is_cured = remaining[best, np.arange(len(suspect))] <= usual
            cleaned[suspect[is_cured]] = candidates[best[is_cured], np.flatnonzero(is_cured)]
            suspect = suspect[~is_cured]
    cleaned[suspect] = np.nan
    seen, kept = np.isfinite(points[..., 0]), np.isfinite(cleaned[..., 0])
    is_exchanged = (
        seen & kept & np.any(np.where(seen[..., None], points, 0) != np.where(kept[..., None], cleaned, 0), 2)
    )
    return cleaned, np.count_nonzero(seen & ~kept | is_exchanged, axis=0), fit_pose(reference, cleaned)


def _usual(reference: NDArray[np.float64], points: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
    """The median residual [m], as it would be had no two markers changed places for most of the trial."""
    usual = float(np.nanmedian(residual))
    if usual < EXCHANGED:
        return usual
    some = points[np.isfinite(residual)][::EVERY]
    return min(usual, *(float(np.median(fit_pose(reference, pair).residual)) for pair in _each_pair_exchanged(some)))


def each_left_out(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(markers, frames, markers, 3): points (frames, markers, 3) as they are without each of the markers."""
    without = np.repeat(points[None], points.shape[1], axis=0)
    for marker in range(points.shape[1]):
        without[marker, :, marker] = np.nan
    return without


def path_without_ghosts(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (frames, markers, 3), each marker on its own: NaN where one is far off its neighbours in time (Hampel)."""
    cleaned = points.copy()
    for marker in range(points.shape[1]):
        seen = np.flatnonzero(np.isfinite(points[:, marker, 0]))
        if len(seen):
            path = points[seen, marker]
            # By coordinate: SciPy's filter of one dimension takes a twentieth of the time of the one for images.
            median = np.column_stack([median_filter(along, HAMPEL_FRAMES, mode="nearest") for along in path.T])
            off = np.linalg.norm(path - median, axis=1)
            limit = max(HAMPEL_FACTOR * 1.4826 * float(np.median(off)), HAMPEL_FLOOR)
            cleaned[seen[off > limit], marker] = np.nan
    return cleaned, np.count_nonzero(np.isfinite(points[..., 0]) & ~np.isfinite(cleaned[..., 0]), axis=0)


def _each_pair_exchanged(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(pairs, frames, markers, 3)"""
    pairs = list(combinations(range(points.shape[1]), 2))
    exchanged = np.repeat(points[None], len(pairs), axis=0)
    for i, (a, b) in enumerate(pairs):
        exchanged[i][:, [a, b]] = points[:, [b, a]]
    return exchanged
