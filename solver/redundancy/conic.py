"""Many small convex problems that share their matrices, and the outcome of every problem.

    minimise  Σ w x²   subject to   E x = e,   lower ≤ x ≤ upper,   C x + c ∈ cone

with the second-order cone {(s, v): s ≥ |v|}. One frame of a motion is one batch: its scenarios differ in e, in the
bounds and in c only.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

VIOLATION_LIMIT = 1e-6
OPTIMALITY_LIMIT = 1e-5
LARGEST_SOLUTION = 1e3  # Σ |x| beyond which no solution is sought
EFFORT_SHARE = 1e-6  # of effort against violation, in least_violation


class ConicOutcome(StrEnum):
    """Outcome of one problem, decided on residuals computed here, never on the solver's status alone.

    INFEASIBLE     no point within the bounds meets the equalities and the cone; a certificate was checked
    NOT_CONVERGED  the solver stopped before its residuals were small
    """

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    NOT_CONVERGED = "not_converged"


@dataclass(frozen=True)
class ConicProblem:
    """A batch of problems in n unknowns with m equalities; the caller scales rows so that 1e-6 is small in each.

    weights          w (n,), not negative
    equality_matrix  E (m, n);  equality_target  e (problems, m)
    lower, upper     (problems, n); a bound is infinite in all problems or in none
    cone_matrix      C (k, n) and cone_offset c (problems, k); k = 0 where there is no cone
    """

    weights: Array
    equality_matrix: Array
    equality_target: Array
    lower: Array
    upper: Array
    cone_matrix: Array
    cone_offset: Array


@dataclass(frozen=True)
class ConicSolution:
    """Unknowns (problems, n), NaN where infeasible, with an outcome for each problem.

    violation   (problems,) largest one of an equality, a bound or the cone where the solver stopped, in the rows' units
    optimality  (problems,) larger of the stationarity residual and the duality gap over max(1, objective)
    """

    x: Array
    outcomes: tuple[ConicOutcome, ...]
    violation: Array
    optimality: Array


def solve_conic(problem: ConicProblem) -> ConicSolution:
    """Solve each problem of the batch with Clarabel.

    Raises ValueError where the arrays do not fit together; an infeasible problem is an outcome, not an error.
    """
    _ensure_shapes(problem)
    below, above = np.isfinite(problem.lower[0]), np.isfinite(problem.upper[0])
    matrix = _stacked_matrix(problem, below, above)
    targets = np.hstack(
        [problem.equality_target, problem.upper[:, above], -problem.lower[:, below], problem.cone_offset]
    )
    solver = _clarabel_solver(problem, matrix, targets[0], int(above.sum() + below.sum()))
    x = np.empty(problem.lower.shape)
    violation, optimality = np.empty((2, len(x)))
    outcomes: list[ConicOutcome] = []
    for i, target in enumerate(targets):
        solver.update(b=target)
        answer = solver.solve()
        primal, dual = np.array(answer.x), np.array(answer.z)
        violation[i] = _violation(problem, i, primal)
        optimality[i] = _optimality(problem.weights, matrix, target, primal, dual)
        if violation[i] <= VIOLATION_LIMIT and optimality[i] <= OPTIMALITY_LIMIT:
            outcomes.append(ConicOutcome.SOLVED)
        else:
            outcomes.append(
                ConicOutcome.INFEASIBLE if _is_certificate(matrix, target, dual) else ConicOutcome.NOT_CONVERGED
            )
        x[i] = np.nan if outcomes[i] is ConicOutcome.INFEASIBLE else primal
    return ConicSolution(x=x, outcomes=tuple(outcomes), violation=violation, optimality=optimality)


def least_violation(problem: ConicProblem) -> Array:
    """x (problems, n) within the bounds that violate the cone least, along its axis.

    Without a cone, or if that is not enough, equalities are violated as well; the sum of squares is minimised.
    """
    m, k = len(problem.equality_matrix), len(problem.cone_matrix)
    along_axis = np.eye(k, min(k, 1))
    x = _with_violations(problem, np.zeros((m, min(k, 1))), along_axis)
    infeasible = np.isnan(x).any(axis=1)
    if infeasible.any():
        in_equalities = np.hstack([np.zeros((m, min(k, 1))), np.eye(m)])
        in_cone = np.hstack([along_axis, np.zeros((k, m))])
        x[infeasible] = _with_violations(problem, in_equalities, in_cone)[infeasible]
    return x


def _with_violations(problem: ConicProblem, in_equalities: Array, in_cone: Array) -> Array:
    violations, problems = in_equalities.shape[1], len(problem.lower)
    unbounded = np.full((problems, violations), np.inf)
    solution = solve_conic(
        ConicProblem(
            weights=np.append(EFFORT_SHARE * problem.weights, np.ones(violations)),
            equality_matrix=np.hstack([problem.equality_matrix, in_equalities]),
            equality_target=problem.equality_target,
            lower=np.hstack([problem.lower, -unbounded]),
            upper=np.hstack([problem.upper, unbounded]),
            cone_matrix=np.hstack([problem.cone_matrix, in_cone]),
            cone_offset=problem.cone_offset,
        )
    )
    return solution.x[:, : problem.weights.size]


def _ensure_shapes(problem: ConicProblem) -> None:
    n, m, k = problem.weights.size, len(problem.equality_matrix), len(problem.cone_matrix)
    problems = len(problem.lower)
    expected = {
        "equality_matrix": (m, n),
        "equality_target": (problems, m),
        "lower": (problems, n),
        "upper": (problems, n),
        "cone_matrix": (k, n),
        "cone_offset": (problems, k),
    }
    for name, shape in expected.items():
        found = getattr(problem, name).shape
        if found != shape:
            raise ValueError(
                f"the conic problem's {name} should have shape {shape} and has {found}; give all arrays the same n"
            )


def _stacked_matrix(problem: ConicProblem, below: NDArray[np.bool_], above: NDArray[np.bool_]) -> Array:
    """Rows A of Clarabel's A x + s = b: equalities, upper bounds, lower bounds, cone."""
    unit = np.eye(problem.weights.size)
    return np.vstack([problem.equality_matrix, unit[above], -unit[below], -problem.cone_matrix])


def _clarabel_solver(problem: ConicProblem, matrix: Array, target: Array, bounds: int) -> Any:
    import clarabel
    from scipy import sparse  # both take long to import

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False  # both would forbid a new right-hand side on the same matrices
    settings.chordal_decomposition_enable = False
    cones = [clarabel.ZeroConeT(len(problem.equality_matrix)), clarabel.NonnegativeConeT(bounds)]
    if len(problem.cone_matrix):
        cones.append(clarabel.SecondOrderConeT(len(problem.cone_matrix)))
    hessian = sparse.diags_array(2 * problem.weights, format="csc")
    return clarabel.DefaultSolver(
        hessian, np.zeros(problem.weights.size), sparse.csc_matrix(matrix), target, cones, settings
    )


def _is_certificate(matrix: Array, target: Array, dual: Array) -> bool:
    """Farkas: z in the dual cone with Aᵀz = 0 and b·z < 0 proves that nothing satisfies A x + s = b.

    With |Aᵀz| up to a share of −b·z it proves that no x with Σ |x| below the inverse of that share does.
    """
    depth = -float(target @ dual)
    return depth > 0 and float(np.abs(matrix.T @ dual).max()) <= depth / LARGEST_SOLUTION


def _violation(problem: ConicProblem, i: int, x: Array) -> float:
    gaps = [
        np.abs(problem.equality_matrix @ x - problem.equality_target[i]),
        problem.lower[i] - x,
        x - problem.upper[i],
    ]
    if len(problem.cone_matrix):
        ray = problem.cone_matrix @ x + problem.cone_offset[i]
        gaps.append(np.atleast_1d(np.linalg.norm(ray[1:]) - ray[0]))
    return max(0.0, *(float(gap.max(initial=0.0)) for gap in gaps))


def _optimality(weights: Array, matrix: Array, target: Array, x: Array, dual: Array) -> float:
    objective = float(weights @ x**2)
    stationarity = float(np.abs(2 * weights * x + matrix.T @ dual).max())
    gap = abs(2 * objective + float(target @ dual))  # x·P x + b·z vanishes at the optimum
    return max(stationarity, gap) / max(1.0, objective)
