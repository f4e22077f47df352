"""The optimum of one frame: Gauss–Newton on the Karush–Kuhn–Tucker system, then Newton with the exact Hessian.

    ( B  Gᵀ ) (d)   (−∇f)
    ( G  0  ) (λ) = (−g )          within the bounds of clamped coordinates (solve_step)

Gauss–Newton comes near from afar; at residuals of centimetres it gains only a digit in two steps, so the last steps
take the Hessian of the Lagrangian. A step is accepted where the merit f + λ·g + ½ ρ |g|² falls about as much as
predicted; otherwise the Levenberg–Marquardt damping grows (Nocedal, Wright, Numerical Optimization, 2006, ch. 10.3 and
17.4).

The step of one frame is a quadratic programme on the linearised constraints, within the bounds:

    minimise  ∇f·d + ½ dᵀ(B + μ D)d   so that   G d = −g,   lowest ≤ q + d ≤ highest

with D the diagonal of B and the damping μ of Levenberg and Marquardt. The constraints enter as an augmented Lagrangian
(Nocedal, Wright, Numerical Optimization, 2006, ch. 17.3), which leaves the solution as it is and makes the matrix
positive definite wherever B is so along the constraints: then Cholesky's factors and a Schur complement solve it.

The bounds are met by a primal–dual active set (Hintermüller, Ito, Kunisch 2003). It may cycle; after MOST_AT_ONCE
changes of the set only the first coordinate that violates its condition changes (Murty 1974), which ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_with_allocation
from solver.inverse_kinematics.linearise import (
    ConstraintTable,
    CoordinatePull,
    LeastSquares,
    Targets,
    TrackedMarkers,
    add_curvature,
    evaluate_cost,
    evaluate_gap,
    fill_constraint_rows,
    linearise,
)
from solver.inverse_kinematics.pose import PoseWorkspace, Skeleton, differentiate_screws, evaluate_pose
from solver.multibody.body_tables import Indices

Array = NDArray[np.float64]

SOLVED, NOT_CONVERGED, GAP_OPEN, NO_MARKERS = 0, 1, 2, 3
TOLERANCE = 1e-9  # rad or m; of the error after a step: it shrinks again as it has shrunk from the one before
STALE_ABOVE = 0.03  # of a step's shrinking; above it the curvature is recomputed
GAP_TOLERANCE = 1e-10  # m or rad
NEWTON_BELOW = 0.03  # rad or m; from farther away Newton heads for saddles
LONGEST_TURN = 0.5  # rad
ROUND_OFF = 1e-16, 1e-13  # m², and part of the cost; a smaller change cannot be measured
MERIT_PENALTY = 10.0  # ρ, m²/m², beside marker weights whose sum is 1
LEAST_REDUCTION = 1e-4  # of the predicted one
LEAST_DAMPING, MOST_DAMPING = 1e-6, 1e3
PENALTY = 1e3  # m²/m², beside marker weights whose sum is 1
FLOOR = 1e-12  # m²/rad²; holds what no marker sees
DEPENDENT_BELOW = 1e-10  # of G K⁻¹ Gᵀ, whose entries are about 1/ρ
SMALLEST_PIVOT = 1e-15
MULTIPLIER_TOLERANCE = 1e-13
MOST_AT_ONCE, MOST_CHANGES = 8, 200
FREE, LOCKED, AT_LOWEST, AT_HIGHEST = 0, 1, 2, 3


class Problem(NamedTuple):
    """Constants of all frames. pull of the coordinates to their targets; is_angle (coordinates,) whose
    steps are limited.
    """

    skeleton: Skeleton
    markers: TrackedMarkers
    constraints: ConstraintTable
    bounds: Bounds
    pull: CoordinatePull
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
    return total > 0.0 or (len(share) == 0 and problem.pull.weight.max() > 0.0)


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


class Bounds(NamedTuple):
    """lowest, highest (coordinates,), infinite where a coordinate is not clamped; is_locked (coordinates,)."""

    lowest: Array
    highest: Array
    is_locked: NDArray[np.bool_]


class StepWorkspace(NamedTuple):
    """step d (coordinates,), multipliers λ (rows,), state (coordinates,) FREE, LOCKED, …; then working memory."""

    step: Array
    multipliers: Array
    state: Indices
    hessian: Array
    factors: Array
    side: Array
    solved: Array
    schur: Array


def allocate_step(coordinates: int, rows: int) -> StepWorkspace:
    return StepWorkspace(
        np.zeros(coordinates),
        np.zeros(rows),
        np.zeros(coordinates, dtype=np.int64),
        np.zeros((coordinates, coordinates)),
        np.zeros((coordinates, coordinates)),
        np.zeros(coordinates),
        np.zeros((rows, coordinates)),
        np.zeros((rows, rows)),
    )


@compiled
def solve_step(system: LeastSquares, bounds: Bounds, q: Array, damping: float, work: StepWorkspace) -> bool:
    """Fill step, multipliers and state, from the state as a guess; False where the matrix is not positive definite."""
    _augment(system, damping, work)
    for changes in range(MOST_CHANGES):
        if not _solve_with_state(system, bounds, q, work):
            return False
        if not _change_state(system, bounds, q, len(q) if changes < MOST_AT_ONCE else 1, work):
            return True
    return False


@compiled
def _augment(system: LeastSquares, damping: float, work: StepWorkspace) -> None:
    """hessian becomes B + μ D + ρ GᵀG."""
    count, rows = len(system.gradient), len(system.gap)
    for k in range(count):
        for j in range(k + 1):
            entry = 0.0
            for i in range(rows):
                entry += system.rows[i, k] * system.rows[i, j]
            work.hessian[k, j] = work.hessian[j, k] = system.hessian[k, j] + PENALTY * entry
        work.hessian[k, k] += damping * abs(system.hessian[k, k]) + FLOOR


@compiled
def _solve_with_state(system: LeastSquares, bounds: Bounds, q: Array, work: StepWorkspace) -> bool:
    """step and multipliers where coordinates that are not free go to their bounds."""
    count, rows, step = len(q), len(system.gap), work.step
    for k in range(count):
        step[k] = 0.0
        if work.state[k] == AT_LOWEST:
            step[k] = bounds.lowest[k] - q[k]
        elif work.state[k] == AT_HIGHEST:
            step[k] = bounds.highest[k] - q[k]
    for k in range(count):
        if work.state[k] != FREE:
            work.side[k] = step[k]
            continue
        work.side[k] = -system.gradient[k]
        for i in range(rows):
            work.side[k] -= PENALTY * system.rows[i, k] * system.gap[i]
        for j in range(count):
            if work.state[j] != FREE:
                work.side[k] -= work.hessian[k, j] * step[j]
    if not _factor(work):
        return False
    _divide(work.factors, work.side)
    for k in range(count):
        step[k] = work.side[k]
    _meet_constraints(system, work)
    return True


@compiled
def _factor(work: StepWorkspace) -> bool:
    """Cholesky's factor of the free part of the hessian, with the inverse of its diagonal; False if there is none."""
    count, L = len(work.state), work.factors
    for k in range(count):
        for j in range(k + 1):
            entry = work.hessian[k, j]
            if work.state[k] != FREE or work.state[j] != FREE:
                entry = 1.0 if k == j else 0.0
            for i in range(j):
                entry -= L[k, i] * L[j, i]
            if j < k:
                L[k, j] = entry * L[j, j]
            elif entry > SMALLEST_PIVOT:
                L[k, k] = 1.0 / np.sqrt(entry)
            else:
                return False
    return True


@compiled
def _divide(L: Array, x: Array) -> None:
    """x becomes (L Lᵀ)⁻¹ x."""
    count = len(x)
    for k in range(count):
        for i in range(k):
            x[k] -= L[k, i] * x[i]
        x[k] *= L[k, k]
    for k in range(count - 1, -1, -1):
        x[k] *= L[k, k]
        for i in range(k):
            x[i] -= L[k, i] * x[k]


@compiled
def _meet_constraints(system: LeastSquares, work: StepWorkspace) -> None:
    """Add to the step K⁻¹ Gᵀ λ with (G K⁻¹ Gᵀ) λ = g + G d, G and K of the free coordinates."""
    count, rows, solved, schur = len(work.step), len(system.gap), work.solved, work.schur
    for i in range(rows):
        for k in range(count):
            solved[i, k] = system.rows[i, k] if work.state[k] == FREE else 0.0
        _divide(work.factors, solved[i])
    for i in range(rows):
        work.multipliers[i] = system.gap[i]
        for k in range(count):
            work.multipliers[i] += system.rows[i, k] * work.step[k]
        for j in range(i + 1):
            entry = 0.0
            for k in range(count):
                if work.state[k] == FREE:
                    entry += system.rows[i, k] * solved[j, k]
            for c in range(j):
                entry -= schur[i, c] * schur[j, c]
            if j < i:
                schur[i, j] = entry * schur[j, j]
            else:  # a row that locks have emptied, or that others imply, has no multiplier
                schur[i, i] = 1.0 / np.sqrt(entry) if entry > DEPENDENT_BELOW else 0.0
    _divide(schur, work.multipliers)
    for i in range(rows):
        for k in range(count):
            work.step[k] -= solved[i, k] * work.multipliers[i]


@compiled
def _change_state(system: LeastSquares, bounds: Bounds, q: Array, most: int, work: StepWorkspace) -> bool:
    """Put coordinates that leave their bounds there, and free those that are pushed inwards; False where all fit.

    most  the most coordinates whose state changes
    """
    count = 0
    for k in range(len(q)):
        if work.state[k] == LOCKED or (bounds.lowest[k] == -np.inf and bounds.highest[k] == np.inf):
            continue
        if work.state[k] == FREE:
            wanted = FREE
            if q[k] + work.step[k] < bounds.lowest[k]:
                wanted = AT_LOWEST
            elif q[k] + work.step[k] > bounds.highest[k]:
                wanted = AT_HIGHEST
        else:
            pushed = _slope(system, k, work)
            wanted = work.state[k]
            if (pushed if work.state[k] == AT_HIGHEST else -pushed) > MULTIPLIER_TOLERANCE:
                wanted = FREE
        if wanted != work.state[k]:
            work.state[k] = wanted
            count += 1
            if count == most:
                break
    return count > 0


@compiled
def _slope(system: LeastSquares, k: int, work: StepWorkspace) -> float:
    """Derivative of the programme's Lagrangian with respect to a coordinate at its bound."""
    slope: float = system.gradient[k]
    for j in range(len(work.step)):
        slope += work.hessian[k, j] * work.step[j]
    for i in range(len(system.gap)):
        slope += system.rows[i, k] * (work.multipliers[i] + PENALTY * system.gap[i])
    return slope
