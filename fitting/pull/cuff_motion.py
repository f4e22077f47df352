"""Cuff displacement in the anchor's frame from markers, which removes body sway.

Trials of a donning in another direction than its first one are found; stiffness along one line must not pool them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from documents.results import EqualByFields
from fitting.errors import UnusableTrial
from fitting.pull.rigid import (
    fit_pose,
    is_seen,
    loose_marker,
    path_without_ghosts,
    require_rigid_anchor,
    rigid_without_ghosts,
)
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Note
from fitting.trial.trial import Trial

LEAD_IN = 1.5
"""Seconds of the first trial whose mean is the reference posture."""
APART = 10.0
"""Degrees from which two pulls are different directions."""


@dataclass(frozen=True)
class Reference:
    """Unloaded marker positions in the mocap frame at one instant: (markers, 3) m, NaN if never seen."""

    anchor: NDArray[np.float64]
    cuff: NDArray[np.float64]


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

    displacement: NDArray[np.float64]
    residual: NDArray[np.float64]
    body: NDArray[np.float64]
    turn: NDArray[np.float64]
    rope: NDArray[np.float64] | None
    ghosts: Mapping[str, int]
    anchor: NDArray[np.float64]
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
    return CuffMotion(displacement, pose.residual, body, turn, rope, ghosts, _mean_posture(trial).anchor, loose)


def pull_direction(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> NDArray[np.float64]:
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


def along(motion: CuffMotion, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement x (frames,) [m] along a unit vector (3,), NaN if not seen."""
    return np.asarray(motion.displacement @ direction)


def _mean_posture(trial: Trial) -> Reference:
    """The mean over LEAD_IN, starting at the frame that shows the most markers; NaN for a marker never seen."""
    anchor, cuff = trial.positions(trial.cuff.anchor_markers), trial.positions(trial.cuff.cuff_markers)
    best = _fullest_frame(anchor, cuff)
    lead_in = slice(best, best + int(np.searchsorted(trial.marker_time - trial.marker_time[0], LEAD_IN)) + 1)
    pose = fit_pose(anchor[best], anchor[lead_in])
    both = pose.to_reference(np.concatenate((anchor[lead_in], cuff[lead_in]), axis=1))
    seen = is_seen(both)
    weight = np.where(seen.any(axis=0), seen.sum(axis=0), np.nan)
    mean = np.where(seen[..., None], both, 0.0).sum(axis=0) / weight[:, None]
    return Reference(mean[: anchor.shape[1]], mean[anchor.shape[1] :])


def _fullest_frame(anchor: NDArray[np.float64], cuff: NDArray[np.float64]) -> int:
    visible = np.isfinite(anchor[..., 0]).sum(axis=1) + np.isfinite(cuff[..., 0]).any(axis=1)
    return int(np.argmax(visible))


def find_other_directions(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, NDArray[np.float64]]:
    """File → unit vector (3,) of the rope, for the trials (in time order) that differ from the first of their test.

    If all dynamic trials differ from the static ones, that is a fault, which D6 reports. Otherwise dynamic trials are
    compared with the first static direction. Without rope markers the direction of a trial is unknown.
    """
    pairs = [(trial, motion) for trial, motion in zip(trials, motions, strict=True) if _shows_rope(motion)]
    ropes = _trial_directions(pairs)
    first = _first_directions(pairs, ropes)
    held = first.get("static")
    swung = [ropes[trial.file] for trial, _ in pairs if trial.test == "dynamic" and trial.file in ropes]
    if held is not None and any(angle_between(held, rope) < APART for rope in swung):
        first["dynamic"] = held
    return {
        trial.file: ropes[trial.file]
        for trial, _ in pairs
        if trial.file in ropes and angle_between(first[trial.test], ropes[trial.file]) >= APART
    }


def number_directions(directions: Mapping[str, NDArray[np.float64]], tests: Mapping[str, str]) -> dict[str, int]:
    """File → number of its direction within its test, from 1, in the order of the files in directions."""
    numbers: dict[str, int] = {}
    kinds: dict[str, list[NDArray[np.float64]]] = {}
    for file, direction in directions.items():
        known = kinds.setdefault(tests[file], [])
        near = [i for i, kind in enumerate(known, 1) if angle_between(kind, direction) < APART]
        if not near:
            known.append(direction)
        numbers[file] = near[0] if near else len(known)
    return numbers


def pull_directions(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, NDArray[np.float64]]:
    """Test → unit vector (3,) of its pull, along the rope that exerts the force.

    Dynamic trials without rope markers use the direction of the static ones, as a cuff may move obliquely to the pull.
    Raises UnusableTrial if the cuff does not move with the force.
    """
    pairs = list(zip(trials, motions, strict=True))
    static = [pair for pair in pairs if pair[0].test == "static"] or pairs
    dynamic = [pair for pair in pairs if pair[0].test == "dynamic"]
    dynamic = dynamic if any(_shows_rope(motion) for _, motion in dynamic) else static
    both = {"static": static, "dynamic": dynamic}
    return {
        test: pull_direction([trial for trial, _ in of_test], [motion for _, motion in of_test])
        for test, of_test in both.items()
    }


def turned_notes(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, tuple[Note, ...]]:
    """File → note, for trials without rope markers in which the cuff moves in another direction than in the first."""
    pairs = [(trial, motion) for trial, motion in zip(trials, motions, strict=True) if not _shows_rope(motion)]
    directions = _trial_directions(pairs)
    first = _first_directions(pairs, directions)
    angles = {
        trial.file: (angle_between(first[trial.test], directions[trial.file]), trial.test)
        for trial, _ in pairs
        if trial.file in directions
    }
    return {
        file: (Note(TrialNoteCode.TURNED, {"angle_deg": angle, "test": test}),)
        for file, (angle, test) in angles.items()
        if angle >= APART
    }


def angle_between(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Angle [degrees] between the lines along two unit vectors (3,)."""
    return math.degrees(math.acos(min(1.0, abs(float(one @ other)))))


def _shows_rope(motion: CuffMotion) -> bool:
    return motion.rope is not None and bool(np.isfinite(motion.rope).any())


def _trial_directions(pairs: Sequence[tuple[Trial, CuffMotion]]) -> dict[str, NDArray[np.float64]]:
    """File → the trial's own direction of pull."""
    directions = {}
    for trial, motion in pairs:
        try:
            directions[trial.file] = pull_direction([trial], [motion])
        except UnusableTrial:  # raised again when the trial is fitted
            continue
    return directions


def _first_directions(
    pairs: Sequence[tuple[Trial, CuffMotion]], directions: Mapping[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """Test → the direction of its first trial."""
    first: dict[str, NDArray[np.float64]] = {}
    for trial, _ in pairs:
        if trial.file in directions:
            first.setdefault(trial.test, directions[trial.file])
    return first
