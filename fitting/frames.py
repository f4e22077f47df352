"""Markers → the cuff's displacement in the anchor's frame, so that body sway is gone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from fitting import quality
from fitting.quality import UnusableTrial
from fitting.trial import Trial

LEAD_IN = 1.5
"""Seconds of the first trial that make the reference posture."""
GHOST_FACTOR = 5.0
GHOST_FLOOR = 1e-3
"""A frame whose rigid fit leaves more than 5 times the usual residual, and 1 mm, holds a ghost."""
HAMPEL_FRAMES = 11
HAMPEL_FACTOR = 6.0
HAMPEL_FLOOR = 1e-3
"""A frame this far from the median of its neighbours, and six times the usual, is a ghost of the cuff."""


@dataclass(frozen=True)
class Reference:
    """Where the markers were, unloaded, in the mocap frame of one instant: (markers, 3) m, NaN if never seen."""

    anchor: NDArray[np.float64]
    cuff: NDArray[np.float64]


@dataclass(frozen=True)
class CuffMotion:
    """The cuff against the anchoring body, in the reference posture's frame.

    displacement  (frames, 3) m, mean over the visible cuff markers of each one's way from its own reference place
    residual      (frames,) m, rms of the anchor markers about the rigid fit
    rope          (frames, 3) unit vector of the rope, None without rope markers
    """

    displacement: NDArray[np.float64]
    residual: NDArray[np.float64]
    rope: NDArray[np.float64] | None


def reference_posture(trial: Trial) -> Reference:
    """The mean posture of the trial's first seconds. Raises UnusableTrial if the anchor defines no frame.

    The frames are first laid over one that shows the most markers, so that sway does not blur the mean.
    """
    anchor, cuff = trial.positions(trial.cuff.anchor_markers), trial.positions(trial.cuff.cuff_markers)
    visible = np.isfinite(anchor[..., 0]).sum(axis=1) + np.isfinite(cuff[..., 0]).any(axis=1)
    best = int(np.argmax(visible))
    quality.require_rigid_anchor(trial.cuff.anchor_markers, anchor[best])
    lead_in = slice(best, best + int(np.searchsorted(trial.marker_time - trial.marker_time[0], LEAD_IN)) + 1)
    pose = fit_pose(anchor[best], anchor[lead_in])
    both = pose.to_reference(np.concatenate((anchor[lead_in], cuff[lead_in]), axis=1))
    seen = _is_seen(both)
    weight = np.where(seen.any(axis=0), seen.sum(axis=0), np.nan)
    mean = np.where(seen[..., None], both, 0.0).sum(axis=0) / weight[:, None]
    if np.isnan(mean[len(trial.cuff.anchor_markers) :]).all():
        raise UnusableTrial(
            f"the cuff markers {', '.join(trial.cuff.cuff_markers)} are hidden at the start; check the cameras' view"
        )
    return Reference(mean[: anchor.shape[1]], mean[anchor.shape[1] :])


def cuff_motion(trial: Trial, reference: Reference) -> CuffMotion:
    """The trial's motion against a reference of the same donning."""
    pose = fit_pose(reference.anchor, _without_ghosts(reference.anchor, trial.positions(trial.cuff.anchor_markers)))
    way = pose.to_reference(trial.positions(trial.cuff.cuff_markers)) - reference.cuff
    seen = _is_seen(way)
    count = np.where(seen.any(axis=1), seen.sum(axis=1), np.nan)
    displacement = np.where(seen[..., None], way, 0.0).sum(axis=1) / count[:, None]
    rope = None
    if len(trial.cuff.rope_markers) >= 2:
        ends = pose.to_reference(trial.positions((trial.cuff.rope_markers[0], trial.cuff.rope_markers[-1])))
        along = ends[:, 1] - ends[:, 0]
        rope = along / np.linalg.norm(along, axis=1, keepdims=True)
    return CuffMotion(displacement, pose.residual, rope)


def pull_direction(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> NDArray[np.float64]:
    """Unit vector (3,) of the pull in the reference frame, force positive with displacement.

    The rope where its markers were seen; otherwise the direction in which displacement follows the force, from
    their covariance over all these trials: noise of either does not turn it.
    """
    follows, along = np.zeros(3), np.zeros(3)
    for trial, motion in zip(trials, motions, strict=True):
        force = np.interp(trial.marker_time, trial.force_time, trial.force)
        seen = np.isfinite(motion.displacement).all(axis=1)
        way = motion.displacement[seen] - motion.displacement[seen].mean(axis=0)
        follows += (force[seen] - force[seen].mean()) @ way
        if motion.rope is not None:
            along += np.nansum(motion.rope, axis=0)
    chosen = along * np.sign(along @ follows) if np.any(along) else follows
    length = float(np.linalg.norm(chosen))
    if length == 0.0:
        raise UnusableTrial("the cuff does not move with the force; check that the rope was loaded")
    return np.asarray(chosen / length)


def along(motion: CuffMotion, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement x (frames,) [m] along a unit vector; frames far off their neighbours (Hampel) become NaN."""
    x: NDArray[np.float64] = motion.displacement @ direction
    seen = np.flatnonzero(np.isfinite(x))
    if not len(seen):
        return x
    deviation = np.abs(x[seen] - median_filter(x[seen], HAMPEL_FRAMES, mode="nearest"))
    x[seen[deviation > max(HAMPEL_FACTOR * 1.4826 * float(np.median(deviation)), HAMPEL_FLOOR)]] = np.nan
    return x


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


def fit_pose(reference: NDArray[np.float64], points: NDArray[np.float64]) -> Pose:
    """Kabsch's rotation per frame of (frames, markers, 3) over the markers seen there and in the reference."""
    seen = _is_seen(points) & _is_seen(reference)
    weight = seen / np.maximum(seen.sum(axis=1), 1)[:, None]
    here = np.where(seen[..., None], points, 0.0)
    there = np.where(seen[..., None], reference, 0.0)
    centre = np.einsum("fm,fmi->fi", weight, here)
    reference_centre = np.einsum("fm,fmi->fi", weight, there)
    there = np.where(seen[..., None], there - reference_centre[:, None], 0.0)
    here = np.where(seen[..., None], here - centre[:, None], 0.0)
    left, spread, right = np.linalg.svd(np.einsum("fmi,fmj->fij", here, there))
    mirror = np.ones_like(spread)
    mirror[:, 2] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    rotation = np.einsum("fik,fk,fkj->fij", left, mirror, right)
    miss = here - np.einsum("fij,fmj->fmi", rotation, there)
    residual = np.sqrt(np.einsum("fm,fmi->f", weight, miss**2))
    # A frame needs three markers, and two directions in which they are apart.
    is_frame = (seen.sum(axis=1) >= quality.MIN_ANCHOR_MARKERS) & (spread[:, 1] > quality.MIN_ANCHOR_WIDTH**2)
    rotation = np.where(is_frame[:, None, None], rotation, np.nan)
    return Pose(rotation, centre, reference_centre, np.where(is_frame, residual, np.nan))


def _without_ghosts(reference: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The points (frames, markers, 3) with every marker NaN that alone spoils its frame's rigid fit."""
    residual = fit_pose(reference, points).residual
    if not np.isfinite(residual).any():
        return points
    usual = max(GHOST_FACTOR * float(np.nanmedian(residual)), GHOST_FLOOR)
    suspect = np.flatnonzero(residual > usual)
    if not len(suspect):
        return points
    cleaned = points.copy()
    without = np.repeat(points[suspect][None], points.shape[1], axis=0)
    for marker in range(points.shape[1]):
        without[marker, :, marker] = np.nan
    remaining = np.array([fit_pose(reference, candidate).residual for candidate in without])
    remaining = np.where(np.isfinite(remaining), remaining, np.inf)
    culprit = np.argmin(remaining, axis=0)
    is_cured = remaining[culprit, np.arange(len(suspect))] <= usual
    cleaned[suspect[is_cured], culprit[is_cured]] = np.nan
    cleaned[suspect[~is_cured]] = np.nan  # nobody can tell which marker is right
    return cleaned


def _is_seen(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each of (..., 3) was seen: (...)."""
    return np.asarray(np.isfinite(points).all(axis=-1))
