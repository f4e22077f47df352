"""The step of one frame: a quadratic programme on the linearised constraints, within the bounds; compiled.

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

from solver.compiled import compiled
from solver.inverse_kinematics.linearise import LeastSquares
from solver.multibody.tables import Indices

Array = NDArray[np.float64]

PENALTY = 1e3  # m²/m², beside marker weights whose sum is 1
FLOOR = 1e-12  # m²/rad²; holds what no marker sees
DEPENDENT_BELOW = 1e-10  # of G K⁻¹ Gᵀ, whose entries are about 1/ρ
SMALLEST_PIVOT = 1e-15
MULTIPLIER_TOLERANCE = 1e-13
MOST_AT_ONCE, MOST_CHANGES = 8, 200
FREE, LOCKED, AT_LOWEST, AT_HIGHEST = 0, 1, 2, 3


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
