"""Frame after frame, each starting from the one before; compiled."""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python, compiled_with_allocation
from solver.inverse_kinematics.frame import NO_MARKERS, SOLVED, IkWorkspace, Problem, solve_frame
from solver.inverse_kinematics.linearise import Targets, evaluate_cost, evaluate_gap
from solver.inverse_kinematics.skeleton import evaluate_pose, point_in_ground
from solver.vectors import norm, read, subtract

Array = NDArray[np.float64]

NEARNESS = 1e-6  # m²/rad²; by which an optimum must be lower to count although it is farther away
CLEARLY_LOWER = 1e-7  # m²
TURN, ROUND_OFF = 2.0 * pi, 1e-12


@compiled_for_python
def solve_frames(
    problem: Problem,
    observed: Array,
    values: Array,
    most_rounds: int,
    starts: Array,
    work: IkWorkspace,
    results: tuple[Array, Array, Array, Array, Array, NDArray[np.int64]],
) -> None:
    """Fill results: q (frames, coordinates), λ (frames, rows), residual (frames, markers) [m], gap (frames,) [m], cost
    (frames,) [m²], and outcome and rounds (frames, 2).

    observed (frames, markers, 3) and values (frames, coordinates) as solve_frame takes them. A frame begins at the last
    one that was solved. The first, and one that is not solved from there, is sought from every row of starts (starts,
    coordinates). A frame without markers leaves NaN.
    """
    found, multipliers, residual, gap, cost, outcome = results
    q, near, is_first = starts[0].copy(), starts[0].copy(), True
    for frame in range(len(observed)):
        seen, value = observed[frame], values[frame]
        outcome[frame] = solve_frame(problem, seen, value, most_rounds, q, work)
        if outcome[frame, 0] == NO_MARKERS:
            found[frame] = residual[frame] = np.nan
            gap[frame] = cost[frame] = np.nan
            work.has_curvature[0] = False
            continue
        if (is_first and len(starts) > 1) or outcome[frame, 0] != SOLVED:
            _search_starts(problem, seen, value, most_rounds, starts, near, q, work)
            _unwind(problem, seen, value, near, q, work)
            outcome[frame, 0], _ = solve_frame(problem, seen, value, most_rounds, q, work)
        found[frame] = q
        for i in range(len(work.system.gap)):
            multipliers[frame, i] = work.quadratic.multipliers[i]
            gap[frame] = max(gap[frame], abs(work.system.gap[i]))
        cost[frame] = evaluate_cost(problem.markers, Targets(seen, work.share, value, problem.pull), q, work.pose)
        for m in range(len(work.share)):
            point = point_in_ground(work.pose.poses[problem.markers.body[m]], problem.markers.location[m])
            residual[frame, m] = norm(subtract(point, read(seen[m])))
        if outcome[frame, 0] == SOLVED:
            near[:], is_first = q, False
        else:
            q[:] = near


@compiled_with_allocation
def _search_starts(
    problem: Problem,
    seen: Array,
    value: Array,
    most_rounds: int,
    starts: Array,
    near: Array,
    q: Array,
    work: IkWorkspace,
) -> None:
    """Move q to the lowest optimum that it and the starts lead to, of nearly equal ones to the one nearest to `near`.

    It stays where no start leads to an optimum.
    """
    best, held = np.inf, _is_held(work)
    for s in range(-1, len(starts)):
        tried = q.copy() if s < 0 else np.where(held, starts[s], q)
        work.has_curvature[0] = False
        code, _ = solve_frame(problem, seen, value, most_rounds, tried, work)
        worth = evaluate_cost(problem.markers, Targets(seen, work.share, value, problem.pull), tried, work.pose)
        for k in range(len(q)):
            worth += NEARNESS * (tried[k] - near[k]) ** 2
        if code == SOLVED and worth < best - CLEARLY_LOWER:
            best = worth
            q[:] = tried


@compiled_with_allocation
def _is_held(work: IkWorkspace) -> NDArray[np.bool_]:
    """(coordinates,) whether anything depends on a coordinate; after a frame was solved."""
    held = np.zeros(len(work.system.gradient), dtype=np.bool_)
    for k in range(len(held)):
        held[k] = work.system.hessian[k, k] != 0.0 or np.any(work.system.rows[:, k] != 0.0)
    return held


@compiled
def _unwind(problem: Problem, seen: Array, value: Array, near: Array, q: Array, work: IkWorkspace) -> None:
    """Take whole turns off angles that are more than half a turn away from a posture, where no marker moves by it."""
    evaluate_pose(problem.skeleton, q, work.pose)
    before = _merit(problem, seen, value, q, work)
    for k in range(len(q)):
        turns = round((q[k] - near[k]) / TURN)
        wound = q[k]
        q[k] = wound - TURN * turns
        bounds = problem.bounds
        is_within = bounds.lowest[k] <= q[k] <= bounds.highest[k] and not bounds.is_locked[k]
        evaluate_pose(problem.skeleton, q, work.pose)
        if not (problem.is_angle[k] and is_within and _merit(problem, seen, value, q, work) < before + ROUND_OFF):
            q[k] = wound


@compiled
def _merit(problem: Problem, seen: Array, value: Array, q: Array, work: IkWorkspace) -> float:
    """Cost, and the gap beside it."""
    gap = evaluate_gap(problem.constraints, q, work.pose, work.trial_gap)
    return gap + evaluate_cost(problem.markers, Targets(seen, work.share, value, problem.pull), q, work.pose)
