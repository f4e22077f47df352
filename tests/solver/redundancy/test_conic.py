"""The conic problems and cubes: closed forms, an independent solver, outcomes that rest on residuals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize

from solver.bundled import bundled_model, simulate_arm_raise
from solver.motion import decimate, differentiate
from solver.redundancy import conic
from solver.redundancy.conic import ConicProblem, least_violation, solve_conic
from solver.redundancy.effort import ActivationCost, RedundancyOptions
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.problem import FrameOutcome, RedundancyProblem, build_redundancy
from solver.redundancy.sequence import solve_redundancy
from tests.solver.redundancy.test_motion_solution import CONE_ALONG_Y, two_muscles

MODEL = bundled_model()
SLOW = decimate(differentiate(simulate_arm_raise(MODEL)), 25)
CUBES = RedundancyOptions(exponent=3)


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


def test_a_bound_that_is_reached_passes_the_rest_on():
    x, _ = solve_conic(problem([1.0], upper=(0.1, 1.0, 1.0)))
    np.testing.assert_allclose(x, [[0.1, 0.45, 0.45]], atol=1e-7)


def test_the_cone_holds_and_is_touched_when_it_matters():
    # the first unknown must be at least as large as the distance of the two others from (0, 0)
    (x,), _ = solve_conic(problem([0.9], cone_matrix=np.eye(3), cone_offset=np.zeros((1, 3))))
    assert x[0] == pytest.approx(np.hypot(x[1], x[2]), abs=1e-7)
    np.testing.assert_allclose(x[1], x[2], atol=1e-7)
    assert x.sum() == pytest.approx(0.9, abs=1e-8)


def test_one_infeasible_problem_is_an_outcome_and_spoils_no_neighbour():
    x, outcomes = solve_conic(problem([0.3, 3.5, 0.6]))
    assert outcomes.tolist() == [FrameOutcome.SOLVED, FrameOutcome.INFEASIBLE, FrameOutcome.SOLVED]
    assert np.isnan(x[1]).all()
    np.testing.assert_allclose(x[[0, 2]], [[0.1] * 3, [0.2] * 3], atol=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_random_problems_agree_with_an_independent_solver(seed):
    generator = np.random.default_rng(seed)
    inside = generator.uniform(0.2, 0.8, 6)
    E, C = generator.normal(size=(2, 6)), generator.normal(size=(3, 6))
    ray = C @ inside
    c = np.array([np.hypot(ray[1], ray[2]) - ray[0] + 0.05, 0, 0])
    weights = generator.uniform(0.5, 10, 6)
    batch = ConicProblem(weights, E, (E @ inside)[None], np.zeros((1, 6)), np.ones((1, 6)), C, c[None])
    (x,), outcomes = solve_conic(batch)
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
    assert outcomes.tolist() == [FrameOutcome.SOLVED]
    assert weights @ x**2 == pytest.approx(peer.fun, rel=1e-5)


def test_a_claimed_success_with_large_residuals_is_not_accepted(monkeypatch):
    liar = SimpleNamespace(
        update=lambda **_: None, solve=lambda: SimpleNamespace(x=[0.4] * 3, z=[1.0] * 7, status="Solved")
    )
    monkeypatch.setattr(conic, "_clarabel_solver", lambda *_: liar)
    x, outcomes = solve_conic(problem([0.3]))
    assert outcomes.tolist() == [FrameOutcome.NOT_CONVERGED]
    np.testing.assert_array_equal(x, [[0.4] * 3])


@pytest.mark.parametrize("size", [10.0, 1e3, 1e5, 1e7])
def test_the_least_violation_of_a_distant_target_is_that_of_bounded_least_squares(size):
    """By lsq_linear of SciPy; with distant targets the solution was taken for infeasible, and was nan."""
    random = np.random.default_rng(1)
    rows = np.linalg.qr(random.normal(size=(10, 6)))[0].T
    targets = random.normal(size=(3, 6))
    targets *= size / np.linalg.norm(targets, axis=1)[:, None]
    bounds = np.zeros((3, 10)), np.ones((3, 10))
    distant = ConicProblem(np.ones(10), rows, targets, *bounds, np.zeros((0, 10)), np.zeros((3, 0)))
    assert solve_conic(distant)[1].tolist() == [FrameOutcome.INFEASIBLE] * 3
    for x, target in zip(least_violation(distant), targets, strict=True):
        expected = optimize.lsq_linear(rows, target, (0, 1)).x
        violation, least = (np.linalg.norm(rows @ point - target) for point in (x, expected))
        assert violation == pytest.approx(least, rel=1e-8)
        assert x.min() > -1e-6 and x.max() < 1 + 1e-6


def test_muscles_share_by_the_root_of_their_moment_arms():
    # 3 a² = moment arm times the multiplier for the muscles, 20 r for the reserve, which keeps squares
    problem = replace(two_muscles([[1.0, 1.0]]), exponent=3)
    a, b, reserve = solve_redundancy(problem).controls[0, 0]
    assert a / b == pytest.approx(np.sqrt(3), rel=1e-9)
    assert 20 * reserve == pytest.approx(3 * b**2, rel=1e-9)
    assert 3 * a + b + reserve == pytest.approx(1.0, abs=1e-9)


def test_a_muscle_that_would_have_to_push_rests():
    problem = replace(two_muscles([[1.0, 1.0]]), exponent=3)
    against = problem.matrix.copy()
    against[..., 1] = -1.0
    controls = solve_redundancy(replace(problem, matrix=against)).controls[0, 0]
    assert controls[1] == 0.0
    assert 3 * controls[0] + controls[2] == pytest.approx(1.0, abs=1e-9)


def test_effort_counts_cubes_of_muscles_and_squares_of_reserves():
    problem = replace(two_muscles([[1.0, 1.0]]), exponent=3)
    np.testing.assert_allclose(problem.effort.terms(np.array([0.5, 0.1, 0.2])), [0.125, 0.001, 10 * 0.04])
    np.testing.assert_allclose(problem.effort.terms(np.array([0.5, 0.1])), [0.125, 0.001])


@pytest.mark.parametrize("frame", range(len(SLOW.time)))
def test_frames_of_the_arm_raise_agree_with_sequential_quadratic_programming(frame):
    problem = only(build_redundancy(MODEL, evaluate_motion(MODEL, SLOW), CUBES), frame)
    solution = solve_redundancy(problem, workers=1)
    assert solution.outcomes[0, 0] is FrameOutcome.SOLVED
    found, peer = solution.controls[0, 0], by_least_squares(problem, solution.controls[0, 0], power(3))
    muscles = len(MODEL.muscles)
    assert problem.effort.terms(found).sum() == pytest.approx(problem.effort.terms(peer).sum(), rel=1e-9)
    np.testing.assert_allclose(found[:muscles], peer[:muscles], atol=2e-6)


def only(problem: RedundancyProblem, frame: int) -> RedundancyProblem:
    """One frame, so that no activation is bounded by the frame before."""
    return problem.cut(slice(frame, frame + 1))


def power(p) -> ActivationCost:
    return ActivationCost(lambda a: a**p, lambda a: p * a ** (p - 1), lambda a: p * (p - 1) * a ** (p - 2))


def by_least_squares(problem, feasible, cost):
    """scipy's SLSQP from activations of 0.3, with the accelerations that `feasible` produces."""
    muscles, weights = problem.muscles, problem.weights
    _, sizes, right = np.linalg.svd(problem.matrix[0])
    rows = right[: int((sizes > 1e-9 * sizes[0]).sum())]
    cone = problem.cone[0] / 1e3
    matrix, offset = cone @ problem.reaction_matrix[0, 3:], cone @ problem.reaction_at_rest[0, 0, 3:]

    def effort(x):
        return weights[:muscles] @ cost.value(x[:muscles]) + weights[muscles:] @ x[muscles:] ** 2

    def slopes(x):
        return np.r_[weights[:muscles] * cost.slope(x[:muscles]), 2 * weights[muscles:] * x[muscles:]]

    def inside(x):
        ray = matrix @ x + offset
        return np.array([ray[0], ray[0] ** 2 - ray[1] ** 2 - ray[2] ** 2])

    def inside_slopes(x):
        ray = matrix @ x + offset
        return np.vstack([matrix[0], 2 * ray[0] * matrix[0] - 2 * ray[1:] @ matrix[1:]])

    return optimize.minimize(
        effort,
        np.full(len(weights), 0.3),
        jac=slopes,
        method="SLSQP",
        bounds=[(0, 1)] * muscles + [(None, None)] * (len(weights) - muscles),
        constraints=[
            {"type": "eq", "fun": lambda x: rows @ (x - feasible), "jac": lambda _: rows},
            {"type": "ineq", "fun": inside, "jac": inside_slopes},
        ],
        options={"ftol": 1e-14, "maxiter": 1000},
    ).x


def test_conditions_of_optimality_hold_for_free_muscles_of_the_arm_raise():
    # where a muscle is free and the cone is not touched, 3 w a² lies in the row space of the accelerations
    problem = build_redundancy(MODEL, evaluate_motion(MODEL, SLOW), replace(CUBES, has_glenoid_cone=False))
    checked = 0
    for frame in range(len(SLOW.time)):
        alone = only(problem, frame)
        x = solve_redundancy(alone, workers=1).controls[0, 0]
        muscles = len(MODEL.muscles)
        is_free = np.r_[(x[:muscles] > 1e-3) & (x[:muscles] < 1), np.full(len(x) - muscles, fill_value=True)]
        slopes = np.r_[3 * (alone.weights * x**2)[:muscles], 2 * (alone.weights * x)[muscles:]]
        rows = alone.matrix[0].T
        multipliers = np.linalg.lstsq(rows[is_free], slopes[is_free], rcond=1e-12)[0]
        np.testing.assert_allclose((rows @ multipliers)[is_free], slopes[is_free], atol=1e-8)
        resting = np.flatnonzero(~is_free & (np.r_[x[:muscles], np.ones(len(x) - muscles)] == 0.0))
        assert (rows[resting] @ multipliers < 1e-6).all()
        checked += int(is_free[:muscles].sum())
    assert checked > 100


def test_a_whole_motion_is_solved_with_less_extreme_activations():
    squares, with_cubes = (solve_motion(MODEL, SLOW, RedundancyOptions(exponent=p)) for p in (2, 3))
    assert with_cubes.unsolved == 0
    assert (with_cubes.activations.max(axis=1) < squares.activations.max(axis=1) + 1e-6).mean() > 0.9
    cubes_of = [(solution.activations**3).sum() for solution in (with_cubes, squares)]
    assert cubes_of[0] < 0.99 * cubes_of[1]
    np.testing.assert_allclose(
        with_cubes.effort,
        (with_cubes.activations**3).sum(axis=1)
        + 10 * ((with_cubes.reserves[:, 8:] / [one.optimal_force for one in MODEL.actuators[8:]]) ** 2).sum(axis=1),
        rtol=1e-9,
    )


def test_an_infeasible_frame_is_that_of_squares():
    problem = two_muscles([[1.0, 1.0]], cone=CONE_ALONG_Y)
    out = problem.reaction_at_rest.copy()
    out[0, 0, 4] = -50.0
    solutions = [solve_redundancy(replace(problem, reaction_at_rest=out, exponent=p)) for p in (2, 3)]
    assert [solution.outcomes[0, 0] for solution in solutions] == [FrameOutcome.INFEASIBLE] * 2
    assert solutions[0].cone_slack[0, 0] == pytest.approx(solutions[1].cone_slack[0, 0])


def test_limits_of_actuators_are_kept_with_cubes_too():
    # the compiled solver has no limits of actuators: Clarabel solves
    limits = np.array([[-0.001], [0.001]])
    solution = solve_redundancy(replace(two_muscles([[2.0, 2.0]]), exponent=3, control_limits=limits))
    a, b, reserve = solution.controls[0, 0]
    assert solution.outcomes[0, 0] is FrameOutcome.SOLVED
    assert reserve == pytest.approx(0.001, abs=1e-6)
    assert a / b == pytest.approx(np.sqrt(3), rel=1e-3)


def test_cubes_of_two_unknowns_share_by_the_root_of_their_weights():
    conic = ConicProblem(
        weights=np.array([1.0, 4.0]),
        equality_matrix=np.ones((1, 2)),
        equality_target=np.array([[0.6], [0.9]]),
        lower=np.zeros((2, 2)),
        upper=np.ones((2, 2)),
        cone_matrix=np.zeros((0, 2)),
        cone_offset=np.zeros((2, 0)),
        cubed=2,
    )
    x, outcomes = solve_conic(conic)
    assert outcomes.tolist() == [FrameOutcome.SOLVED] * 2
    np.testing.assert_allclose(x, [[0.4, 0.2], [0.6, 0.3]], atol=1e-5)
    assert conic.effort.terms(x[0]).sum() == pytest.approx(0.4**3 + 4 * 0.2**3, rel=1e-4)
