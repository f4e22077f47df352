"""Direction and point of application of the force of the rope on the cuff, in the mocap frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitting.pull.cuff_motion import cuff_motion, pull_direction, reference_posture
from fitting.pull.rigid import fit_pose
from fitting.trial.trial import Trial


def pull_on_cuff(trial: Trial) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Direction (n, 3) of the force on the cuff, and the centroid of its markers (n, 3) [m], at the force times.

    The direction is that of the rope if it has markers, otherwise the direction of the cuff displacement, fixed in the
    frame of the anchor; NaN while the markers are hidden. Raises UnusableTrial if the anchor does not define a frame.
    """
    reference = reference_posture(trial)
    motion = cuff_motion(trial, reference)
    along = np.broadcast_to(pull_direction([trial], [motion]), motion.displacement.shape)
    if motion.rope is not None:
        along = motion.rope * np.sign(np.nansum(motion.rope, axis=0) @ along[0])
    rotation = fit_pose(reference.anchor, trial.positions(trial.cuff.anchor_markers)).rotation
    direction = _at(trial.force_time, trial.marker_time, np.einsum("fij,fj->fi", rotation, along))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    cuff = trial.positions(trial.cuff.cuff_markers)
    seen = np.isfinite(cuff[..., 0])
    count = np.where(seen.any(axis=1), seen.sum(axis=1), np.nan)
    middle = np.where(seen[..., None], cuff, 0.0).sum(axis=1) / count[:, None]
    return direction, _at(trial.force_time, trial.marker_time, middle)


def _at(time: NDArray[np.float64], frames: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate vectors (frames, 3) linearly; NaN next to a frame without a vector."""
    return np.column_stack([np.interp(time, frames, component) for component in vectors.T])
