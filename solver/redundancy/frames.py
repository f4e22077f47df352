"""Solve the frames of many scenarios in order, each from the solution of the previous frame; compiled.

Newton's method from the multipliers of the previous frame nearly always converges. Where it does not, an interior-point
method converges and Newton's method finishes, so that a solution does not depend on the starting point.

Newton's method on the optimality conditions of the problem of one frame (problem.py), from a guess of v.

Stationarity makes a a function of v alone, a = Mᵀ v / q clamped to its bounds. What remains are the equalities, and
λ = projection of λ − s onto the cone: equations with kinks, for which Newton's method still converges fast (semismooth;
Qi & Sun, Math. Program. 58, 1993). From the previous frame's v it needs two or three steps and ends at round-off; from
a distant v it may diverge.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.dense import columns_times, copy, divide, factor, inner_product, rows_times_rows
from solver.redundancy import effort
from solver.redundancy.interior_point import (
    LARGEST_EFFORT,
    InteriorWorkspace,
    Iterate,
    Ray,
    RowSystem,
    SearchDirection,
    effort_of_eliminated,
    interior_point,
    is_certificate,
    project,
    project_rows,
)
from solver.redundancy.problem import (
    BEYOND_RATE,
    INFEASIBLE,
    NOT_CONVERGED,
    SOLVED,
    VIOLATION_LIMIT,
    ActivationRates,
    FrameProblem,
    SequenceSolution,
    WarmStart,
    reachable,
)
from solver.redundancy.reduction import Reduction

Array = NDArray[np.float64]

_reachable = compiled(reachable)
activation, activation_per_slope = compiled(effort.activation), compiled(effort.activation_per_slope)
EFFORT_SHARE = 1e-6  # weight of effort relative to violation where a problem is infeasible
LEAST_SHARE = 1e-8  # below which multipliers no longer determine activations
FAR = 1e3  # a target, in rows of the size of activations
AT_BOUND = 1e-9  # distance of an activation from its bound
NEWTON_GOAL = 1e-11  # norm of the errors at which it stops
MOST_STEPS = 12
SHORTEST_STEP = 0.05  # of step halving


def solve_frames(reduction: Reduction, t: Array, rates: ActivationRates, start: WarmStart) -> SequenceSolution:
    """Solve all frames of all scenarios, with t (scenarios, frames, m); start is left as the frame after them needs it.

    The one caller of the compiled solver: for blocks of a motion, frames as they come, and quadratic programs.
    """
    (scenarios, frames, rows), unknowns = t.shape, len(reduction.cost)
    solution = SequenceSolution(
        a=np.empty((scenarios, frames, unknowns)),
        v=np.empty((scenarios, frames, rows)),
        codes=np.empty((scenarios, frames), np.int8),
    )
    solve_activations(reduction, t, rates, start, allocate_frame(unknowns, rows), solution)
    return solution


@compiled_for_python
def solve_activations(
    reduced: Reduction,
    t: Array,
    rates: ActivationRates,
    start: WarmStart,
    work: FrameWorkspace,
    solution: SequenceSolution,
) -> None:
    """Solve every frame of every scenario, with t (scenarios, frames, m), and fill solution; start is read, and left as
    the next frame needs it.

    Activations a change no faster than first-order activation dynamics allow. Where the code is INFEASIBLE, a is the
    point of least violation.
    """
    widest = rates.widest
    for scenario in range(t.shape[0]):
        (lower, upper), guess = start.bounds[scenario], start.multipliers[scenario]
        for k in range(t.shape[1]):
            a, v = solution.a[scenario, k], solution.v[scenario, k]
            copy(guess, v)
            frame = FrameProblem(
                reduced.cost,
                reduced.rows[k],
                reduced.effort[k],
                t[scenario, k],
                reduced.equalities,
                lower,
                upper,
                reduced.exponent,
            )
            code = _solve_frame(frame, widest, work, a, v)
            solution.codes[scenario, k] = code
            if code in (SOLVED, BEYOND_RATE):
                _set_rate_bounds(rates, a, lower, upper)
                copy(v, guess)
            else:
                _set_widest_bounds(widest, lower, upper)


@compiled
def _solve_frame(problem: FrameProblem, widest: Array, work: FrameWorkspace, a: Array, v: Array) -> int:
    """Solve within the bounds; if infeasible, within the widest, which stay in lower and upper; else violate least.

    If the interior-point method finds no certificate of infeasibility, as with distant targets, the multipliers of the
    least violation are one, except near round-off. A solution beyond LARGEST_EFFORT counts as infeasible, so that the
    result does not depend on the start.
    """
    for attempt in range(2):
        if attempt:
            _set_widest_bounds(widest, problem.lower, problem.upper)
        code = _solve(problem, work, a, v)
        if code == NOT_CONVERGED:
            _minimise_violation(problem, work, a, v)
            is_proved = is_certificate(problem, v, work.interior.gradient)
            code = INFEASIBLE if is_proved else _solve(problem, work, a, v)  # from the multipliers just found
        if code == SOLVED and effort_of_eliminated(problem.R, v) > LARGEST_EFFORT:
            code = INFEASIBLE
        if code != INFEASIBLE:
            return BEYOND_RATE if attempt and code == SOLVED else code
    _minimise_violation(problem, work, a, v)
    return INFEASIBLE


@compiled
def _minimise_violation(problem: FrameProblem, work: FrameWorkspace, a: Array, v: Array) -> None:
    """Violate the cone along its axis as little as possible; without a cone, or if that is not enough, the equalities
    as well.

    The violation of a row is one more eliminated unknown, in R, of weight 1 against the share of the effort, which is
    one of squares here whatever the exponent. Rows and violations are divided by the size of distant targets: limits of
    effort and violation are for rows of the size of activations.
    """
    q, M, R, t, equalities, lower, upper, exponent = problem
    cost, relaxed, rows, target, code, size = work.cost, work.relaxed, work.rows, work.target, INFEASIBLE, 1.0
    for i in range(len(t)):
        size = max(size, abs(t[i]) / FAR)
    share = max(EFFORT_SHARE / size**2, LEAST_SHARE)
    for i in range(len(q)):
        cost[i] = share * q[i] * 2 / exponent
    for i in range(len(t)):
        target[i] = t[i] / size
        for j in range(len(q)):
            rows[i, j] = M[i, j] / size
        for j in range(len(t)):
            relaxed[i, j] = R[i, j] / (share * size * size)
    violable = FrameProblem(cost, rows, relaxed, target, equalities, lower, upper, 2)
    if equalities < len(t):
        relaxed[equalities, equalities] += 0.5
        code = _solve(violable, work, a, v)
    if code == INFEASIBLE:
        for i in range(equalities):
            relaxed[i, i] += 0.5
        _solve(violable, work, a, v)
    for i in range(len(v)):
        v[i] /= share * size


@compiled
def _solve(problem: FrameProblem, work: FrameWorkspace, a: Array, v: Array) -> int:
    """Solve one problem from the guess v. The code is decided on the errors of a and v as they are returned.

    With p = 3 activations near zero follow from v with an infinite slope: if Newton's method stops there, the
    interior-point method, which has errors of its own a, gives the solution.
    """
    if newton(problem, work.newton, a, v) <= NEWTON_GOAL:
        return SOLVED
    code = interior_point(problem, work.interior, v)
    if code == INFEASIBLE:
        return INFEASIBLE
    if newton(problem, work.newton, a, v) <= VIOLATION_LIMIT:
        return SOLVED
    copy(work.interior.point.v, v)
    if problem.exponent == 3 and code == SOLVED:
        _round_to_bounds(problem, work.interior.point.a, a)
        return SOLVED
    error, _ = optimality_errors(problem, a, v, work.newton.free_inverse, work.newton.error)
    return SOLVED if error <= VIOLATION_LIMIT else NOT_CONVERGED


@compiled
def _round_to_bounds(problem: FrameProblem, interior: Array, a: Array) -> None:
    """Activations of the interior-point method, at a bound where they are as near to it as rounding."""
    for i in range(len(a)):
        a[i] = interior[i]
        if a[i] - problem.lower[i] < AT_BOUND:
            a[i] = problem.lower[i]
        if problem.upper[i] - a[i] < AT_BOUND:
            a[i] = problem.upper[i]


@compiled
def _set_widest_bounds(widest: Array, lower: Array, upper: Array) -> None:
    for i in range(len(lower)):
        lower[i], upper[i] = widest[0, i], widest[1, i]


@compiled
def _set_rate_bounds(rates: ActivationRates, a: Array, lower: Array, upper: Array) -> None:
    """Bounds of the next frame."""
    _set_widest_bounds(rates.widest, lower, upper)
    for i in range(len(a)):
        slowest, fastest = _reachable(a[i], rates.rise[i], rates.fall[i])
        if rates.fall[i] < np.inf and slowest > lower[i]:
            lower[i] = slowest
        if rates.rise[i] < np.inf and fastest < upper[i]:
            upper[i] = fastest


@compiled
def newton(problem: FrameProblem, work: NewtonWorkspace, a: Array, v: Array) -> float:
    """Improve v and fill a; returns the norm of the remaining errors, infinite if a step cannot be computed."""
    (matrix, order), free_inverse, error, previous, change = work
    size, ray = optimality_errors(problem, a, v, free_inverse, error)
    for _ in range(MOST_STEPS):
        if size <= NEWTON_GOAL:
            break
        rows_times_rows(problem.M, free_inverse, problem.R, matrix)
        if problem.equalities < len(problem.t):
            project_rows(matrix, problem.equalities, ray)
        if not factor(matrix, order):
            return np.inf
        divide(matrix, order, error)
        copy(error, change)
        copy(v, previous)
        length, before = 1.0, size
        while True:
            for i in range(len(v)):
                v[i] = previous[i] - length * change[i]
            size, ray = optimality_errors(problem, a, v, free_inverse, error)
            if size < before or length < SHORTEST_STEP:
                break
            length *= 0.5
    return size


@compiled
def optimality_errors(
    problem: FrameProblem, a: Array, v: Array, free_inverse: Array, error: Array
) -> tuple[float, Ray]:
    """Fill a from v, error with the errors of the rows and free_inverse with 1/q where a is between its bounds, else 0;
    returns the norm of the errors, and λ − s.

    The error of an equality is its residual, that of the cone λ − projection of (λ − s).
    """
    q, M, R, t, p, lower, upper, exponent = problem
    columns_times(M, v, a)
    for i in range(len(q)):
        free = activation(q[i], a[i], exponent)
        a[i] = min(max(free, lower[i]), upper[i])
        free_inverse[i] = activation_per_slope(q[i], a[i], exponent) if a[i] == free else 0.0
    for i in range(len(t)):
        error[i] = inner_product(M[i], a) + inner_product(R[i], v) - t[i]
    ray = (0.0, 0.0, 0.0)
    if p < len(t):
        ray = (v[p] - error[p], v[p + 1] - error[p + 1], v[p + 2] - error[p + 2])
        near = project(ray)
        for i in range(3):
            error[p + i] = v[p + i] - near[i]
    return sqrt(inner_product(error, error)), ray


class NewtonWorkspace(NamedTuple):
    """free_inverse (n,), error, previous and change (m,) of Newton's method."""

    system: RowSystem
    free_inverse: Array
    error: Array
    previous: Array
    change: Array


class FrameWorkspace(NamedTuple):
    """For n muscles and m rows: cost (n,), relaxed (m, m), rows (m, n) and target (m,) of _minimise_violation, and
    what the two methods need.
    """

    cost: Array
    relaxed: Array
    rows: Array
    target: Array
    newton: NewtonWorkspace
    interior: InteriorWorkspace


def allocate_frame(n: int, m: int) -> FrameWorkspace:
    """Working memory for n muscles and m rows."""
    system = RowSystem(matrix=np.zeros((m, m)), order=np.zeros(m, np.int64))
    return FrameWorkspace(
        cost=np.zeros(n),
        relaxed=np.zeros((m, m)),
        rows=np.zeros((m, n)),
        target=np.zeros(m),
        newton=NewtonWorkspace(system, np.zeros(n), np.zeros(m), np.zeros(m), np.zeros(m)),
        interior=InteriorWorkspace(
            system=system,
            point=Iterate(np.zeros(n), np.zeros((2, n)), np.zeros(m), np.zeros((2, n))),
            step=SearchDirection(np.zeros(n), np.zeros((2, n)), np.zeros(m)),
            error=np.zeros(m),
            inverse=np.zeros(n),
            gradient=np.zeros(n),
            aim=np.zeros((2, n)),
        ),
    )
