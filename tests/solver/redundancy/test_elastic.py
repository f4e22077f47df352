"""The redundancy problem with elastic tendons: true forces, the least effort, and rigid tendons as a limit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.model import Array, Model
from solver.motion import decimate, differentiate
from solver.multibody.dynamics import response_to_loads
from solver.muscle import MuscleOutcome
from solver.redundancy.effort import RedundancyOptions, Reserve, Solver, static_optimisation, with_reserves
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.problem import FrameOutcome
from solver.tendons.fiber import elastic_forces, elastic_muscles
from tests.refusals import raises_refusal

MODEL = bundled_model()
MOTION = differentiate(simulate_arm_raise(MODEL), start=1.0, end=1.3)
STRENGTH = np.array([muscle.max_isometric_force for muscle in MODEL.muscles])
ELASTIC = RedundancyOptions(tendons="elastic")


@pytest.fixture(scope="module")
def solved():  # type: ignore[no-untyped-def]
    return solve_motion(MODEL, MOTION, ELASTIC)


def produced(model: Model, motion, forces: Array, reserves: Array) -> tuple[Array, Array]:  # type: ignore[no-untyped-def]
    """Accelerations and reaction by these forces [N] and reserves [N, N m], as linear responses."""
    mechanics = evaluate_motion(model, motion)
    equations, paths = mechanics.equations, mechanics.paths
    muscles = response_to_loads(equations, paths.wrench_per_tension, paths.mobility_per_tension)
    driven = [actuator.coordinate for actuator in model.actuators]
    by_reserves = np.einsum("fri,fr->fi", equations.mobility[:, driven], reserves)
    acceleration = equations.acceleration_unloaded + (muscles.acceleration * forces[..., None]).sum(axis=1)
    return acceleration + by_reserves, equations.reaction_unloaded + (muscles.reaction * forces[..., None]).sum(axis=1)


def test_the_forces_are_those_of_the_activations(solved) -> None:  # type: ignore[no-untyped-def]
    paths = evaluate_motion(MODEL, MOTION).paths
    expected = elastic_forces(MODEL, paths.lengths, paths.speeds, solved.activations, MOTION.interval)
    assert solved.unsolved == 0 and (solved.muscle_outcomes != MuscleOutcome.FIBER_NOT_CONVERGED).all()
    np.testing.assert_allclose(solved.muscle_forces / STRENGTH, expected.tension / STRENGTH, rtol=0, atol=1e-9)
    np.testing.assert_allclose(solved.passive_forces / STRENGTH, expected.passive / STRENGTH, rtol=0, atol=1e-9)
    assert solved.fibers.elastic.tolist() == elastic_muscles(MODEL).tolist()


def test_the_forces_move_the_body_as_measured(solved) -> None:  # type: ignore[no-untyped-def]
    """But for what the acromioclavicular joint forbids, the same with rigid tendons."""
    rigid = solve_motion(MODEL, MOTION)
    found, _ = produced(MODEL, MOTION, solved.muscle_forces, solved.reserves)
    expected, _ = produced(MODEL, MOTION, rigid.muscle_forces, rigid.reserves)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)
    missed = np.abs(found - MOTION.accelerations)
    np.testing.assert_allclose(missed.max(axis=1), solved.equality_residual, rtol=0, atol=1e-5)
    named = [MODEL.coordinate_index(name) for name in solved.residual_coordinates]
    np.testing.assert_allclose(missed[range(len(named)), named], solved.equality_residual, rtol=0, atol=1e-5)
    assert solved.cone_slack.min() > -1e-3
    assert 1.0 < np.abs(solved.muscle_forces - rigid.muscle_forces).max() < 60.0


def test_the_effort_is_the_least_of_the_curved_problem() -> None:
    """One frame, without the cone, by SLSQP of SciPy on the true forces."""
    motion = decimate(MOTION, 100)
    found = solve_motion(MODEL, motion, replace(ELASTIC, has_glenoid_cone=False))
    mechanics = evaluate_motion(MODEL, motion)
    full = np.array([actuator.optimal_force for actuator in MODEL.actuators])
    driven = [actuator.coordinate for actuator in MODEL.actuators]
    paths = mechanics.paths
    muscles = response_to_loads(mechanics.equations, paths.wrench_per_tension, paths.mobility_per_tension)
    columns = np.hstack([muscles.acceleration[0].T * STRENGTH, mechanics.equations.mobility[0, driven].T * full])
    left, sizes, right = np.linalg.svd(columns, full_matrices=False)
    rank = int((sizes > 1e-9 * sizes[0]).sum())
    wanted = (left.T @ (motion.accelerations[0] - mechanics.equations.acceleration_unloaded[0]))[:rank] / sizes[:rank]
    weights = np.r_[np.ones(33), np.zeros(8), np.full(9, 10.0)]

    def gap(x: Array) -> Array:
        forces = elastic_forces(MODEL, paths.lengths, paths.speeds, x[None, :33], 0.01).tension[0] / STRENGTH
        return right[:rank] @ np.r_[forces, x[33:]] - wanted

    answer = minimize(
        lambda x: weights @ x**2,
        np.r_[np.full(33, 0.1), np.zeros(17)],
        jac=lambda x: 2 * weights * x,
        bounds=[(0, 1)] * 33 + [(None, None)] * 17,
        constraints={"type": "eq", "fun": gap},
        options={"ftol": 1e-12, "maxiter": 300},
    )
    x = np.r_[found.activations[0], found.reserves[0] / full]
    assert answer.success and np.abs(gap(x)).max() < 1e-8
    assert weights @ x**2 == pytest.approx(answer.fun, rel=1e-6)
    np.testing.assert_allclose(x[:33], answer.x[:33], rtol=0, atol=2e-4)


def test_other_ways_to_solve_find_the_same() -> None:
    """Also with an actuator that has two limits, or one, which only Clarabel solves, and with cubes."""
    for reserve, exponent in ((Reserve(1.0, -20.0, 20.0), 2), (Reserve(1.0, -20.0), 2), (Reserve(1.0), 3)):
        model, options = with_reserves(MODEL, {"shoulder_elv": reserve}), replace(ELASTIC, exponent=exponent)
        ours, theirs = (
            solve_motion(model, MOTION.cut(slice(0, 3)), replace(options, solver=solver))
            for solver in ("interior_point", "clarabel")
        )
        assert ours.unsolved == theirs.unsolved == 0
        np.testing.assert_allclose(ours.activations, theirs.activations, rtol=0, atol=2e-4 * exponent)


def test_after_a_frame_that_is_not_finite_fibres_start_anew() -> None:
    positions = MOTION.positions.copy()
    positions[3] = np.nan
    found = solve_motion(MODEL, replace(MOTION, positions=positions), ELASTIC)
    assert found.outcomes[3] is FrameOutcome.NOT_FINITE and found.unsolved == 1
    assert np.isnan(found.muscle_forces[3]).all() and np.isnan(found.activations[3]).all()
    rest = MOTION.cut(slice(4, None))
    np.testing.assert_allclose(found.activations[4:], solve_motion(MODEL, rest, ELASTIC).activations, rtol=0, atol=1e-6)


@pytest.mark.parametrize("solver", ["interior_point", "clarabel"])
@pytest.mark.parametrize("missing", [1e4, 1e7])
def test_a_frame_beyond_the_muscles_is_infeasible_and_fibres_start_anew_in_the_next(
    missing: float, solver: Solver
) -> None:
    """The least violation of a distant target was nan, as in a walk with a patella's angle in degrees.

    Muscles that have rested are slack, and would need many frames to pull again, all of them infeasible.
    """
    limited = with_reserves(MODEL, {"shoulder_elv": Reserve(1.0, -1.0, 1.0)})
    motion = MOTION.cut(slice(0, 5))
    accelerations = motion.accelerations.copy()
    accelerations[2, MODEL.coordinate_index("shoulder_elv")] += missing
    found = solve_motion(limited, replace(motion, accelerations=accelerations), replace(ELASTIC, solver=solver))
    outcomes = [FrameOutcome.SOLVED] * 5
    outcomes[2] = FrameOutcome.INFEASIBLE
    assert list(found.outcomes) == outcomes
    assert np.isnan(found.activations[2]).all() and np.isnan(found.muscle_forces[2]).all()
    assert 0.01 * missing < found.equality_residual[2] < np.inf
    assert np.isfinite(found.reaction).all()
    assert np.isfinite(found.muscle_forces[3:]).all()
    rest = motion.cut(slice(3, None))
    expected = solve_motion(limited, rest, replace(ELASTIC, solver=solver))
    np.testing.assert_allclose(found.activations[3:], expected.activations, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.fibers.fiber_lengths[3:], expected.fibers.fiber_lengths, rtol=0, atol=1e-8)


def test_a_model_with_rigid_tendons_alone_is_refused() -> None:
    rigid = replace(MODEL, muscles=tuple(replace(muscle, tendon=None) for muscle in MODEL.muscles))
    with raises_refusal(SolverCode.NO_TENDON, naming=MODEL.name):
        solve_motion(rigid, decimate(MOTION, 10), ELASTIC)


def test_elastic_tendons_do_not_go_with_static_optimisation() -> None:
    with raises_refusal(SolverCode.UNSUPPORTED, naming="activation dynamics, passive muscle forces"):
        solve_motion(MODEL, decimate(MOTION, 10), static_optimisation(ELASTIC))
