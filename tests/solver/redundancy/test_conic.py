"""The conic problems: optima known in closed form, an independent solver, and outcomes that rest on residuals."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize

from solver.redundancy import conic
from solver.redundancy.conic import ConicOutcome, ConicProblem, least_violation, solve_conic


def problem(target, upper=(1.0, 1.0, 1.0), cone_matrix=None, cone_offset=None):
    """Three unknowns in [0, upper] that sum to each of the targets."""
    problems = len(target)
    return ConicProblem(
        weights=np.ones(3),
        equality_matrix=np.ones((1, 3)),
        equality_target=np.array(target, dtype=float)[:, None],
        lower=np.zeros((problems, 3)),
        upper=np.tile(upper, (problems, 1)),
        cone_matrix=np.zeros((0, 3)) if cone_matrix is None else cone_matrix,
        cone_offset=np.zeros((problems, 0)) if cone_offset is None else cone_offset,
    )


def test_equal_weights_share_the_sum_equally():
    solution = solve_conic(problem([0.3, 1.5]))
    assert solution.outcomes == (ConicOutcome.SOLVED, ConicOutcome.SOLVED)
    np.testing.assert_allclose(solution.x, [[0.1] * 3, [0.5] * 3], atol=1e-7)


def test_a_bound_that_is_reached_passes_the_rest_on():
    solution = solve_conic(problem([1.0], upper=(0.1, 1.0, 1.0)))
    np.testing.assert_allclose(solution.x, [[0.1, 0.45, 0.45]], atol=1e-7)


def test_the_cone_holds_and_is_touched_when_it_matters():
    # the first unknown must be at least as large as the distance of the two others from (0, 0)
    solution = solve_conic(problem([0.9], cone_matrix=np.eye(3), cone_offset=np.zeros((1, 3))))
    x = solution.x[0]
    assert x[0] == pytest.approx(np.hypot(x[1], x[2]), abs=1e-7)
    np.testing.assert_allclose(x[1], x[2], atol=1e-7)
    assert x.sum() == pytest.approx(0.9, abs=1e-8)


def test_one_infeasible_problem_is_an_outcome_and_spoils_no_neighbour():
    solution = solve_conic(problem([0.3, 3.5, 0.6]))
    assert solution.outcomes == (ConicOutcome.SOLVED, ConicOutcome.INFEASIBLE, ConicOutcome.SOLVED)
    assert np.isnan(solution.x[1]).all()
    np.testing.assert_allclose(solution.x[[0, 2]], [[0.1] * 3, [0.2] * 3], atol=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_random_problems_agree_with_an_independent_solver(seed):
    generator = np.random.default_rng(seed)
    inside = generator.uniform(0.2, 0.8, 6)
    E, C = generator.normal(size=(2, 6)), generator.normal(size=(3, 6))
    ray = C @ inside
    c = np.array([np.hypot(ray[1], ray[2]) - ray[0] + 0.05, 0, 0])
    weights = generator.uniform(0.5, 10, 6)
    solution = solve_conic(
        ConicProblem(weights, E, (E @ inside)[None], np.zeros((1, 6)), np.ones((1, 6)), C, c[None]),
    )
    peer = optimize.minimize(
        lambda x: weights @ x**2,
        inside,
        jac=lambda x: 2 * weights * x,
        bounds=[(0, 1)] * 6,
        constraints=[
            {"type": "eq", "fun": lambda x: E @ (x - inside)},
            {"type": "ineq", "fun": lambda x: (C @ x + c)[0] - np.linalg.norm((C @ x + c)[1:])},
        ],
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert solution.outcomes == (ConicOutcome.SOLVED,)
    assert weights @ solution.x[0] ** 2 == pytest.approx(peer.fun, rel=1e-5)


def test_a_claimed_success_with_large_residuals_is_not_accepted(monkeypatch):
    liar = SimpleNamespace(
        update=lambda **_: None, solve=lambda: SimpleNamespace(x=[0.4] * 3, z=[1.0] * 7, status="Solved")
    )
    monkeypatch.setattr(conic, "_clarabel_solver", lambda *_: liar)
    solution = solve_conic(problem([0.3]))
    assert solution.outcomes == (ConicOutcome.NOT_CONVERGED,)
    assert solution.violation[0] == pytest.approx(0.9)


def test_arrays_that_do_not_fit_are_refused_by_name():
    with pytest.raises(ValueError, match=r"cone_offset should have shape \(1, 3\) and has \(1, 0\)"):
        solve_conic(problem([0.3], cone_matrix=np.eye(3)))


@pytest.mark.parametrize("size", [10.0, 1e3, 1e5, 1e7])
def test_the_least_violation_of_a_distant_target_is_that_of_bounded_least_squares(size):
    """By lsq_linear of SciPy; with distant targets the solution was taken for infeasible, and was nan."""
    random = np.random.default_rng(1)
    rows = np.linalg.qr(random.normal(size=(10, 6)))[0].T
    targets = random.normal(size=(3, 6))
    targets *= size / np.linalg.norm(targets, axis=1)[:, None]
    bounds = np.zeros((3, 10)), np.ones((3, 10))
    distant = ConicProblem(np.ones(10), rows, targets, *bounds, np.zeros((0, 10)), np.zeros((3, 0)))
    assert solve_conic(distant).outcomes == (ConicOutcome.INFEASIBLE,) * 3
    for x, target in zip(least_violation(distant), targets, strict=True):
        expected = optimize.lsq_linear(rows, target, (0, 1)).x
        violation, least = (np.linalg.norm(rows @ point - target) for point in (x, expected))
        assert violation == pytest.approx(least, rel=1e-8)
        assert x.min() > -1e-6 and x.max() < 1 + 1e-6
