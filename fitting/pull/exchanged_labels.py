"""Labels of anchor and cuff that are exchanged in every frame, so that no frame shows their right order.

As labelled, the anchor then bends under the load. With one label of it and one of the cuff exchanged it is rigid, which
it would not be if the labels were right: the cuff moves against the anchor by more than a loose marker or skin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures
from fitting.errors import UnusableTrial
from fitting.pull.cuff_motion import QUALITY_FRAME_STEP, fit_pose, is_seen
from fitting.results.trial_codes import RejectionCode
from fitting.trial.trial import Trial

LEAST_BENDING = 1e-3
"""Metres rms of the anchor as labelled, above what noise of markers and skin cause."""
LARGEST_RATIO = 0.2
"""Of the anchor's rms with two labels exchanged, to that as labelled."""


def require_own_labels(trial: Trial) -> None:
    """Raise UnusableTrial if the anchor is rigid only with one of its labels and one of the cuff's exchanged."""
    site, labels = trial.cuff, (*trial.cuff.anchor_markers, *trial.cuff.cuff_markers)
    points = trial.positions(labels)[::QUALITY_FRAME_STEP]
    points, count = points[is_seen(points).all(axis=1)], len(site.anchor_markers)
    bent = _bending(points[:, :count]) if len(points) else 0.0
    if not LEAST_BENDING <= bent < np.inf:  # an anchor that defines no frame is refused by reference_posture
        return
    exchanged = {}
    for own in range(count):
        for other in range(count, len(labels)):
            order = list(range(count))
            order[own] = other
            exchanged[labels[own], labels[other]] = _bending(points[:, order])
    (own_label, other_label), rms = min(exchanged.items(), key=lambda item: item[1])
    if rms < LARGEST_RATIO * bent:
        figures: Figures = {"anchor": own_label, "cuff": other_label, "rms_m": bent, "exchanged_m": rms}
        raise UnusableTrial(RejectionCode.LABELS_EXCHANGED, figures)


def _bending(points: NDArray[np.float64]) -> float:
    """Root mean square distance [m] of markers (frames, markers, 3) from a rigid body; inf if they define no frame."""
    residual = fit_pose(points[0], points).residual
    return float(np.sqrt(np.nanmean(residual**2))) if np.isfinite(residual).any() else np.inf
