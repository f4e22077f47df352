"""Consistency of the force and markers of a pull: labels, a common clock, and a load cell without drift."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.message import Figures
from fitting.errors import UnusableTrial
from fitting.pull.cuff_motion import QUALITY_FRAME_STEP
from fitting.pull.pose import fit_pose, is_seen
from fitting.results.trial_codes import RejectionCode
from fitting.trial.trial import Trial

BIN, SIDE = 0.05, 0.5
"""Step of the grid, and duration before and after an instant over which means are compared [s]."""
MOST_OFFSET, TOLERANCE = 10.0, 0.5
"""Largest offset of the search, and largest offset without effect on held loads, whose first second is left out [s]."""
CLEAR, LEAST_PART = 0.7, 0.7
"""Least correlation of the steps at the best offset, and least part of it without an offset. This part is 0.8 to 1
for cuffs that creep, slip or have friction, and 0.4 if force and displacement are 1 s apart."""
REACH = round(MOST_OFFSET / BIN)
CLEAR_MOTION = 10.0
"""Least total motion of a cuff that moves steadily, in standard deviations of its motion within a second."""
LEAST_MOTION = 1e-12
"""Lower limit of the sum of squared motions [m²], against division by zero."""
LEAST_BENDING = 1e-3
"""Metres rms of the anchor as labelled, above what noise of markers and skin cause."""
LARGEST_RATIO = 0.2
"""Of the anchor's rms with two labels exchanged, to that as labelled."""


def require_own_labels(trial: Trial) -> None:
    """Raise UnusableTrial if the anchor is rigid only with one of its labels and one of the cuff's exchanged in every
    frame, so that no frame shows their right order.

    As labelled, the anchor then bends under the load. If the labels were right, it would not be rigid with two of them
    exchanged: the cuff moves against the anchor by more than a loose marker or skin.
    """
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


def require_common_steps(
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
    marker_time: NDArray[np.float64],
    displacement: NDArray[np.float64],
) -> None:
    """Raise UnusableTrial if displacement (frames,) [m] follows the steps of force (n,) [N] at other times [s]."""
    load, position = _on_grid(force_time, force, marker_time, displacement)
    if len(load) <= 2 * REACH:
        return
    correlation = _correlation(_steps(load), _steps(position), REACH)
    best, tolerated = int(np.argmax(correlation)), round(TOLERANCE / BIN)
    aligned = float(correlation[REACH - tolerated : REACH + tolerated + 1].max())
    if correlation[best] > CLEAR and aligned < LEAST_PART * correlation[best]:
        raise UnusableTrial(RejectionCode.STEPS_APART, {"offset_s": (best - REACH) * BIN})


def require_steady_cell(
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
    marker_time: NDArray[np.float64],
    displacement: NDArray[np.float64],
    tolerance: float,
) -> None:
    """Raise UnusableTrial if the force (n,) [N] drifts beyond a tolerance [N] while the cuff (frames,) [m] rests.

    A drift of the load cell persists to the end and does not move the cuff. A force in the rope does: at the rate of
    the force over the stiffness (regression of the changes within a second), or steadily and by far more than noise.
    """
    load, position = _on_grid(force_time, force, marker_time, displacement)
    second = round(1 / BIN)
    if len(load) <= 2 * second:
        return
    load = scipy.ndimage.uniform_filter1d(load, second // 2)  # single samples have the step of the converter
    change, motion = (values[second:] - values[:-second] for values in (load, position))
    rate, duration = float(np.median(change)), BIN * len(load)
    slope = float(change @ motion) / max(float(motion @ motion), LEAST_MOTION)
    moved = float(position[-second:].mean() - position[:second].mean())
    speed = float(np.median(motion))
    is_steady = abs(moved) > CLEAR_MOTION * float(np.std(motion)) and speed * duration / moved > 1 / 2
    moves = is_steady or abs(slope * speed) > abs(rate) / 2
    remains = float(load[-second:].mean() - load[:second].mean()) * np.sign(rate)
    if not moves and abs(rate) * duration > tolerance / 2 and remains > max(tolerance, abs(rate) * duration / 2):
        raise UnusableTrial(RejectionCode.FORCE_DRIFTS, {"drift_n_per_s": rate, "duration_s": duration})


def _on_grid(
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
    marker_time: NDArray[np.float64],
    displacement: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Force and displacement (n,) on a grid of step BIN over their common time; empty if the cuff is hidden."""
    seen = np.isfinite(displacement)
    if np.count_nonzero(seen) < 2:
        return np.empty(0), np.empty(0)
    grid = np.arange(max(force_time[0], marker_time[0]), min(force_time[-1], marker_time[-1]), BIN)
    return np.interp(grid, force_time, force), np.interp(grid, marker_time[seen], displacement[seen])


def _steps(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) mean after every instant minus the mean before it."""
    half = round(SIDE / BIN) // 2
    mean = scipy.ndimage.uniform_filter1d(values, 2 * half)
    stepped = np.zeros_like(mean)
    stepped[half:-half] = mean[2 * half :] - mean[: -2 * half]
    return stepped


def _correlation(force: NDArray[np.float64], displacement: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """(2 reach + 1,) correlation of force (n,) with displacement (n,), which lags by −reach to reach samples."""
    scale = float(np.linalg.norm(force) * np.linalg.norm(displacement))
    return np.correlate(np.pad(displacement, reach), force, "valid") / scale if scale > 0 else np.zeros(2 * reach + 1)


def _bending(points: NDArray[np.float64]) -> float:
    """Root mean square distance [m] of markers (frames, markers, 3) from a rigid body; inf if they define no frame."""
    residual = fit_pose(points[0], points).residual
    return float(np.sqrt(np.nanmean(residual**2))) if np.isfinite(residual).any() else np.inf
