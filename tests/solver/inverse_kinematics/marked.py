"""Models with markers on every body, and what those see of a posture."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from solver.bundled import bundled_model, simulate_arm_raise
from solver.inverse_kinematics.solve import TrackingTasks, assemble
from solver.model import GROUND, Array, Marker, Model, PointConstraint
from solver.multibody.postures import points_in_ground, postures

Draw = Callable[[np.random.Generator], Array]
INTERVAL, FRAMES = 0.01, 400  # s


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


# Motions that are known, for comparisons of the smoother with filter and differences; none shares its prior exactly.
# Every coordinate moves by its own amount, and the joint of the shoulder girdle is closed in every frame.


MODEL = with_markers(bundled_model())
TASKS = TrackingTasks(MODEL.markers, np.ones(len(MODEL.markers)))
RAISED = MODEL.default_coordinates + 0.6 * (np.array(MODEL.coordinate_names) == "shoulder_elv")


def arm_raise(_: np.random.Generator) -> Array:
    """The bundled motion: ten coordinates at rest, the others follow minimum-jerk curves."""
    return simulate_arm_raise(bundled_model()).coordinates


def minimum_jerk(chance: np.random.Generator) -> Array:
    """Rest, a raise of 1.2 s, a hold, and back."""
    time = INTERVAL * np.arange(FRAMES)
    up, down = (np.clip((time - start) / 1.2, 0.0, 1.0) for start in (0.5, 2.2))
    return _assembled(chance, sum(side * (10 * u**3 - 15 * u**4 + 6 * u**5) for side, u in ((1, up), (-1, down))))


def sines(chance: np.random.Generator) -> Array:
    """Sums of three sines between 0.1 and 1 Hz; no derivative is white."""
    time = INTERVAL * np.arange(FRAMES)
    turns = 2 * np.pi * (chance.uniform(0.1, 1.0, (3, 1)) * time + chance.random((3, 1)))
    return _assembled(chance, np.sin(turns).mean(axis=0))


def white_jerk(chance: np.random.Generator) -> Array:
    """Jerk drawn at every frame, for every coordinate, and summed three times."""
    jerk = chance.standard_normal((FRAMES, len(MODEL.coordinates)))
    part = np.cumsum(np.cumsum(np.cumsum(jerk, axis=0), axis=0), axis=0)
    return _assembled(chance, part.T / np.abs(part).max(axis=0)[:, None])


def _assembled(chance: np.random.Generator, part: Array) -> Array:
    """part (frames,) of the reach of every coordinate, or (coordinates, frames)."""
    count = len(MODEL.coordinates)
    reach = chance.uniform(0.05, 0.25, count) * chance.choice([-1, 1], count)
    return closed(RAISED + part.T * reach if part.ndim == 2 else RAISED + part[:, None] * reach)


def closed(wanted: Array) -> Array:
    """The nearest postures (frames, coordinates) in which the joint is closed."""
    return np.array([assemble(MODEL, posture) for posture in wanted])
