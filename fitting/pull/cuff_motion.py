"""Cuff displacement in the anchor's frame from markers, which removes body sway.

The anchor is the rigid pose of a cluster of markers, frame by frame. Hidden, ghost and loose markers, moving skin and
lean of the body are found.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from itertools import combinations, permutations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures
from documents.results import EqualByFields
from fitting.errors import UnusableTrial
from fitting.pull.pose import MIN_ANCHOR_MARKERS, MIN_ANCHOR_WIDTH, Pose, fit_pose, is_seen
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode

if TYPE_CHECKING:
    from fitting.trial.trial import Trial  # the recorder uses only a limit of this file, and starts faster

Array = NDArray[np.float64]

OCCLUSION_NOTE = 0.2
OCCLUSION_LIMIT = 0.5
SKIN_CORRELATION = 0.3
LEAN_NOTE = 5e-3
LOOSE = 0.5e-3
"""Metres rms relative to the other markers from which a marker is loose; skin and marker noise cause less."""
LARGEST_RESIDUAL_RATIO = 0.75
"""Residual of the rigid fit without the loose marker, over that without any other; for noise alone, 1."""
QUALITY_FRAME_STEP = 10
"""One frame of so many is examined: a rigid fit without each marker in turn is slow."""


FACTOR, FLOOR = 5.0, 1e-3
"""A frame contains a ghost if the residual of its rigid fit exceeds 5 times the median, and 1 mm."""
LARGEST_EXCHANGE, FRAMES_TESTED = 4, 50
"""Number of labels that are exchanged or rotated among each other, and of the frames in which all orders are tested."""
ResidualFunction = Callable[[Array], Array]
"""Points (frames, markers, 3) → residual (frames,) [m] of their fit to a reference."""
HAMPEL_FRAMES = 11
HAMPEL_FACTOR, HAMPEL_FLOOR = 6.0, 1e-3
"""A position is a ghost if its distance from the median of its neighbours exceeds 6 robust sd, and 1 mm."""


def rigid_without_ghosts(reference: Array, points: Array, pose: Pose) -> tuple[Array, NDArray[np.int64], Pose]:
    """Points (frames, markers, 3) of a rigid cluster with NaN for ghosts, their number (markers,), and the pose.

    pose is that of the points, ghosts included.
    A frame that does not fit the reference (markers, 3) is repaired by leaving out one marker, or by exchanging or
    rotating labels. If neither helps, the wrong marker cannot be determined, and the whole frame is NaN.
    """
    residual = pose.residual
    none = np.zeros(points.shape[1], np.int64)
    if not np.isfinite(residual).any():
        return points, none, pose

    def compute_residual(points: Array) -> Array:
        return fit_pose(reference, points).residual

    limit = _largest_residual(points, residual, compute_residual)
    suspect = np.flatnonzero(residual > limit)
    if not len(suspect):
        return points, none, pose
    cleaned = points.copy()
    for propose in (leave_each_out, partial(_relabelled, compute_residual=compute_residual, limit=limit)):
        if len(suspect):
            repaired, is_repaired = _best(propose(points[suspect]), compute_residual, limit)
            cleaned[suspect[is_repaired]] = repaired[is_repaired]
            suspect = suspect[~is_repaired]
    cleaned[suspect] = np.nan
    pose = _refitted(pose, reference, cleaned, residual > limit)
    seen, kept = np.isfinite(points[..., 0]), np.isfinite(cleaned[..., 0])
    is_exchanged = _is_moved(points, cleaned)
    return cleaned, np.count_nonzero(seen & ~kept | is_exchanged, axis=0), pose


def _is_moved(points: Array, repaired: Array) -> NDArray[np.bool_]:
    """Whether the points (..., 3) are at another position in `repaired`, of those that both have."""
    return np.asarray(is_seen(points) & is_seen(repaired) & np.any(points != repaired, axis=-1))


def _best(candidates: Array, compute_residual: ResidualFunction, limit: float) -> tuple[Array, NDArray[np.bool_]]:
    """The candidate (candidates, frames, markers, 3) of least residual in each frame; whether it is in the limit."""
    remaining = np.array([compute_residual(candidate) for candidate in candidates])
    remaining = np.where(np.isfinite(remaining), remaining, np.inf)
    best, frames = np.argmin(remaining, axis=0), np.arange(remaining.shape[1])
    return candidates[best, frames], remaining[best, frames] <= limit


def _with_labels_restored(points: Array, residual: Array, compute_residual: ResidualFunction) -> Array:
    """Points (frames, markers, 3), whose residual (frames,) is given, exchanged labels as in the reference."""
    if points.shape[1] < 2 or not np.isfinite(residual).any():
        return points
    limit = _largest_residual(points, residual, compute_residual)
    suspect = np.flatnonzero(residual > limit)
    restored = points.copy()
    if len(suspect):
        repaired, is_repaired = _best(_relabelled(points[suspect], compute_residual, limit), compute_residual, limit)
        restored[suspect[is_repaired]] = repaired[is_repaired]
    return restored


def _apart(displaced: Array) -> tuple[Array, Array]:
    """Mean (frames, 3) of the displacements (frames, markers, 3) that are seen, and their rms (frames,) about it."""
    seen = is_seen(displaced)
    count = np.where(seen.any(axis=1), seen.sum(axis=1), np.nan)
    mean = np.where(seen[..., None], displaced, 0.0).sum(axis=1) / count[:, None]
    apart = np.where(seen[..., None], displaced - mean[:, None], 0.0)
    return mean, np.sqrt(np.sum(apart**2, axis=(1, 2)) / count)


def _refitted(pose: Pose, reference: Array, points: Array, is_changed: NDArray[np.bool_]) -> Pose:
    """The pose of the points, most of which it is of already."""
    again = fit_pose(reference, points[is_changed])
    columns = {field.name: getattr(pose, field.name).copy() for field in fields(Pose)}
    for name, column in columns.items():
        column[is_changed] = getattr(again, name)
    return Pose(**columns)


def _largest_residual(points: Array, residual: Array, compute_residual: ResidualFunction) -> float:
    """Residual [m] above which a frame is wrong, from the median: of the best labels, as most may be exchanged."""
    typical = float(np.nanmedian(residual))
    if typical > FLOOR:
        some = _some(points[np.isfinite(residual)])
        every = [some, *(some[:, order] for order in _orders(points.shape[1], LARGEST_EXCHANGE))]
        typical = float(np.median(np.nanmin([compute_residual(relabelled) for relabelled in every], axis=0)))
    return max(FACTOR * typical, FLOOR)


def leave_each_out(points: Array) -> Array:
    """Points (frames, markers, 3) with one marker left out in turn: (markers, frames, markers, 3)."""
    without = np.repeat(points[None], points.shape[1], axis=0)
    for marker in range(points.shape[1]):
        without[marker, :, marker] = np.nan
    return without


def path_without_ghosts(points: Array) -> tuple[Array, NDArray[np.int64]]:
    """Points (frames, markers, 3) with NaN for outliers of single markers in time (Hampel filter), and their number."""
    from scipy.ndimage import median_filter  # as above

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


def _relabelled(points: Array, compute_residual: ResidualFunction, limit: float) -> Array:
    """Points (frames, markers, 3) in other orders of their markers: (orders, frames, markers, 3).

    The orders are all with two markers exchanged, and those with more of which one frame of FRAMES_TESTED fits.
    """
    some, markers = _some(points), points.shape[1]
    pairs = _orders(markers, 2)
    more = [order for order in _orders(markers, LARGEST_EXCHANGE) if order not in pairs]
    fitting = [order for order in more if np.any(compute_residual(some[:, order]) <= limit)]
    return np.array([points[:, order] for order in (*pairs, *fitting)])


def _orders(markers: int, largest: int) -> list[list[int]]:
    """Orders of so many markers in which two to `largest` of them are at another place."""
    found = []
    for count in range(2, largest + 1):
        for places in combinations(range(markers), count):
            for moved in permutations(places):
                if all(place != marker for place, marker in zip(places, moved, strict=True)):
                    order = list(range(markers))
                    for place, marker in zip(places, moved, strict=True):
                        order[place] = marker
                    found.append(order)
    return found


def _some(points: Array) -> Array:
    """At most FRAMES_TESTED of the frames, evenly spread."""
    chosen = np.linspace(0, len(points) - 1, FRAMES_TESTED).round().astype(int)
    return np.asarray(points[np.unique(chosen)])


def require_rigid_anchor(labels: tuple[str, ...], reference: Array) -> None:
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
    displacement: Array, residual: Array, body: Array, force: Array, ghosts: Mapping[str, int]
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
        counts = ", ".join(f"{label} (frames: {count})" for label, count in found.ghosts.items())
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


def loose_marker(labels: tuple[str, ...], reference: Array, points: Array) -> tuple[str, float] | None:
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


def _hidden(displacement: Array) -> float:
    if not len(displacement):
        raise UnusableTrial(RejectionCode.NO_FRAMES)
    return float(np.mean(np.isnan(displacement[:, 0])))


LEAD_IN = 1.5
"""Seconds of the first trial whose mean is the reference posture."""


@dataclass(frozen=True)
class Reference:
    """Unloaded marker positions in the mocap frame at one instant: (markers, 3) m, NaN if never seen."""

    anchor: Array
    cuff: Array


@dataclass(frozen=True, eq=False)
class CuffMotion(EqualByFields):
    """Motion of the cuff relative to the anchoring body, in the frame of the reference posture.

    displacement  (frames, 3) m, mean displacement of the visible cuff markers from their reference positions
    residual      (frames,) m, rms of the anchor markers about the rigid fit
    body          (frames, 3) m, centre of all anchor markers in the mocap frame, hidden ones included
    turn          (frames,) m, rms of the displacements of the visible cuff markers about their mean; 0 for one marker
    rope          (frames, 3) unit vector of the rope, None without rope markers
    ghosts        marker → frames in which its position was left out as a ghost, or exchanged with another marker
    anchor        (markers, 3) m, mean positions of the anchor markers in the trial's first seconds, NaN if not seen
    loose         anchor marker that moves relative to the others, and its rms [m]; None if none does
    """

    displacement: Array
    residual: Array
    body: Array
    turn: Array
    rope: Array | None
    ghosts: Mapping[str, int]
    anchor: Array
    loose: tuple[str, float] | None = None


def reference_posture(trial: Trial) -> Reference:
    """The mean posture of the trial's first seconds. Raises UnusableTrial if the anchor defines no frame.

    The frames are first aligned with the one that shows the most markers, so that sway does not blur the mean.
    """
    anchor, cuff = trial.positions(trial.cuff.anchor_markers), trial.positions(trial.cuff.cuff_markers)
    require_rigid_anchor(trial.cuff.anchor_markers, anchor[_fullest_frame(anchor, cuff)])
    reference = _mean_posture(trial)
    if np.isnan(reference.cuff).all():
        raise UnusableTrial(RejectionCode.CUFF_HIDDEN, {"markers": ", ".join(trial.cuff.cuff_markers)})
    return reference


def cuff_motion(trial: Trial, reference: Reference) -> CuffMotion:
    """The motion of a trial relative to the reference of its donning, without ghosts."""
    site = trial.cuff
    of_trial = trial.positions(site.anchor_markers), trial.positions(site.cuff_markers)
    *labelled, pose = _anchor_with_labels_restored(reference.anchor, *of_trial)
    anchor, of_anchor, pose = rigid_without_ghosts(reference.anchor, labelled[0], pose)
    of_anchor = of_anchor + np.count_nonzero(_is_moved(of_trial[0], labelled[0]), axis=0)
    seen = pose.to_reference(of_trial[1])
    cuff = _cuff_with_labels_restored(reference, pose, labelled[0], anchor, pose.to_reference(labelled[1]))
    displaced, of_cuff = path_without_ghosts(cuff - reference.cuff)
    of_cuff = of_cuff + np.count_nonzero(_is_moved(seen, cuff), axis=0)
    displacement, turn = _apart(displaced)
    rope = None
    if len(site.rope_markers) >= 2:
        ends = pose.to_reference(trial.positions((site.rope_markers[0], site.rope_markers[-1])))
        along = ends[:, 1] - ends[:, 0]
        rope = along / np.linalg.norm(along, axis=1, keepdims=True)
    counts = zip(site.anchor_markers + site.cuff_markers, (*of_anchor.tolist(), *of_cuff.tolist()), strict=True)
    ghosts = {label: count for label, count in counts if count}
    body = pose.to_laboratory(np.nanmean(reference.anchor, axis=0))
    loose = loose_marker(site.anchor_markers, reference.anchor, anchor)
    return CuffMotion(displacement, pose.residual, body, turn, rope, ghosts, _mean_posture(trial).anchor, loose)


def _anchor_with_labels_restored(reference: Array, anchor: Array, cuff: Array) -> tuple[Array, Array, Pose]:
    """Markers of the anchor and of the cuff (frames, markers, 3) with labels of both put back so that the anchor fits.

    In frames without a hidden marker only: exchanged with a hidden one, a wrong label would be left out unseen. The
    pose is that of the anchor with its labels put back.
    """
    pose = fit_pose(reference, anchor)
    both = np.concatenate((anchor, cuff), axis=1)
    is_full = is_seen(both).all(axis=1)
    restored = both.copy()
    restored[is_full] = _with_labels_restored(
        both[is_full], pose.residual[is_full], lambda points: fit_pose(reference, points[:, : len(reference)]).residual
    )
    is_changed = np.asarray(_is_moved(both, restored).any(axis=1))
    anchor, cuff = restored[:, : anchor.shape[1]], restored[:, anchor.shape[1] :]
    return anchor, cuff, _refitted(pose, reference, anchor, is_changed) if is_changed.any() else pose


def _cuff_with_labels_restored(reference: Reference, pose: Pose, anchor: Array, kept: Array, cuff: Array) -> Array:
    """Positions (frames, cuff markers, 3) in the reference posture, exchanged labels put back.

    A label at the place of an anchor marker that was left out has its positions instead. anchor and kept (frames,
    markers, 3) are the positions of the anchor with and without ghosts.
    """
    if not np.isfinite(pose.residual).any():
        return cuff
    limit = max(FACTOR * float(np.nanmedian(pose.residual)), FLOOR)
    restored, all_anchor = cuff.copy(), pose.to_reference(anchor)
    for marker, place in enumerate(reference.anchor):
        is_left_out = is_seen(anchor[:, marker]) & ~is_seen(kept[:, marker])
        for label in range(cuff.shape[1]) if is_left_out.any() else ():
            is_there = is_left_out & (np.linalg.norm(cuff[:, label] - place, axis=1) <= limit)
            restored[is_there, label] = all_anchor[is_there, marker]
    residual = _apart(restored - reference.cuff)[1]
    return _with_labels_restored(restored, residual, lambda points: _apart(points - reference.cuff)[1])


def pull_direction(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> Array:
    """Unit vector (3,) of the pull in the reference frame; force is positive with displacement.

    It is the direction of the rope if its markers were seen. Otherwise it is the covariance of displacement with force
    over all these trials, which noise of either does not bias. Raises UnusableTrial without motion.
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
        raise UnusableTrial(RejectionCode.NO_MOTION)
    return np.asarray(chosen / length)


def along(motion: CuffMotion, direction: Array) -> Array:
    """Displacement x (frames,) [m] along a unit vector (3,), NaN if not seen."""
    return np.asarray(motion.displacement @ direction)


def _mean_posture(trial: Trial) -> Reference:
    """The mean over LEAD_IN, starting at the frame that shows the most markers; NaN for a marker never seen."""
    anchor, cuff = trial.positions(trial.cuff.anchor_markers), trial.positions(trial.cuff.cuff_markers)
    best = _fullest_frame(anchor, cuff)
    lead_in = slice(best, best + int(np.searchsorted(trial.marker_time - trial.marker_time[0], LEAD_IN)) + 1)
    first = Reference(anchor[best], cuff[best])
    anchor, cuff, pose = _anchor_with_labels_restored(first.anchor, anchor[lead_in], cuff[lead_in])
    kept, _, pose = rigid_without_ghosts(first.anchor, anchor, pose)
    restored = _cuff_with_labels_restored(first, pose, anchor, kept, pose.to_reference(cuff))
    both = np.concatenate((pose.to_reference(kept), restored), axis=1)
    seen = is_seen(both)
    weight = np.where(seen.any(axis=0), seen.sum(axis=0), np.nan)
    mean = np.where(seen[..., None], both, 0.0).sum(axis=0) / weight[:, None]
    return Reference(mean[: anchor.shape[1]], mean[anchor.shape[1] :])


def _fullest_frame(anchor: Array, cuff: Array) -> int:
    visible = np.isfinite(anchor[..., 0]).sum(axis=1) + np.isfinite(cuff[..., 0]).any(axis=1)
    return int(np.argmax(visible))
