"""A cost of activations of the user's own: against the powers, SciPy's SLSQP and limits; refusals; frame by frame."""

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.motion import decimate, differentiate
from solver.redundancy.effort import ActivationCost, RedundancyOptions, Reserve, with_reserves
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.problem import FrameOutcome, build_redundancy
from solver.redundancy.sequence import FrameByFrame, solve_redundancy
from solver.stream.stream_solver import StreamSolver
from tests.refusals import raises_refusal
from tests.solver.redundancy.test_conic import by_least_squares, only, power
from tests.solver.redundancy.test_elastic import ELASTIC
from tests.solver.redundancy.test_elastic import MODEL as ELASTIC_MODEL
from tests.solver.redundancy.test_motion_solution import two_muscles
from tests.solver.stream.streams import TASKS

MODEL = bundled_model()
SLOW = decimate(differentiate(simulate_arm_raise(MODEL)), 25)
MUSCLES = len(MODEL.muscles)
EXPONENTIAL = ActivationCost(lambda a: np.exp(5 * a), lambda a: 5 * np.exp(5 * a), lambda a: 25 * np.exp(5 * a))
LINEAR = ActivationCost(lambda a: 1.0 * a, np.ones_like, np.zeros_like)


@pytest.mark.parametrize("p", [2, 3])
def test_a_cost_that_is_a_power_gives_the_solution_of_the_exponent(p: int) -> None:
    found, known = (
        solve_motion(MODEL, SLOW, options)
        for options in (RedundancyOptions(cost=power(p)), RedundancyOptions(exponent=p))
    )
    assert found.unsolved == known.unsolved == 0
    np.testing.assert_allclose(found.activations, known.activations, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.effort, known.effort, rtol=1e-9)


@pytest.mark.parametrize("cost", [power(4), EXPONENTIAL, power(np.linspace(2.0, 4.0, MUSCLES)), LINEAR])
def test_the_effort_is_the_least_that_sequential_least_squares_finds(cost: ActivationCost) -> None:
    problem = only(build_redundancy(MODEL, evaluate_motion(MODEL, SLOW), RedundancyOptions(cost=cost)), 12)
    solution = solve_redundancy(problem)
    assert solution.outcomes[0, 0] is FrameOutcome.SOLVED
    found = solution.controls[0, 0]
    peer = by_least_squares(problem, found, cost)
    assert problem.effort.terms(found).sum() <= problem.effort.terms(peer).sum() * (1 + 1e-7)
    assert problem.effort.terms(found).sum() == pytest.approx(problem.effort.terms(peer).sum(), rel=1e-5)


def test_weights_multiply_a_cost() -> None:
    # 4 w a³ = moment arm times the multiplier
    problem = replace(two_muscles([[1.0, 1.0]]), cost=power(4), weights=np.array([1.0, 5.0, 10.0]))
    a, b, reserve = solve_redundancy(problem).controls[0, 0]
    assert a / b == pytest.approx((3 * 5) ** (1 / 3), rel=1e-7)
    assert 20 * reserve == pytest.approx(4 * 5 * b**3, rel=1e-7)
    assert problem.effort.terms(np.array([0.5, 0.5, 0.2])) == pytest.approx([0.0625, 0.3125, 0.4])


def test_activations_change_no_faster_with_a_cost_and_too_fast_is_an_outcome() -> None:
    # two muscles to 4 together: full activation; then nothing, 10 ms later
    outcomes, fall = [], []
    for options in ({}, {"cost": power(2)}):
        problem = replace(
            two_muscles([[4.0, 4.0], [0.0, 0.0]], interval=0.01), weights=np.array([1.0, 1.0, 1e3]), **options
        )
        found = solve_redundancy(problem)
        outcomes.append(found.outcomes.tolist())
        fall.append(found.controls)
    assert outcomes[0] == outcomes[1]
    np.testing.assert_allclose(fall[0], fall[1], atol=1e-8)


def test_frames_that_come_one_by_one_have_the_activations_of_the_whole_motion() -> None:
    problem = build_redundancy(MODEL, evaluate_motion(MODEL, SLOW), RedundancyOptions(cost=power(3)))
    whole, stream = solve_redundancy(problem), FrameByFrame(1, MUSCLES)
    for frame in range(3):
        found = stream.solve(only(problem, frame))
        np.testing.assert_allclose(found.controls[0, 0], whole.controls[0, frame], rtol=0, atol=1e-7)


def test_an_actuator_with_two_limits_keeps_its_square() -> None:
    model = with_reserves(MODEL, {"shoulder_elv": Reserve(20.0, -0.01, 0.01)})
    found, known = (
        solve_motion(model, decimate(SLOW, 8), options)
        for options in (RedundancyOptions(cost=power(3)), RedundancyOptions(exponent=3))
    )
    assert np.abs(found.reserves / 20.0).max() >= 0.01
    np.testing.assert_allclose(found.activations, known.activations, rtol=0, atol=1e-3)  # the other is Clarabel's


def test_elastic_tendons_share_by_a_cost() -> None:
    motion = differentiate(simulate_arm_raise(ELASTIC_MODEL)).cut(slice(0, 3))
    found, known = (
        solve_motion(ELASTIC_MODEL, motion, replace(ELASTIC, **options))
        for options in ({"cost": power(3)}, {"exponent": 3})
    )
    assert found.unsolved == known.unsolved == 0
    np.testing.assert_allclose(found.activations, known.activations, rtol=0, atol=5e-5)  # cubes are flat at rest


@pytest.mark.parametrize(
    ("cost", "named"),
    [
        (ActivationCost(lambda a: -(a**2), lambda a: -2 * a, lambda a: -2 + 0 * a), "curvature"),
        (ActivationCost(lambda a: a**2, lambda a: a, lambda a: 1 + 0 * a), "slope"),
        (ActivationCost(lambda a: a**3, lambda a: 3 * a**2, lambda a: 3 * a), "curvature"),
        (ActivationCost(lambda a: 1 / a, lambda a: -1 / a**2, lambda a: 2 / a**3), "value"),
        (ActivationCost(lambda a: (a**2).sum(), lambda a: 2 * a, lambda a: 2 + 0 * a), "value"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_a_cost_that_is_not_convex_or_contradicts_itself_is_refused(cost: ActivationCost, named: str) -> None:
    with raises_refusal(SolverCode.WRONG_OPTION, f"{named} should"):
        solve_motion(MODEL, decimate(SLOW, 10), RedundancyOptions(cost=cost))


@pytest.mark.parametrize("options", [{"exponent": 3}, {"solver": "clarabel"}])
def test_a_cost_beside_an_exponent_or_clarabel_is_refused(options) -> None:
    with raises_refusal(SolverCode.WRONG_OPTION, "exponent is"):
        RedundancyOptions(cost=power(2), **options)


def test_a_function_alone_is_no_cost() -> None:
    with pytest.raises(TypeError, match="ActivationCost"):
        RedundancyOptions(cost=lambda a: a**2)  # type: ignore[arg-type]


def test_a_stream_refuses_a_wrong_cost_before_its_first_frame() -> None:
    cost = ActivationCost(lambda a: -(a**2), lambda a: -2 * a, lambda a: -2 + 0 * a)
    with raises_refusal(SolverCode.WRONG_OPTION, "curvature should"):
        StreamSolver(MODEL, TASKS, {"bare": None}, options=RedundancyOptions(cost=cost))


def test_a_cost_with_what_only_clarabel_solves_is_refused() -> None:
    with raises_refusal(SolverCode.UNSUPPORTED, "actuators"):
        solve_motion(
            with_reserves(MODEL, {"shoulder_elv": Reserve(20.0, -1.0)}), SLOW, RedundancyOptions(cost=power(2))
        )
