"""A pull along one axis from a trial without markers, for fits that read force and displacement alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitting.pull.cuff_motion import CuffMotion
from fitting.pull.pull import Pull
from fitting.pull.rigid import MarkerQuality
from fitting.trial.trial import Trial


def pull_of(trial: Trial, displacement: NDArray[np.float64]) -> Pull:
    """displacement (frames,) [m] along x."""
    frames = len(displacement)
    still, along_x = np.zeros((frames, 3)), np.array([1.0, 0.0, 0.0])
    motion = CuffMotion(
        displacement=displacement[:, None] * along_x,
        residual=np.zeros(frames),
        body=still,
        turn=np.zeros(frames),
        rope=None,
        ghosts={},
        anchor=np.zeros((0, 3)),
    )
    return Pull(
        trial=trial,
        force_time=trial.force_time,
        force=trial.force,
        marker_time=trial.marker_time,
        displacement=displacement,
        motion=motion,
        direction=along_x,
        markers=MarkerQuality(0.0, {}, 0.0, 0.0, 0.0),
        plateaus=(),
        notes=(),
    )
