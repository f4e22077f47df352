"""Load what the first frames would wait for: compiled functions, memory of the solver."""

from __future__ import annotations

import numpy as np

from solver.inverse_kinematics.solve import assemble
from solver.multibody.postures import points_in_ground, postures
from solver.stream.stream_solver import StreamSolver
from station.live.pipeline import LivePlan

FRAMES, INTERVAL_S = 40, 0.01


def warm_up(plan: LivePlan) -> None:
    """Solve some frames of the model at rest with a solver that is thrown away."""
    model, tasks = plan.body.model, plan.body.tasks
    if not tasks.markers:
        return
    posture = assemble(model)[None]
    state = postures(model, posture, np.zeros_like(posture))
    places = np.array([points_in_ground(state, marker.body, marker.location)[0] for marker in tasks.markers])
    solver = StreamSolver(model, tasks, plan.scenarios, suit=plan.body.suit, lag_s=plan.lag_s)
    for frame in range(FRAMES):
        solver.push(frame * INTERVAL_S, places)
    solver.finish()
