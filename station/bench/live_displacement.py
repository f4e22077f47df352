"""Where the cuff is now against its anchor, along the rope: for the eye, while the fit is for the record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitting.markers.rigid import fit_pose
from fitting.quality import MIN_ANCHOR_MARKERS
from recordings.manifest import CuffSite

REFERENCE_FRAMES = 20
"""Frames with all markers in sight that make the reference; their mean blurs by what the wearer sways meanwhile."""


class LiveDisplacement:
    """Takes blocks of frames, gives the displacement since the first ones, in millimetres.

    Along the rope where its markers are seen, else along the direction in which the cuff has moved most so far.
    """

    def __init__(self, cuff: CuffSite, labels: tuple[str, ...]) -> None:
        self._anchor = [labels.index(name) for name in cuff.anchor_markers if name in labels]
        self._cuff = [labels.index(name) for name in cuff.cuff_markers if name in labels]
        rope = [labels.index(name) for name in cuff.rope_markers if name in labels]
        self._rope = (rope[0], rope[-1]) if len(rope) >= 2 else None
        self._waiting: list[NDArray[np.float64]] = []
        self._reference: NDArray[np.float64] | None = None
        self._direction: NDArray[np.float64] | None = None
        self._moments = np.zeros((3, 3))

    def take(self, frames: NDArray[np.floating]) -> NDArray[np.float64]:
        """(frames, markers, ≥ 3) mm → (frames,) mm, NaN where anchor or cuff is out of sight or no reference is yet."""
        nothing = np.full(len(frames), np.nan)
        if len(self._anchor) < MIN_ANCHOR_MARKERS or not self._cuff:
            return nothing
        points = np.asarray(frames[..., :3], np.float64)
        if self._reference is None:
            self._collect(points)
        if self._reference is None:
            return nothing
        anchors = len(self._anchor)
        pose = fit_pose(self._reference[:anchors], points[:, self._anchor])
        way = (pose.to_reference(points[:, self._cuff]) - self._reference[anchors:]).mean(axis=1)
        self._turn(pose.to_reference(points[:, list(self._rope)]) if self._rope else None, way)
        return nothing if self._direction is None else np.asarray(way @ self._direction)

    def _collect(self, points: NDArray[np.float64]) -> None:
        both = points[:, [*self._anchor, *self._cuff]]
        self._waiting.extend(both[np.isfinite(both).all(axis=(1, 2))])
        if len(self._waiting) >= REFERENCE_FRAMES:
            self._reference = np.mean(self._waiting, axis=0)

    def _turn(self, rope: NDArray[np.float64] | None, way: NDArray[np.float64]) -> None:
        """Keeps the direction up to date; the rope points from its first marker, at the cuff, to its last."""
        if rope is not None and np.isfinite(rope).all(axis=(1, 2)).any():
            along = np.nanmean(rope[:, 1] - rope[:, 0], axis=0)
            self._direction = along / np.linalg.norm(along)
            return
        moved = way[np.isfinite(way).all(axis=1)]
        self._moments += moved.T @ moved
        if rope is None and self._moments.any():
            widest = np.linalg.eigh(self._moments)[1][:, -1]
            # The sign: displacement grows from the rest, so what has been moved so far counts as forward.
            forward = moved.sum(axis=0) @ widest if self._direction is None else self._direction @ widest
            self._direction = widest if forward >= 0 else -widest
