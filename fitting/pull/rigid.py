"""The rigid pose of a cluster of markers, frame by frame, and the quality of the markers of a trial.

Quality: hidden markers, ghosts, loose, moving skin, lean of the body.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Figures, Note

MIN_ANCHOR_MARKERS = 3
MIN_ANCHOR_WIDTH = 5e-3
"""Second singular value [m] of the anchor cluster below which rotation about its line is not defined."""
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
QUALITY_FRAME_STEP = 10
"""One frame of so many is examined: a rigid fit without each marker in turn is slow."""


@dataclass(frozen=True)
class Pose:
    """p = R (reference − reference_centre) + centre, per frame; NaN if fewer than three markers were seen."""

    rotation: NDArray[np.float64]
    centre: NDArray[np.float64]
    reference_centre: NDArray[np.float64]
    residual: NDArray[np.float64]

    def to_reference(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (frames, points, 3) from the mocap frame to the frame of the body in its reference posture."""
        return np.asarray(
            np.einsum("fji,fpj->fpi", self.rotation, points - self.centre[:, None]) + self.reference_centre[:, None]
        )

    def to_laboratory(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """A point (3,) of the body in its reference posture → (frames, 3) in the mocap frame."""
        return np.asarray(np.einsum("fij,fj->fi", self.rotation, point - self.reference_centre) + self.centre)


def fit_pose(reference: NDArray[np.float64], points: NDArray[np.float64]) -> Pose:
    """Rigid pose of (frames, markers, 3) in every frame (Kabsch), over the markers seen there and in the reference."""
    seen = is_seen(points) & is_seen(reference)
    weight = seen / np.maximum(seen.sum(axis=1), 1)[:, None]
    here = np.where(seen[..., None], points, 0.0)
    there = np.where(seen[..., None], reference, 0.0)
    centre = np.einsum("fm,fmi->fi", weight, here)
    reference_centre = np.einsum("fm,fmi->fi", weight, there)
    there = np.where(seen[..., None], there - reference_centre[:, None], 0.0)
    here = np.where(seen[..., None], here - centre[:, None], 0.0)
    left, spread, right = np.linalg.svd(here.transpose(0, 2, 1) @ there)
    mirror = np.ones_like(spread)
    mirror[:, 2] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    rotation = left * mirror[:, None] @ right
    miss = here - there @ rotation.transpose(0, 2, 1)
    residual = np.sqrt(np.einsum("fm,fmi->f", weight, miss**2))
    # A coordinate frame needs three markers that are not collinear.
    is_frame = (seen.sum(axis=1) >= MIN_ANCHOR_MARKERS) & (spread[:, 1] > MIN_ANCHOR_WIDTH**2)
    rotation = np.where(is_frame[:, None, None], rotation, np.nan)
    return Pose(rotation, centre, reference_centre, np.where(is_frame, residual, np.nan))


def is_seen(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the points (..., 3) were seen: (...)."""
    return np.asarray(np.isfinite(points).all(axis=-1))


FACTOR, FLOOR = 5.0, 1e-3
"""A frame contains a ghost if the residual of its rigid fit exceeds 5 times the median, and 1 mm."""
LARGEST_SKIN_RESIDUAL, FRAME_STEP = 3e-3, 10
"""Median residual [m] that skin motion does not explain; then every tenth frame is tested for exchanged labels."""
HAMPEL_FRAMES = 11
HAMPEL_FACTOR, HAMPEL_FLOOR = 6.0, 1e-3
"""A position is a ghost if its distance from the median of its neighbours exceeds 6 robust sd, and 1 mm."""


def rigid_without_ghosts(
    reference: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], Pose]:
    """Points (frames, markers, 3) of a rigid cluster with NaN for ghosts, their number (markers,), and the pose.

    A frame that does not fit the reference (markers, 3) is repaired by leaving out one marker, or by exchanging two. If
    neither helps, the wrong marker cannot be determined, and the whole frame is NaN.
    """
    pose = fit_pose(reference, points)
    residual = pose.residual
    none = np.zeros(points.shape[1], np.int64)
    if not np.isfinite(residual).any():
        return points, none, pose
    limit = max(FACTOR * _typical_residual(reference, points, residual), FLOOR)
    suspect = np.flatnonzero(residual > limit)
    if not len(suspect):
        return points, none, pose
    cleaned = points.copy()
    for repair in (leave_each_out, _exchange_each_pair):
        if len(suspect):
            candidates = repair(points[suspect])
            remaining = np.array([fit_pose(reference, candidate).residual for candidate in candidates])
            remaining = np.where(np.isfinite(remaining), remaining, np.inf)
            best = np.argmin(remaining, axis=0)
            is_repaired = remaining[best, np.arange(len(suspect))] <= limit
            cleaned[suspect[is_repaired]] = candidates[best[is_repaired], np.flatnonzero(is_repaired)]
            suspect = suspect[~is_repaired]
    cleaned[suspect] = np.nan
    pose = _refitted(pose, reference, cleaned, residual > limit)
    seen, kept = np.isfinite(points[..., 0]), np.isfinite(cleaned[..., 0])
    is_exchanged = (
        seen & kept & np.any(np.where(seen[..., None], points, 0) != np.where(kept[..., None], cleaned, 0), 2)
    )
    return cleaned, np.count_nonzero(seen & ~kept | is_exchanged, axis=0), pose


def _refitted(
    pose: Pose, reference: NDArray[np.float64], points: NDArray[np.float64], is_changed: NDArray[np.bool_]
) -> Pose:
    """The pose of the points, most of which it is of already."""
    again = fit_pose(reference, points[is_changed])
    columns = {field.name: getattr(pose, field.name).copy() for field in fields(Pose)}
    for name, column in columns.items():
        column[is_changed] = getattr(again, name)
    return Pose(**columns)


def _typical_residual(
    reference: NDArray[np.float64], points: NDArray[np.float64], residual: NDArray[np.float64]
) -> float:
    """The median residual [m], or the lowest with two labels exchanged if most of the trial has them exchanged."""
    median = float(np.nanmedian(residual))
    if median < LARGEST_SKIN_RESIDUAL:
        return median
    some = points[np.isfinite(residual)][::FRAME_STEP]
    return min(median, *(float(np.median(fit_pose(reference, pair).residual)) for pair in _exchange_each_pair(some)))


def leave_each_out(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (frames, markers, 3) with one marker left out in turn: (markers, frames, markers, 3)."""
    without = np.repeat(points[None], points.shape[1], axis=0)
    for marker in range(points.shape[1]):
        without[marker, :, marker] = np.nan
    return without


def path_without_ghosts(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (frames, markers, 3) with NaN for outliers of single markers in time (Hampel filter), and their number."""
    from scipy.ndimage import median_filter  # the recorder uses only the poses of this file, and starts faster

    cleaned = points.copy()
    for marker in range(points.shape[1]):
        seen = np.flatnonzero(np.isfinite(points[:, marker, 0]))
        if len(seen):
            path = points[seen, marker]
            # SciPy's filter is 20 times faster for one coordinate at a time than for an image.
            median = np.column_stack([median_filter(along, HAMPEL_FRAMES, mode="nearest") for along in path.T])
            off = np.linalg.norm(path - median, axis=1)
            limit = max(HAMPEL_FACTOR * 1.4826 * float(np.median(off)), HAMPEL_FLOOR)
            cleaned[seen[off > limit], marker] = np.nan
    return cleaned, np.count_nonzero(np.isfinite(points[..., 0]) & ~np.isfinite(cleaned[..., 0]), axis=0)


def _exchange_each_pair(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (frames, markers, 3) with two markers exchanged in turn: (pairs, frames, markers, 3)."""
    pairs = list(combinations(range(points.shape[1]), 2))
    exchanged = np.repeat(points[None], len(pairs), axis=0)
    for i, (a, b) in enumerate(pairs):
        exchanged[i][:, [a, b]] = points[:, [b, a]]
    return exchanged


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
    poses = [fit_pose(reference, without) for without in leave_each_out(points[::QUALITY_FRAME_STEP])]
    if not all(np.isfinite(pose.residual).any() for pose in poses):
        return None
    residuals = np.array([np.sqrt(np.nanmean(pose.residual**2)) for pose in poses])
    suspect = int(np.argmin(residuals))
    positions = poses[suspect].to_reference(points[::QUALITY_FRAME_STEP])[:, suspect]
    positions = positions[np.isfinite(positions).all(axis=1)]
    rms = float(np.sqrt(np.sum(np.var(positions, axis=0)))) if len(positions) else 0.0
    is_loose = rms > LOOSE and residuals[suspect] < LARGEST_RESIDUAL_RATIO * np.delete(residuals, suspect).min()
    return (labels[suspect], rms) if is_loose else None


def _hidden(displacement: NDArray[np.float64]) -> float:
    if not len(displacement):
        raise UnusableTrial(RejectionCode.NO_FRAMES)
    return float(np.mean(np.isnan(displacement[:, 0])))
