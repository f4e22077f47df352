"""Motions drawn from the uncertainty of the markers behind one: every marker is displaced and the trial solved again.

A marker is displaced by white noise in every frame and by an offset that lasts the whole trial, which stands for soft
tissue.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.inverse_kinematics.solve import InverseKinematics, TrackingTasks, solve_inverse_kinematics
from solver.model import Model

Array = NDArray[np.float64]


def draw_postures(
    model: Model,
    observed: Array,
    tasks: TrackingTasks,
    solution: InverseKinematics,
    noise: ArrayLike,
    offsets: ArrayLike,
    *,
    count: int,
    seed: int = 1,
) -> Iterator[Array]:
    """`count` drawn sequences of postures, each (frames, coordinates) [rad or m].

    observed (frames, markers, 3) [m], tasks and solution as solved; noise and offsets are standard deviations along
    each axis [m], one for all or (markers,). A frame in which a draw has no solution keeps the posture of the solution.
    """
    generator = np.random.default_rng(seed)
    frames, markers = observed.shape[:2]
    spread = np.broadcast_to(np.asarray(noise, dtype=np.float64), (markers,))[:, None]
    lasting = np.broadcast_to(np.asarray(offsets, dtype=np.float64), (markers,))[:, None]
    start = solution.coordinates[0]
    for _ in range(count):
        moved = lasting * generator.standard_normal((markers, 3))
        displaced = observed + moved + spread * generator.standard_normal((frames, markers, 3))
        drawn = solve_inverse_kinematics(model, displaced, tasks, start if np.isfinite(start).all() else None)
        is_solved = np.array([outcome == "solved" for outcome in drawn.outcomes])[:, None]
        yield np.where(is_solved, drawn.coordinates, solution.coordinates)
