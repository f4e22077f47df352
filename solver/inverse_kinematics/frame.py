"""The optimum of one frame: Gauss–Newton on the Karush–Kuhn–Tucker system, then Newton with the exact Hessian.

    ( H  Gᵀ ) (dq)   (−∇f)
    ( G  0  ) (λ ) = (−g )

Gauss–Newton comes near from afar; at residuals of centimetres it gains only a digit in two steps, so the last steps
take the Hessian of the Lagrangian. Clamped coordinates are held by an active set; locked ones are given. A step is
shortened where the merit f + ν Σ|g| would grow (Nocedal, Wright, Numerical Optimization, 2006, ch. 16.5 and 18.4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled
from solver.dense import divide, factor
from solver.inverse_kinematics.linearise import (
    ConstraintTable,
    LeastSquares,
    TrackedMarkers,
    add_curvature,
    evaluate_cost,
    evaluate_gap,
    fill_constraint_rows,
    linearise,
)
from solver.inverse_kinematics.skeleton import PoseWorkspace, Skeleton, differentiate_screws, evaluate_pose
from solver.multibody.tables import Indices

Array = NDArray[np.float64]

SOLVED, NOT_CONVERGED, GAP_OPEN, NO_MARKERS = 0, 1, 2, 3
TOLERANCE = 1e-9  # rad or m; of what a step leaves: it shrinks again as it has shrunk from the one before
STALE_ABOVE = 0.03  # of a step's shrinking; above it the curvature is recomputed
GAP_TOLERANCE = 1e-10  # m or rad
NEWTON_BELOW = 0.03  # rad or m; from farther away Newton diverges
LONGEST_STEP = 0.5  # rad or m
UNSEARCHED_BELOW = 1e-3  # rad or m; of a step so short the merit's change is round-off
DAMPING = 1e-12  # m²/rad²; holds what no marker sees
REGULARISATION = 1e-13  # of rows of the constraints that depend on each other
FREE, LOCKED, AT_LOWEST, AT_HIGHEST = 0, 1, 2, 3


class Bounds(NamedTuple):
    """lowest, highest (coordinates,), infinite where a coordinate is not clamped; is_locked (coordinates,)."""

    lowest: Array
    highest: Array
    is_locked: NDArray[np.bool_]


class Problem(NamedTuple):
    """Constants of all frames. pull (coordinates,) w_k of the coordinates' own targets [m²/rad²]."""

    skeleton: Skeleton
    markers: TrackedMarkers
    constraints: ConstraintTable
    bounds: Bounds
    pull: Array


class IkWorkspace(NamedTuple):
    """share (markers,); multipliers λ (rows,); state (coordinates,) FREE, LOCKED, …; curvature (coordinates,
    coordinates), kept from frame to frame while has_curvature (1,); the rest is room to work.
    """

    pose: PoseWorkspace
    system: LeastSquares
    share: Array
    multipliers: Array
    state: Indices
    matrix: Array
    order: Indices
    step: Array
    trial: Array
    curvature: Array
    has_curvature: NDArray[np.bool_]


@compiled
def solve_frame(
    problem: Problem, seen: Array, value: Array, most_rounds: int, q: Array, work: IkWorkspace
) -> tuple[int, int]:
    """Move q to the optimum; returns its outcome and the rounds it took. Locked coordinates must be at their values.

    seen (markers, 3) with NaN where hidden, value (coordinates,). Leaves pose, gap and multipliers of q in work.
    """
    if not share_weights(problem, seen, work.share):
        return NO_MARKERS, 0
    _begin(problem, q, work)
    longest_before, exact_before, newton_below = np.inf, np.inf, NEWTON_BELOW
    for rounds in range(most_rounds):
        is_exact = longest_before < newton_below or (rounds == 0 and work.has_curvature[0])
        _linearise(problem, seen, value, q, work)
        if is_exact:
            if not work.has_curvature[0]:
                _keep_curvature(problem, q, work)
            work.system.hessian[:] += work.curvature
        longest = _solve_step(work)
        if is_exact and (longest > min(exact_before, NEWTON_BELOW) or _bend(work) < 0.0):  # still too far away
            newton_below, work.has_curvature[0] = 0.2 * min(longest_before, NEWTON_BELOW), False
            longest_before, exact_before = np.inf, np.inf
            continue
        taken = _take_step(problem, seen, value, longest, q, work)
        shrunk = longest / longest_before if np.isfinite(longest_before) and longest_before > 0.0 else 1.0
        work.has_curvature[0] = is_exact and (shrunk < STALE_ABOVE or shrunk == 1.0)
        longest_before, exact_before = longest, longest if is_exact else np.inf
        if longest * (min(shrunk, 1.0) if is_exact else 1.0) < TOLERANCE and taken == 1.0 and not _release(work):
            is_closed = evaluate_gap(problem.constraints, q, work.pose, work.system.gap) < GAP_TOLERANCE
            return SOLVED if is_closed else GAP_OPEN, rounds + 1
    work.has_curvature[0] = False
    evaluate_gap(problem.constraints, q, work.pose, work.system.gap)
    return NOT_CONVERGED, most_rounds


@compiled
def share_weights(problem: Problem, seen: Array, share: Array) -> bool:
    """Weights over the sum of those of the visible markers; False where nothing at all is to be met."""
    total = 0.0
    for m in range(len(share)):
        is_seen = np.isfinite(seen[m, 0]) and np.isfinite(seen[m, 1]) and np.isfinite(seen[m, 2])
        share[m] = problem.markers.weight[m] if is_seen else 0.0
        total += share[m]
    for m in range(len(share)):
        share[m] = share[m] / total if total > 0.0 else 0.0
    return total > 0.0 or (len(share) == 0 and problem.pull.max() > 0.0)


@compiled
def _begin(problem: Problem, q: Array, work: IkWorkspace) -> None:
    bounds = problem.bounds
    for k in range(len(q)):
        work.state[k] = LOCKED if bounds.is_locked[k] else FREE
        if not bounds.is_locked[k]:
            q[k] = min(max(q[k], bounds.lowest[k]), bounds.highest[k])
    evaluate_pose(problem.skeleton, q, work.pose)


@compiled
def _linearise(problem: Problem, seen: Array, value: Array, q: Array, work: IkWorkspace) -> None:
    pose, system = work.pose, work.system
    linearise(problem.skeleton, problem.markers, seen, work.share, problem.pull, value, q, pose, system)
    evaluate_gap(problem.constraints, q, pose, system.gap)
    fill_constraint_rows(problem.skeleton, problem.constraints, q, pose, system)


@compiled
def _keep_curvature(problem: Problem, q: Array, work: IkWorkspace) -> None:
    """Second-order part of the Hessian of the Lagrangian, beyond Gauss–Newton. It changes little between steps and
    frames, so it is kept until steps no longer shrink well.
    """
    work.curvature[:] = work.system.hessian
    differentiate_screws(problem.skeleton, q, work.pose)
    add_curvature(problem.skeleton, problem.constraints, work.multipliers, q, work.pose, work.system)
    for k in range(len(q)):
        for j in range(len(q)):
            exact = work.system.hessian[k, j]
            work.system.hessian[k, j] = work.curvature[k, j]
            work.curvature[k, j] = exact - work.curvature[k, j]
    work.has_curvature[0] = True


@compiled
def _solve_step(work: IkWorkspace) -> float:
    """Fill step with dq and then λ, and return the longest entry of dq; coordinates that are held do not move."""
    system, matrix, step = work.system, work.matrix, work.step
    count, rows = len(system.gradient), len(system.gap)
    for k in range(count):
        is_free = work.state[k] == FREE
        for j in range(count):
            matrix[k, j] = system.hessian[k, j] if is_free and work.state[j] == FREE else 0.0
        matrix[k, k] = matrix[k, k] + DAMPING if is_free else 1.0
        step[k] = -system.gradient[k] if is_free else 0.0
    for i in range(rows):
        is_empty = True
        for k in range(count):
            entry = system.rows[i, k] if work.state[k] == FREE else 0.0
            matrix[count + i, k] = matrix[k, count + i] = entry
            is_empty = is_empty and entry == 0.0
        for j in range(rows):
            matrix[count + i, count + j] = 0.0
        matrix[count + i, count + i] = -1.0 if is_empty else -REGULARISATION  # locks alone may have taken a row
        step[count + i] = -system.gap[i]
    if not factor(matrix, work.order):
        return np.inf
    divide(matrix, work.order, step)
    longest = 0.0
    for k in range(count):
        longest = max(longest, abs(step[k]))
    return longest


@compiled
def _bend(work: IkWorkspace) -> float:
    """Curvature of the Lagrangian along the step."""
    bent = 0.0
    for k in range(len(work.system.gradient)):
        for j in range(len(work.system.gradient)):
            bent += work.step[k] * work.system.hessian[k, j] * work.step[j]
    return bent


@compiled
def _take_step(problem: Problem, seen: Array, value: Array, longest: float, q: Array, work: IkWorkspace) -> float:
    """Move q along the step as far as is good, take over its multipliers, and return the part that was taken."""
    count, bounds = len(q), problem.bounds
    if not np.isfinite(longest):
        return 0.0
    part, blocking = min(1.0, LONGEST_STEP / longest) if longest > 0.0 else 1.0, -1
    for k in range(count):
        change = work.step[k]
        if work.state[k] != FREE or change == 0.0:
            continue
        room = (bounds.highest[k] if change > 0.0 else bounds.lowest[k]) - q[k]
        if room / change < part:
            part, blocking = max(room / change, 0.0), k
    price = 0.0
    for i in range(len(work.multipliers)):
        work.multipliers[i] = work.step[count + i]
        price = max(price, abs(work.multipliers[i]))
    searched = _search(problem, seen, value, 2.0 * price + 1e-6, part, part * longest > UNSEARCHED_BELOW, q, work)
    if searched == part and blocking >= 0:
        is_up = work.step[blocking] > 0.0
        work.state[blocking] = AT_HIGHEST if is_up else AT_LOWEST
        q[blocking] = bounds.highest[blocking] if is_up else bounds.lowest[blocking]
        evaluate_pose(problem.skeleton, q, work.pose)
    return searched


@compiled
def _search(
    problem: Problem,
    seen: Array,
    value: Array,
    price: float,
    part: float,
    is_searched: bool,
    q: Array,
    work: IkWorkspace,
) -> float:
    """Halve the step until the merit no longer grows; q becomes the point reached."""
    pose, gap = work.pose, work.system.gap
    before = 0.0
    if is_searched:
        before = evaluate_cost(problem.markers, seen, work.share, problem.pull, value, q, pose)
        before += price * evaluate_gap(problem.constraints, q, pose, gap)
    for _ in range(8):
        for k in range(len(q)):
            work.trial[k] = q[k] + part * work.step[k]
        evaluate_pose(problem.skeleton, work.trial, pose)
        if not is_searched:
            break
        merit = evaluate_cost(problem.markers, seen, work.share, problem.pull, value, work.trial, pose)
        merit += price * evaluate_gap(problem.constraints, work.trial, pose, gap)
        if merit < before:
            break
        part *= 0.5
    for k in range(len(q)):
        q[k] = work.trial[k]
    return part


@compiled
def _release(work: IkWorkspace) -> bool:
    """Free the clamped coordinate that pushes inwards hardest; False where none does, so that this is the optimum."""
    system, best, worst = work.system, -1, 1e-12
    for k in range(len(system.gradient)):
        if work.state[k] != AT_LOWEST and work.state[k] != AT_HIGHEST:
            continue
        slope = system.gradient[k]
        for i in range(len(system.gap)):
            slope += system.rows[i, k] * work.multipliers[i]
        inwards = -slope if work.state[k] == AT_LOWEST else slope
        if inwards > worst:
            best, worst = k, inwards
    if best >= 0:
        work.state[best] = FREE
    return best >= 0
