"""Markers → the cuff's displacement in the anchor's frame, so that body sway is gone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting import quality
from fitting.markers.ghosts import path_without_ghosts, rigid_without_ghosts
from fitting.markers.loose import loose_marker
from fitting.markers.rigid import fit_pose, is_seen
from fitting.quality import UnusableTrial
from fitting.trial import Trial

LEAD_IN = 1.5
"""Seconds of the first trial that make the reference posture."""


@dataclass(frozen=True)
class Reference:
    """Where the markers were, unloaded, in the mocap frame of one instant: (markers, 3) m, NaN if never seen."""

    anchor: NDArray[np.float64]
    cuff: NDArray[np.float64]


@dataclass(frozen=True)
class CuffMotion:
    """The cuff against the anchoring body, in the reference posture's frame.

    displacement  (frames, 3) m, mean displacement of the visible cuff markers from their reference places
    residual      (frames,) m, rms of the anchor markers about the rigid fit
    body          (frames, 3) m, the middle of the anchor's markers in the mocap frame, of the hidden ones too
    turn          (frames,) m, rms of the visible cuff markers' ways about their mean; 0 where one is seen
    rope          (frames, 3) unit vector of the rope, None without rope markers
    ghosts        marker → frames in which it was no marker of ours and was left out, or another's and was exchanged
    loose         anchor marker that moves among the others, and by how many m rms; None if none does
    """

    displacement: NDArray[np.float64]
    residual: NDArray[np.float64]
    body: NDArray[np.float64]
    turn: NDArray[np.float64]
    rope: NDArray[np.float64] | None
    ghosts: Mapping[str, int]
    loose: tuple[str, float] | None = None


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
    seen = is_seen(both)
    weight = np.where(seen.any(axis=0), seen.sum(axis=0), np.nan)
    mean = np.where(seen[..., None], both, 0.0).sum(axis=0) / weight[:, None]
    if np.isnan(mean[len(trial.cuff.anchor_markers) :]).all():
        raise UnusableTrial(
            f"the cuff markers {', '.join(trial.cuff.cuff_markers)} are hidden at the start; check the cameras' view"
        )
    return Reference(mean[: anchor.shape[1]], mean[anchor.shape[1] :])


def cuff_motion(trial: Trial, reference: Reference) -> CuffMotion:
    """The trial's motion against a reference of the same donning, without ghosts."""
    site = trial.cuff
    anchor, of_anchor, pose = rigid_without_ghosts(reference.anchor, trial.positions(site.anchor_markers))
    displaced, of_cuff = path_without_ghosts(pose.to_reference(trial.positions(site.cuff_markers)) - reference.cuff)
    seen = is_seen(displaced)
    count = np.where(seen.any(axis=1), seen.sum(axis=1), np.nan)
    displacement = np.where(seen[..., None], displaced, 0.0).sum(axis=1) / count[:, None]
    apart = np.where(seen[..., None], displaced - displacement[:, None], 0.0)
    turn = np.sqrt(np.sum(apart**2, axis=(1, 2)) / count)
    rope = None
    if len(site.rope_markers) >= 2:
        ends = pose.to_reference(trial.positions((site.rope_markers[0], site.rope_markers[-1])))
        along = ends[:, 1] - ends[:, 0]
        rope = along / np.linalg.norm(along, axis=1, keepdims=True)
    counts = zip(site.anchor_markers + site.cuff_markers, (*of_anchor.tolist(), *of_cuff.tolist()), strict=True)
    ghosts = {label: count for label, count in counts if count}
    body = pose.to_laboratory(np.nanmean(reference.anchor, axis=0))
    loose = loose_marker(site.anchor_markers, reference.anchor, anchor)
    return CuffMotion(displacement, pose.residual, body, turn, rope, ghosts, loose)


def pull_direction(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> NDArray[np.float64]:
    """Unit vector (3,) of the pull in the reference frame, force positive with displacement.

    The rope where its markers were seen; otherwise the direction in which displacement follows the force, from
    their covariance over all these trials: noise of either does not turn it.
    """
    follows, along = np.zeros(3), np.zeros(3)
    for trial, motion in zip(trials, motions, strict=True):
        force = np.interp(trial.marker_time, trial.force_time, trial.force)
        seen = np.isfinite(motion.displacement).all(axis=1)
        displaced = motion.displacement[seen] - motion.displacement[seen].mean(axis=0)
        follows += (force[seen] - force[seen].mean()) @ displaced
        if motion.rope is not None:
            along += np.nansum(motion.rope, axis=0)
    chosen = along * np.sign(along @ follows) if np.any(along) else follows
    length = float(np.linalg.norm(chosen))
    if length == 0.0:
        raise UnusableTrial("the cuff does not move with the force; check that the rope was loaded")
    return np.asarray(chosen / length)


def along(motion: CuffMotion, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement x (frames,) [m] along a unit vector (3,), NaN where not seen."""
    return np.asarray(motion.displacement @ direction)
