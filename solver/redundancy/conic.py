"""Frames by Clarabel: many small convex problems that share their matrices, and the outcome of every problem.

    minimise  Σ w xᵖ   subject to   E x = e,   lower ≤ x ≤ upper,   C x + c ∈ cone

with the second-order cone {(s, v): s ≥ |v|} and p = 2, or 3 for the first unknowns, which are not negative. One frame
of a motion is one batch: its scenarios differ in e, in the bounds and in c only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.redundancy.effort import Effort
from solver.redundancy.problem import FrameOutcome, Outcomes, RedundancyProblem

Array = NDArray[np.float64]

VIOLATION_LIMIT = 1e-6
OPTIMALITY_LIMIT = 1e-5
RANK_TOLERANCE = 1e-9
LARGEST_SOLUTION = 1e3  # Σ |x| beyond which no solution is sought
EFFORT_SHARE = 1e-6  # of effort against violation, in least_violation
FAR = 100.0  # a target, in rows of the size of x
LARGEST_SIZE = 100.0  # of such a target, up to which efforts keep their share
CUBE_TOLERANCE = 1e-11  # of Clarabel for cubes, whose slope is small where the unknown is


@dataclass(frozen=True)
class ConicProblem:
    """A batch of problems in n unknowns with m equalities; the caller scales rows so that 1e-6 is small in each.

    weights          w (n,), not negative
    equality_matrix  E (m, n);  equality_target  e (problems, m)
    lower, upper     (problems, n); a bound is infinite in all problems or in none
    cone_matrix      C (k, n) and cone_offset c (problems, k); k = 0 where there is no cone
    cubed            number of unknowns, the first ones, whose effort is w x³; their lower bounds are not negative
    """

    weights: Array
    equality_matrix: Array
    equality_target: Array
    lower: Array
    upper: Array
    cone_matrix: Array
    cone_offset: Array
    cubed: int = 0

    @property
    def effort(self) -> Effort:
        """Σ w xᵖ."""
        return Effort(self.weights, self.cubed, exponent=3)


def solve_conic(problem: ConicProblem) -> tuple[Array, Outcomes]:
    """x (problems, n), NaN where infeasible, and outcomes (problems,) of a batch.

    SOLVED, INFEASIBLE with a certificate that was checked, or NOT_CONVERGED: decided on residuals computed here, never
    on Clarabel's status alone.
    """
    x, outcomes = _solve_each(problem)
    x[outcomes == FrameOutcome.INFEASIBLE] = np.nan
    return x, outcomes


def least_violation(problem: ConicProblem) -> Array:
    """x (problems, n) within the bounds that violate the cone least, along its axis.

    Without a cone, or if that is not enough, equalities are violated as well; the sum of squares is minimised. Squares
    also choose among points of the same violation.
    """
    m, k = len(problem.equality_matrix), len(problem.cone_matrix)
    along_axis = np.eye(k, min(k, 1))
    problem = replace(problem, cubed=0)
    x, outcomes = _with_violations(problem, np.zeros((m, min(k, 1))), along_axis)
    in_equalities = np.hstack([np.zeros((m, min(k, 1))), np.eye(m)])
    in_cone = np.hstack([along_axis, np.zeros((k, m))])
    for i in np.flatnonzero(outcomes == FrameOutcome.INFEASIBLE).tolist():
        x[i] = _with_violations(_one_near(problem, i), in_equalities, in_cone)[0][0]
    return x


def solve_frame_with_clarabel(problem: RedundancyProblem, bounds: Array) -> tuple[Array, Outcomes]:
    """x (scenarios, controls) and outcomes (scenarios,) of a problem of one frame, with activations within bounds
    (scenarios, 2, muscles).
    """
    rows, to_rows = _reachable_rows(problem.matrix[0])
    lower, upper = widest = problem.widest_bounds()
    muscles = problem.muscles
    conic = ConicProblem(
        weights=problem.determined_weights,
        equality_matrix=rows,
        equality_target=problem.target[:, 0] @ to_rows.T,
        lower=np.concatenate([bounds[:, 0], lower[:, muscles:]], axis=1),
        upper=np.concatenate([bounds[:, 1], upper[:, muscles:]], axis=1),
        cone_matrix=problem.cone_matrix[0],
        cone_offset=problem.cone_offset[:, 0],
        cubed=muscles if problem.exponent == 3 else 0,
    )
    return _solve_frame(conic, widest)


def _solve_frame(problem: ConicProblem, widest: tuple[Array, Array]) -> tuple[Array, Outcomes]:
    """Solve a frame; if only the activation rate makes it infeasible, solve without that limit and record it."""
    controls, outcomes = solve_conic(problem)
    infeasible = np.flatnonzero(outcomes == FrameOutcome.INFEASIBLE)
    if not len(infeasible):
        return controls, outcomes
    unlimited = replace(
        problem,
        equality_target=problem.equality_target[infeasible],
        lower=widest[0][infeasible],
        upper=widest[1][infeasible],
        cone_offset=problem.cone_offset[infeasible],
    )
    found, again = solve_conic(unlimited)
    again[again == FrameOutcome.SOLVED] = FrameOutcome.BEYOND_ACTIVATION_RATE
    outcomes[infeasible] = again
    if (again == FrameOutcome.INFEASIBLE).any():
        found = np.where(np.isnan(found), least_violation(unlimited), found)
    controls[infeasible] = found
    return controls, outcomes


def _reachable_rows(matrix: Array) -> tuple[Array, Array]:
    """With A = U S Vᵀ (rows, controls), Vᵀ (rank, controls) and S⁻¹ Uᵀ (rank, rows): A x = b is Vᵀ x = S⁻¹ Uᵀ b."""
    left, sizes, right = np.linalg.svd(matrix, full_matrices=False)
    rank = int((sizes > RANK_TOLERANCE * sizes[0]).sum())
    return right[:rank], (left[:, :rank] / sizes[:rank]).T


def _one_near(problem: ConicProblem, i: int) -> ConicProblem:
    """One of the problems, with rows and violations divided by the size of distant targets: limits of the solver and of
    certificates are for rows of the size of x.
    """
    one = slice(i, i + 1)
    target, offset = problem.equality_target[one], problem.cone_offset[one]
    size = max(1.0, np.abs(target).max(initial=0.0) / FAR, np.abs(offset).max(initial=0.0) / FAR)
    return replace(
        problem,
        weights=problem.weights / min(size, LARGEST_SIZE) ** 2,
        equality_matrix=problem.equality_matrix / size,
        equality_target=target / size,
        lower=problem.lower[one],
        upper=problem.upper[one],
        cone_matrix=problem.cone_matrix / size,
        cone_offset=offset / size,
    )


def _with_violations(problem: ConicProblem, in_equalities: Array, in_cone: Array) -> tuple[Array, Outcomes]:
    """x and outcomes with violations of weight 1 as further unknowns, which x does not hold."""
    violations, problems = in_equalities.shape[1], len(problem.lower)
    unbounded = np.full((problems, violations), np.inf)
    x, outcomes = _solve_each(
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
    return x[:, : problem.weights.size], outcomes


def _solve_each(problem: ConicProblem) -> tuple[Array, Outcomes]:
    """As solve_conic, but also infeasible problems have their last point."""
    below, above = np.isfinite(problem.lower[0]), np.isfinite(problem.upper[0])
    matrix = _stacked_matrix(problem, below, above)
    targets = np.hstack(
        [problem.equality_target, problem.upper[:, above], -problem.lower[:, below], problem.cone_offset]
    )
    solver = _clarabel_solver(problem, matrix, int(above.sum() + below.sum()))
    x, outcomes = np.empty(problem.lower.shape), np.empty(len(targets), dtype=object)
    for i, target in enumerate(targets):
        solver.update(b=np.append(target, np.tile([1.0, -1.0, 0.0, 0.0, 0.0, 0.0], problem.cubed)))
        answer = solver.solve()
        x[i], dual = np.array(answer.x)[: problem.weights.size], np.array(answer.z)[: len(target)]
        is_met = _violation(problem, i, x[i]) <= VIOLATION_LIMIT
        if is_met and _optimality(problem, matrix, target, x[i], dual) <= OPTIMALITY_LIMIT:
            outcomes[i] = FrameOutcome.SOLVED
        elif _is_certificate(matrix, target, dual):
            outcomes[i] = FrameOutcome.INFEASIBLE
        else:
            outcomes[i] = FrameOutcome.NOT_CONVERGED
    return x, outcomes


def _stacked_matrix(problem: ConicProblem, below: NDArray[np.bool_], above: NDArray[np.bool_]) -> Array:
    """Rows A of Clarabel's A x + s = b: equalities, upper bounds, lower bounds, cone."""
    unit = np.eye(problem.weights.size)
    return np.vstack([problem.equality_matrix, unit[above], -unit[below], -problem.cone_matrix])


def _clarabel_solver(problem: ConicProblem, matrix: Array, bounds: int) -> Any:
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False  # both would forbid a new right-hand side on the same matrices
    settings.chordal_decomposition_enable = False
    cones = [clarabel.ZeroConeT(len(problem.equality_matrix)), clarabel.NonnegativeConeT(bounds)]
    if len(problem.cone_matrix):
        cones.append(clarabel.SecondOrderConeT(len(problem.cone_matrix)))
    n, cubed = problem.weights.size, problem.cubed
    cones += [clarabel.SecondOrderConeT(3)] * (2 * cubed)
    if cubed:
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = CUBE_TOLERANCE
    rows = scipy.sparse.csc_matrix(
        np.vstack([np.hstack([matrix, np.zeros((len(matrix), 2 * cubed))]), _cube_rows(n, cubed)])
    )
    squares = np.r_[np.zeros(cubed), 2 * problem.weights[cubed:], np.zeros(2 * cubed)]
    linear = np.r_[np.zeros(n + cubed), problem.weights[:cubed]]
    hessian, target = scipy.sparse.diags_array(squares, format="csc"), np.zeros(rows.shape[0])
    return clarabel.DefaultSolver(hessian, linear, rows, target, cones, settings)


def _cube_rows(n: int, cubed: int) -> Array:
    """Rows (6 cubed, n + 2 cubed) of x² ≤ z and z² ≤ x y, two cones each, so that y ≥ x³ for x ≥ 0; z then y follow
    the unknowns.
    """
    rows = np.zeros((6 * cubed, n + 2 * cubed))
    for i in range(cubed):
        first, z, y = 6 * i, n + i, n + cubed + i
        rows[first, z] = rows[first + 1, z] = -1.0  # (z + 1, z − 1, 2 x)
        rows[first + 2, i] = -2.0
        rows[first + 3, [i, y]] = -1.0  # (y + x, y − x, 2 z)
        rows[first + 4, [i, y]] = 1.0, -1.0
        rows[first + 5, z] = -2.0
    return rows


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


def _optimality(problem: ConicProblem, matrix: Array, target: Array, x: Array, dual: Array) -> float:
    """Larger of the stationarity residual and the duality gap, over max(1, objective)."""
    slopes, cubed = problem.effort.gradient(x), problem.cubed
    errors = slopes + matrix.T @ dual
    errors[:cubed] = np.minimum(errors[:cubed], x[:cubed])  # the cones of a cube also hold x ≥ 0
    stationarity = float(np.abs(errors).max())
    gap = abs(float(x @ slopes) + float(target @ dual))  # x·∇ + b·z vanishes at the optimum
    return max(stationarity, gap) / max(1.0, float(problem.effort.terms(x).sum()))
