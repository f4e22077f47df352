"""The arrays behind a trial's figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.dynamic.damping import DampingFit
from fitting.markers.frames import CuffMotion
from fitting.quality import MarkerQuality
from fitting.static.stiffness import StaticFit
from fitting.trial import Trial


@dataclass(frozen=True)
class TrialCurves:
    """One used trial: force (n,) [N] at force_time [s], displacement (frames,) [m] at marker_time [s], NaN if unseen.

    Displacement counts from the donning's reference posture; session time 0 is the sync edge, trial.end the end.
    static   held loads and their lines (stiffness of the donning, an offset per segment), None for a dynamic trial
    dynamic  fitted motion and damper force over velocity, None for a static trial or where it says nothing
    motion   of the cuff in three dimensions, in the anchor's frame;  markers  how far they can be believed
    """

    trial: Trial
    force_time: NDArray[np.float64]
    force: NDArray[np.float64]
    marker_time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    static: StaticFit | None = None
    dynamic: DampingFit | None = None
    motion: CuffMotion | None = None
    markers: MarkerQuality | None = None
