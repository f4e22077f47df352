"""Frame after frame, each starting from the one before; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled_for_python
from solver.inverse_kinematics.frame import NO_MARKERS, IkWorkspace, Problem, solve_frame
from solver.inverse_kinematics.linearise import evaluate_cost
from solver.inverse_kinematics.skeleton import point_in_ground
from solver.vectors import norm, read, subtract

Array = NDArray[np.float64]


@compiled_for_python
def solve_frames(
    problem: Problem,
    observed: Array,
    values: Array,
    most_rounds: int,
    start: Array,
    work: IkWorkspace,
    results: tuple[Array, Array, Array, Array, Array, NDArray[np.int64]],
) -> None:
    """Fill results: q (frames, coordinates), λ (frames, rows), residual (frames, markers) [m], gap (frames,) [m], cost
    (frames,) [m²], and outcome and rounds (frames, 2).

    observed (frames, markers, 3) and values (frames, coordinates) as solve_frame takes them. start (coordinates,) is
    where the first frame begins, and is changed. A frame without markers leaves NaN, and the next begins as it did.
    """
    found, multipliers, residual, gap, cost, outcome = results
    for frame in range(len(observed)):
        seen, value = observed[frame], values[frame]
        outcome[frame, 0], outcome[frame, 1] = solve_frame(problem, seen, value, most_rounds, start, work)
        if outcome[frame, 0] == NO_MARKERS:
            found[frame] = np.nan
            residual[frame] = np.nan
            gap[frame] = cost[frame] = np.nan
            work.has_curvature[0] = False
            continue
        for k in range(len(start)):
            found[frame, k] = start[k]
        for i in range(len(work.multipliers)):
            multipliers[frame, i] = work.multipliers[i]
            gap[frame] = max(gap[frame], abs(work.system.gap[i]))
        cost[frame] = evaluate_cost(problem.markers, seen, work.share, problem.pull, value, start, work.pose)
        for m in range(len(work.share)):
            point = point_in_ground(work.pose.poses[problem.markers.body[m]], problem.markers.location[m])
            residual[frame, m] = norm(subtract(point, read(seen[m])))
