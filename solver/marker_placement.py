"""Markers of a static pose: how still they are, and a model's markers moved to where they were seen (the last step of
OpenSim's ScaleTool).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.solve import TrackingTasks, solve_inverse_kinematics
from solver.model import Model
from solver.multibody.postures import postures

Array = NDArray[np.float64]


def place_markers(model: Model, labels: Sequence[str], static: Array, tasks: TrackingTasks) -> Model:
    """The model with every marker that is seen and not fixed at its place in the body, in the posture of the tasks.

    static (labels, 3) [m] is the mean of the frames of a static pose, NaN where a marker is hidden.
    """
    columns = [list(labels).index(marker.name) for marker in tasks.markers]
    posture = solve_inverse_kinematics(model, static[None, columns], tasks).coordinates
    state = postures(model, posture, np.zeros_like(posture))
    places = dict(zip(labels, static, strict=True))
    moved = []
    for marker in model.markers:
        place = places.get(marker.name)
        if marker.is_fixed or place is None or not np.isfinite(place).all():
            moved.append(marker)
            continue
        rotation, origin = state.rotation_to_ground[0, marker.body], state.origin_in_ground[0, marker.body]
        moved.append(replace(marker, location=rotation.T @ (place - origin)))
    return replace(model, markers=tuple(moved))


def largest_motion(labels: Sequence[str], observed: Array) -> tuple[str, float]:
    """Label of the marker that moves most along an axis in (frames, labels, 3) [m], and its range [m]."""
    hidden = ~np.isfinite(observed).any(axis=(0, 2))
    filled = np.where(np.isfinite(observed), observed, np.nan)
    filled[:, hidden] = 0.0
    ranges = (np.nanmax(filled, axis=0) - np.nanmin(filled, axis=0)).max(axis=1)
    index = int(np.argmax(ranges))
    return labels[index], float(ranges[index])
