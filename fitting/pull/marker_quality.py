"""Quality of the markers of a trial: hidden, ghosts, loose, moving skin, lean of the body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.pull.rigid import MIN_ANCHOR_MARKERS, MIN_ANCHOR_WIDTH, fit_pose, leave_each_out
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Figures, Note

OCCLUSION_NOTE = 0.2
OCCLUSION_LIMIT = 0.5
SKIN_CORRELATION = 0.3
LEAN_NOTE = 5e-3
TURN_NOTE = 0.5e-3
"""Metres by which the cuff's markers move apart under the load, from which it is reported."""
LOOSE = 0.5e-3
"""Metres rms relative to the other markers from which a marker is loose; skin and marker noise cause less."""
LARGEST_RESIDUAL_RATIO = 0.75
"""Residual of the rigid fit without the loose marker, over that without any other; for noise alone, 1."""
FRAME_STEP = 10
"""One frame of so many is examined: a rigid fit without each marker in turn is slow."""


def require_rigid_anchor(labels: tuple[str, ...], reference: NDArray[np.float64]) -> None:
    """Raises UnusableTrial unless the anchor markers (markers, 3) [m] define a frame: three seen, not in a line."""
    seen = np.isfinite(reference).all(axis=1)
    if np.count_nonzero(seen) < MIN_ANCHOR_MARKERS:
        count = int(np.count_nonzero(seen))
        figures: Figures = {"count": count, "markers": ", ".join(labels), "expected": MIN_ANCHOR_MARKERS}
        raise UnusableTrial(RejectionCode.ANCHOR_HIDDEN, figures)
    width = float(np.linalg.svd(reference[seen] - reference[seen].mean(axis=0), compute_uv=False)[1])
    if width < MIN_ANCHOR_WIDTH:
        figures = {"markers": ", ".join(labels), "width_m": width, "expected_m": MIN_ANCHOR_WIDTH}
        raise UnusableTrial(RejectionCode.ANCHOR_COLLINEAR, figures)


@dataclass(frozen=True)
class MarkerQuality:
    """Quality of the markers of one trial.

    hidden       share of the frames without displacement
    ghosts       marker → frames in which it was left out or exchanged
    anchor_rms   m, of the anchor markers about the rigid fit
    anchor_follows_force  correlation of that rms with the force
    lean         m by which the body moved with the force, from no load to the highest; already removed
    loose        anchor marker that moves relative to the others, and its rms [m]; None if none does
    """

    hidden: float
    ghosts: Mapping[str, int]
    anchor_rms: float
    anchor_follows_force: float
    lean: float
    loose: tuple[str, float] | None = None


def marker_quality(
    displacement: NDArray[np.float64],
    residual: NDArray[np.float64],
    body: NDArray[np.float64],
    force: NDArray[np.float64],
    ghosts: Mapping[str, int],
) -> MarkerQuality:
    """From displacement (frames, 3), anchor residual (frames,), body (frames, 3) [m] and force (frames,) [N]."""
    seen = np.isfinite(residual) & np.isfinite(force)
    rms = float(np.sqrt(np.mean(residual[seen] ** 2))) if seen.any() else 0.0
    if np.count_nonzero(seen) < 3 or np.ptp(force[seen]) == 0 or np.ptp(residual[seen]) == 0:
        return MarkerQuality(_hidden(displacement), ghosts, rms, 0.0, 0.0)
    correlation = float(np.corrcoef(residual[seen], force[seen])[0, 1])
    load = force[seen] - force[seen].mean()
    follows = load @ (body[seen] - body[seen].mean(axis=0)) / float(load @ load)
    lean = float(np.linalg.norm(follows)) * float(np.ptp(force[seen]))
    return MarkerQuality(_hidden(displacement), ghosts, rms, correlation, lean)


def marker_notes(found: MarkerQuality) -> tuple[Note, ...]:
    """Notes on the markers. Raises UnusableTrial if they were hidden most of the time."""
    if found.hidden > OCCLUSION_LIMIT:
        raise UnusableTrial(RejectionCode.MARKERS_HIDDEN, {"hidden": found.hidden, "limit": OCCLUSION_LIMIT})
    notes = []
    if found.hidden > OCCLUSION_NOTE:
        notes.append(Note(TrialNoteCode.MARKERS_HIDDEN, {"hidden": found.hidden}))
    if found.ghosts:
        counts = ", ".join(f"{label} in {count} frames" for label, count in found.ghosts.items())
        notes.append(Note(TrialNoteCode.GHOSTS, {"markers": counts}))
    if found.loose:
        label, rms = found.loose
        notes.append(Note(TrialNoteCode.LOOSE_MARKER, {"marker": label, "rms_m": rms}))
    if found.anchor_follows_force > SKIN_CORRELATION:
        figures = {"rms_m": found.anchor_rms, "correlation": found.anchor_follows_force}
        notes.append(Note(TrialNoteCode.SKIN, figures))
    if found.lean > LEAN_NOTE:
        notes.append(Note(TrialNoteCode.LEAN, {"lean_m": found.lean}))
    return tuple(notes)


def turn_notes(turn: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[Note, ...]:
    """A note if the cuff's markers move apart with the load, from their rms (frames,) [m] and force (frames,) [N]."""
    seen = np.isfinite(turn)
    if not seen.any() or np.ptp(force[seen]) == 0:
        return ()
    load = force[seen] - force[seen].mean()
    apart = float(load @ turn[seen] / (load @ load)) * float(np.ptp(force[seen]))
    if apart <= TURN_NOTE:
        return ()
    return (Note(TrialNoteCode.TURNS, {"apart_m": apart}),)


def loose_marker(
    labels: tuple[str, ...], reference: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[str, float] | None:
    """The marker of (frames, markers, 3) that moves relative to the others, and its rms [m]; None if none does.

    With three markers it cannot be determined, because two markers do not define a frame.
    """
    if len(labels) < 4:
        return None
    poses = [fit_pose(reference, without) for without in leave_each_out(points[::FRAME_STEP])]
    if not all(np.isfinite(pose.residual).any() for pose in poses):
        return None
    residuals = np.array([np.sqrt(np.nanmean(pose.residual**2)) for pose in poses])
    suspect = int(np.argmin(residuals))
    positions = poses[suspect].to_reference(points[::FRAME_STEP])[:, suspect]
    positions = positions[np.isfinite(positions).all(axis=1)]
    rms = float(np.sqrt(np.sum(np.var(positions, axis=0)))) if len(positions) else 0.0
    is_loose = rms > LOOSE and residuals[suspect] < LARGEST_RESIDUAL_RATIO * np.delete(residuals, suspect).min()
    return (labels[suspect], rms) if is_loose else None


def _hidden(displacement: NDArray[np.float64]) -> float:
    if not len(displacement):
        raise UnusableTrial(RejectionCode.NO_FRAMES)
    return float(np.mean(np.isnan(displacement[:, 0])))
