"""Models with markers on every body, and what those see of a posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.solve import TrackingTasks, assemble
from solver.model import GROUND, Marker, Model, PointConstraint
from solver.multibody.postures import points_in_ground, postures

Array = NDArray[np.float64]


def with_markers(model: Model, each: int = 3, seed: int = 1) -> Model:
    """So many markers on every body but the ground, up to a decimetre from its origin."""
    chance = np.random.default_rng(seed)
    markers = tuple(
        Marker(f"{body.name}_{k}", index, chance.uniform(-0.1, 0.1, 3))
        for index, body in enumerate(model.bodies)
        if index != GROUND
        for k in range(each)
    )
    return replace(model, markers=markers)


def tasks_of(model: Model, seed: int = 2) -> TrackingTasks:
    return TrackingTasks(model.markers, np.random.default_rng(seed).uniform(0.5, 2.0, len(model.markers)))


def seen_from(model: Model, coordinates: Array, markers: Sequence[Marker] = ()) -> Array:
    """(frames, markers, 3) in ground, of all markers of the model unless some are given."""
    state = postures(model, coordinates, np.zeros_like(coordinates))
    return np.stack(
        [points_in_ground(state, marker.body, marker.location) for marker in markers or model.markers], axis=1
    )


def gaps_of(model: Model, coordinates: Array) -> Array:
    """(frames, rows) of the point constraints, in ground, from the second point to the first."""
    state = postures(model, coordinates, np.zeros_like(coordinates))
    gaps = [np.zeros((len(coordinates), 0))]
    for constraint in model.constraints:
        if isinstance(constraint, PointConstraint):
            one = points_in_ground(state, constraint.body_1, constraint.location_1)
            gaps.append(one - points_in_ground(state, constraint.body_2, constraint.location_2))
    return np.concatenate(gaps, axis=1)


def random_postures(model: Model, frames: int, spread: float, seed: int) -> Array:
    """(frames, coordinates) near the default posture, assembled."""
    chance = np.random.default_rng(seed)
    away = model.default_coordinates + chance.uniform(-spread, spread, (frames, len(model.coordinates)))
    return np.array([assemble(model, wanted) for wanted in away])


def cost_of(model: Model, tasks: TrackingTasks, observed: Array, coordinates: Array) -> Array:
    """(frames,) as the problem states it, for observed (frames, markers, 3) and coordinates of the same frames."""
    is_seen = np.isfinite(observed).all(axis=2)
    weights = np.where(is_seen, tasks.weights, 0.0)
    squares = np.where(is_seen, np.nansum((seen_from(model, coordinates, tasks.markers) - observed) ** 2, axis=2), 0.0)
    cost: Array = 0.5 * (weights * squares).sum(axis=1) / weights.sum(axis=1)
    for name, weight in tasks.coordinate_weights.items():
        k = model.coordinate_index(name)
        target = tasks.coordinate_targets.get(name, model.default_coordinates[k])
        cost = cost + 0.5 * weight * (coordinates[:, k] - np.asarray(target)) ** 2
    return cost
