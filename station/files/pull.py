"""Direction and point of the rope's pull on the cuff in the mocap frame, for programs that apply it to a body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitting.markers.frames import cuff_motion, pull_direction, reference_posture
from fitting.markers.rigid import fit_pose
from fitting.trial import Trial


def pull_on_cuff(trial: Trial) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Direction (n, 3) of the force on the cuff, and the middle of its markers (n, 3) [m], at the trial's force times.

    Along the rope where it has markers, else along the direction in which the cuff yields, which turns with the
    anchor; NaN between frames that do not show it. Raises UnusableTrial where the anchor defines no frame.
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
    """Vectors (frames, 3) between their frames, NaN beside a frame that has none."""
    return np.column_stack([np.interp(time, frames, component) for component in vectors.T])
