"""How well markers fit a model: as given, in the mirror, and how far the body is tilted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.solve import TrackingTasks, assemble, solve_inverse_kinematics
from solver.model import GROUND, Model
from solver.multibody.postures import points_in_ground, postures

Array = NDArray[np.float64]

FRAMES = 7
"""Frames that are looked at, evenly spread; each is solved from the default posture."""
MIRROR = np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class MarkerFit:
    """Medians over some frames of a trial.

    size                spread of the markers over that of the model's in its default posture
    as_given, mirrored  RMS distance of the markers from those of the model [m], and of their mirror image
    tilt                angle [rad] between the upward direction in the body that the ground carries, and that in the
                        default posture
    """

    size: float
    as_given: float
    mirrored: float
    tilt: float


def fit_markers(model: Model, observed: Array, tasks: TrackingTasks) -> MarkerFit:
    """Fit some frames of a trial. observed (frames, markers, 3) [m] with at least one frame that shows a marker.

    Raises ModelError where shapes do not fit, or the model cannot be assembled.
    """
    seen = np.flatnonzero(np.isfinite(observed).all(axis=2).sum(axis=1))
    some = observed[seen[np.unique(np.linspace(0, len(seen) - 1, FRAMES).astype(int))]]
    size = float(np.median([_size(model, frame, tasks) for frame in some]))
    given, coordinates = _residual(model, some, tasks)
    mirrored, _ = _residual(model, MIRROR * some, tasks)
    upright = _upwards(model, assemble(model)[None])[0]
    cosine = _upwards(model, coordinates) @ upright
    return MarkerFit(size, given, mirrored, float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0)))))


def _size(model: Model, frame: Array, tasks: TrackingTasks) -> float:
    """Of one frame (markers, 3): RMS distance from the mean, over that of the same markers of the model."""
    posture = model.default_coordinates[None]
    state = postures(model, posture, np.zeros_like(posture))
    places = np.array([points_in_ground(state, marker.body, marker.location)[0] for marker in tasks.markers])
    is_seen = np.isfinite(frame).all(axis=1)
    return float(
        np.std(frame[is_seen] - frame[is_seen].mean(axis=0)) / np.std(places[is_seen] - places[is_seen].mean(axis=0))
    )


def _residual(model: Model, observed: Array, tasks: TrackingTasks) -> tuple[float, Array]:
    """Median of the frames' RMS residuals [m], and their coordinates. Coordinate tasks would depend on the frame."""
    markers = TrackingTasks(tasks.markers, tasks.weights)
    solved = [solve_inverse_kinematics(model, frame[None], markers) for frame in observed]
    squares = [float(np.nanmean(solution.residuals**2)) for solution in solved]
    return float(np.sqrt(np.median(squares))), np.concatenate([solution.coordinates for solution in solved])


def _upwards(model: Model, coordinates: Array) -> Array:
    """(frames, 3) direction against gravity in the first body that the ground carries."""
    body = next(joint.child for joint in model.joints if joint.parent == GROUND)
    state = postures(model, coordinates, np.zeros_like(coordinates))
    up = -model.gravity / np.linalg.norm(model.gravity)
    directions: Array = up @ state.rotation_to_ground[:, body]
    return directions
