"""Motions that are known, for comparisons of the smoother with filter and differences; none shares its prior exactly.

Every coordinate moves by its own amount, and the joint of the shoulder girdle is closed in every frame.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.inverse_kinematics.solve import TrackingTasks, assemble
from solver.raise_arm import simulate_arm_raise
from tests.solver.inverse_kinematics.marked import with_markers

Array = NDArray[np.float64]

Draw = Callable[[np.random.Generator], Array]

MODEL = with_markers(bundled_model())
TASKS = TrackingTasks(MODEL.markers, np.ones(len(MODEL.markers)))
INTERVAL, FRAMES = 0.01, 400  # s
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
