"""Displacement of a cuff against its anchor, or of a bouncing weight, live; the fit computes the recorded one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitting.pull.pose import MIN_ANCHOR_MARKERS, fit_pose
from recordings.manifest import BounceRig, CuffSite

REFERENCE_FRAMES = 20
"""Complete frames that are averaged as the reference; the sway of the wearer during them blurs the mean."""


class LiveDisplacement:
    """Displacement since the first frames, in millimetres: of a cuff in its anchor, or of a weight in the laboratory.

    Along the rope while its markers are visible, else along the direction of the largest displacement so far.
    """

    def __init__(self, subject: CuffSite | BounceRig, labels: tuple[str, ...]) -> None:
        self._has_anchor = isinstance(subject, CuffSite)
        anchor, moving, rope = (
            (subject.anchor_markers, subject.cuff_markers, subject.rope_markers)
            if isinstance(subject, CuffSite)
            else ((), (subject.marker,), ())
        )
        self._anchor, self._moving, rope_places = (
            [labels.index(name) for name in names if name in labels] for names in (anchor, moving, rope)
        )
        self._rope = (rope_places[0], rope_places[-1]) if len(rope_places) >= 2 else None
        self._collected: list[NDArray[np.float64]] = []
        self._reference: NDArray[np.float64] | None = None
        self._direction: NDArray[np.float64] | None = None
        self._moments = np.zeros((3, 3))

    def update(self, frames: NDArray[np.floating]) -> NDArray[np.float64]:
        """(frames, markers, ≥ 3) mm → (frames,) mm; NaN while anchor or cuff is hidden or the reference is missing."""
        unknown = np.full(len(frames), np.nan)
        if (self._has_anchor and len(self._anchor) < MIN_ANCHOR_MARKERS) or not self._moving:
            return unknown
        points = np.asarray(frames[..., :3], np.float64)
        if self._reference is None:
            self._collect_reference(points)
        if self._reference is None:
            return unknown
        anchors, moving = len(self._anchor), points[:, self._moving]
        rope = points[:, list(self._rope)] if self._rope else None
        if self._has_anchor:
            pose = fit_pose(self._reference[:anchors], points[:, self._anchor])
            moving, rope = pose.to_reference(moving), pose.to_reference(rope) if rope is not None else None
        displacement = (moving - self._reference[anchors:]).mean(axis=1)
        self._update_direction(rope, displacement)
        return unknown if self._direction is None else np.asarray(displacement @ self._direction)

    def _collect_reference(self, points: NDArray[np.float64]) -> None:
        both = points[:, [*self._anchor, *self._moving]]
        self._collected.extend(both[np.isfinite(both).all(axis=(1, 2))])
        if len(self._collected) >= REFERENCE_FRAMES:
            self._reference = np.mean(self._collected, axis=0)

    def _update_direction(self, rope: NDArray[np.float64] | None, displacement: NDArray[np.float64]) -> None:
        """rope: (frames, 2, 3) first and last marker, the first at the cuff;  displacement: (frames, 3); both [mm]."""
        if rope is not None and np.isfinite(rope).all(axis=(1, 2)).any():
            along = np.nanmean(rope[:, 1] - rope[:, 0], axis=0)
            self._direction = along / np.linalg.norm(along)
            return
        seen = displacement[np.isfinite(displacement).all(axis=1)]
        self._moments += seen.T @ seen
        if rope is None and self._moments.any():
            principal = np.linalg.eigh(self._moments)[1][:, -1]
            # Sign: displacement grows from rest, so that the displacement so far is positive.
            forward = seen.sum(axis=0) @ principal if self._direction is None else self._direction @ principal
            self._direction = principal if forward >= 0 else -principal
