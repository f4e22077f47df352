"""The optimum of one frame: Gauss–Newton on the Karush–Kuhn–Tucker system, then Newton with the exact Hessian.

    ( B  Gᵀ ) (d)   (−∇f)
    ( G  0  ) (λ) = (−g )          within the bounds of clamped coordinates (step.py)

Gauss–Newton comes near from afar; at residuals of centimetres it gains only a digit in two steps, so the last steps
take the Hessian of the Lagrangian. A step is accepted where the merit f + λ·g + ½ ρ |g|² falls about as much as
predicted; otherwise the Levenberg–Marquardt damping grows (Nocedal, Wright, Numerical Optimization, 2006, ch. 10.3 and
17.4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_with_allocation
from solver.inverse_kinematics.linearise import (
    ConstraintTable,
    LeastSquares,
    Targets,
    TrackedMarkers,
    add_curvature,
    evaluate_cost,
    evaluate_gap,
    fill_constraint_rows,
    linearise,
)
from solver.inverse_kinematics.skeleton import PoseWorkspace, Skeleton, differentiate_screws, evaluate_pose
from solver.inverse_kinematics.step import FREE, LOCKED, Bounds, StepWorkspace, solve_step

Array = NDArray[np.float64]

SOLVED, NOT_CONVERGED, GAP_OPEN, NO_MARKERS = 0, 1, 2, 3
TOLERANCE = 1e-9  # rad or m; of what a step leaves: it shrinks again as it has shrunk from the one before
STALE_ABOVE = 0.03  # of a step's shrinking; above it the curvature is recomputed
GAP_TOLERANCE = 1e-10  # m or rad
NEWTON_BELOW = 0.03  # rad or m; from farther away Newton heads for saddles
LONGEST_TURN = 0.5  # rad
ROUND_OFF = 1e-16, 1e-13  # m², and part of the cost; a smaller change cannot be measured
MERIT_PENALTY = 10.0  # ρ, m²/m², beside marker weights whose sum is 1
LEAST_REDUCTION = 1e-4  # of the predicted one
LEAST_DAMPING, MOST_DAMPING = 1e-6, 1e3


class Problem(NamedTuple):
    """Constants of all frames. pull (coordinates,) w_k of the coordinates' own targets [m²/rad²]; is_angle
    (coordinates,) whose steps are limited.
    """

    skeleton: Skeleton
    markers: TrackedMarkers
    constraints: ConstraintTable
    bounds: Bounds
    pull: Array
    is_angle: NDArray[np.bool_]


class IkWorkspace(NamedTuple):
    """share (markers,); curvature (coordinates, coordinates), kept from frame to frame while has_curvature (1,)."""

    pose: PoseWorkspace
    system: LeastSquares
    quadratic: StepWorkspace
    share: Array
    trial: Array
    trial_gap: Array
    curvature: Array
    has_curvature: NDArray[np.bool_]


@compiled_with_allocation
def solve_frame(
    problem: Problem, seen: Array, value: Array, most_rounds: int, q: Array, work: IkWorkspace
) -> tuple[int, int]:
    """Move q to the optimum; returns its outcome and the rounds it took. Locked coordinates must be at their values.

    seen (markers, 3) with NaN where hidden, value (coordinates,). Leaves pose, gap and multipliers of q in work.
    """
    if not share_weights(problem, seen, work.share):
        return NO_MARKERS, 0
    _begin(problem, q, work)
    before, damping = np.inf, 0.0
    for rounds in range(most_rounds):
        is_exact = before < NEWTON_BELOW or (rounds == 0 and work.has_curvature[0])
        _linearise(problem, seen, value, q, work)
        if is_exact:
            if not work.has_curvature[0]:
                _keep_curvature(problem, q, work)
            work.system.hessian[:] += work.curvature
        longest, damping = _take_step(problem, seen, value, damping, q, work)
        if not np.isfinite(longest):
            break
        shrunk = longest / before if np.isfinite(before) and before > 0.0 else 1.0
        work.has_curvature[0] = is_exact and (shrunk < STALE_ABOVE or shrunk == 1.0)
        before = longest
        if longest * (min(shrunk, 1.0) if is_exact else 1.0) < TOLERANCE and damping <= LEAST_DAMPING:
            is_closed = evaluate_gap(problem.constraints, q, work.pose, work.system.gap) < GAP_TOLERANCE
            return SOLVED if is_closed else GAP_OPEN, rounds + 1
    work.has_curvature[0] = False
    evaluate_gap(problem.constraints, q, work.pose, work.system.gap)
    return NOT_CONVERGED, most_rounds


@compiled_with_allocation
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
    bounds, state = problem.bounds, work.quadratic.state
    for k in range(len(q)):
        if bounds.is_locked[k]:
            state[k] = LOCKED
            continue
        state[k] = FREE if state[k] == LOCKED else state[k]
        q[k] = min(max(q[k], bounds.lowest[k]), bounds.highest[k])
    evaluate_pose(problem.skeleton, q, work.pose)


@compiled
def _linearise(problem: Problem, seen: Array, value: Array, q: Array, work: IkWorkspace) -> None:
    pose, system = work.pose, work.system
    linearise(problem.skeleton, problem.markers, Targets(seen, work.share, value, problem.pull), q, pose, system)
    evaluate_gap(problem.constraints, q, pose, system.gap)
    fill_constraint_rows(problem.skeleton, problem.constraints, q, pose, system)


@compiled_with_allocation
def _keep_curvature(problem: Problem, q: Array, work: IkWorkspace) -> None:
    """Second-order part of the Hessian of the Lagrangian, beyond Gauss–Newton. It changes little between steps and
    frames, so it is kept until steps no longer shrink well.
    """
    work.curvature[:] = work.system.hessian
    differentiate_screws(problem.skeleton, q, work.pose)
    add_curvature(problem.skeleton, problem.constraints, work.quadratic.multipliers, q, work.pose, work.system)
    for k in range(len(q)):
        for j in range(len(q)):
            exact = work.system.hessian[k, j]
            work.system.hessian[k, j] = work.curvature[k, j]
            work.curvature[k, j] = exact - work.curvature[k, j]
    work.has_curvature[0] = True


@compiled_with_allocation
def _take_step(
    problem: Problem, seen: Array, value: Array, damping: float, q: Array, work: IkWorkspace
) -> tuple[float, float]:
    """Move q by a step that lowers the merit. Returns the longest entry of the whole step, infinite where no step does,
    and the damping of the next one.
    """
    system, quadratic = work.system, work.quadratic
    targets = Targets(seen, work.share, value, problem.pull)
    cost = evaluate_cost(problem.markers, targets, q, work.pose)
    while damping < MOST_DAMPING:
        if solve_step(system, problem.bounds, q, damping, quadratic):
            longest, part = _length(problem, quadratic.step)
            if part < 1.0 and damping < 1.0:
                damping = max(10.0 * damping, LEAST_DAMPING)
                continue
            predicted = _predicted_reduction(part, system, quadratic)
            for k in range(len(q)):
                work.trial[k] = q[k] + part * quadratic.step[k]
            evaluate_pose(problem.skeleton, work.trial, work.pose)
            reduction = predicted = abs(predicted)
            if predicted > ROUND_OFF[0] + ROUND_OFF[1] * cost:
                after = evaluate_cost(problem.markers, targets, work.trial, work.pose)
                evaluate_gap(problem.constraints, work.trial, work.pose, work.trial_gap)
                after += _penalty(quadratic.multipliers, work.trial_gap)
                reduction = cost + _penalty(quadratic.multipliers, system.gap) - after
            if reduction >= LEAST_REDUCTION * predicted:
                q[:] = work.trial
                return longest, _next_damping(damping, reduction, predicted)
        damping = max(10.0 * damping, LEAST_DAMPING)
    evaluate_pose(problem.skeleton, q, work.pose)
    return np.inf, damping


@compiled
def _length(problem: Problem, step: Array) -> tuple[float, float]:
    """Longest entry of a step, and the part of it that turns no angle too far."""
    longest, turned = 0.0, 0.0
    for k in range(len(step)):
        longest = max(longest, abs(step[k]))
        if problem.is_angle[k]:
            turned = max(turned, abs(step[k]))
    return longest, min(1.0, LONGEST_TURN / turned) if turned > 0.0 else 1.0


@compiled
def _penalty(multipliers: Array, gap: Array) -> float:
    """λ·g + ½ ρ |g|², the merit beyond the cost."""
    penalty = 0.0
    for i in range(len(gap)):
        penalty += (multipliers[i] + 0.5 * MERIT_PENALTY * gap[i]) * gap[i]
    return penalty


@compiled
def _predicted_reduction(part: float, system: LeastSquares, quadratic: StepWorkspace) -> float:
    """Reduction of the merit that the quadratic programme predicts for a part of the step."""
    step, multipliers, fall = quadratic.step, quadratic.multipliers, 0.0
    for k in range(len(step)):
        fall -= part * system.gradient[k] * step[k]
        for j in range(len(step)):
            fall -= 0.5 * part**2 * step[k] * system.hessian[k, j] * step[j]
    for i in range(len(system.gap)):
        before, after = system.gap[i], system.gap[i]
        for k in range(len(step)):
            after += part * system.rows[i, k] * step[k]
        fall += multipliers[i] * (before - after) + 0.5 * MERIT_PENALTY * (before**2 - after**2)
    return fall


@compiled
def _next_damping(damping: float, reduction: float, predicted: float) -> float:
    if reduction >= 0.75 * predicted:
        return 0.1 * damping if damping > 10.0 * LEAST_DAMPING else 0.0
    return max(4.0 * damping, LEAST_DAMPING) if reduction < 0.25 * predicted else damping
