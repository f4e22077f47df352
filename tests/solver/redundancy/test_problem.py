"""Options of the problem; what no control reaches and what moves nothing: locks, ranks that change."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.constraint import CoordinatePrescription
from solver.errors import SolverCode
from solver.functions.coordinate_functions import PiecewisePolynomial, Sine
from solver.model import CoordinateCoupler, CoordinateLock, Model
from solver.motion import decimate, differentiate, read_motion
from solver.multibody.dynamics import ReactionRequest
from solver.osim.model_reader import read_osim
from solver.redundancy.effort import RedundancyOptions, Solver, effort_weights
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.problem import FrameOutcome, RedundancyProblem, build_redundancy
from solver.redundancy.sequence import solve_redundancy
from tests.refusals import raises_refusal
from tests.solver.references import SHARED

MODEL = bundled_model()
SLOW = decimate(differentiate(simulate_arm_raise(MODEL)), 40)
LOCKED = ("elbow_flexion", "pro_sup", "plane_elv")
SUBJECT = SHARED / "subject"


def with_locks(model: Model, *names: str) -> Model:
    locks = [CoordinateLock(name, model.coordinate_index(name), 0.0) for name in names]
    return replace(model, constraints=(*model.constraints, *locks))


def with_a_singular_elbow(model: Model) -> Model:
    """pro_sup = ½ elbow² and elbow = pro_sup + ½: the two rows are one where the elbow is at 1 rad, and only there."""

    def polynomial(*coefficients: float) -> PiecewisePolynomial:
        return PiecewisePolynomial(np.zeros(0), np.zeros(1), np.array([coefficients]))

    elbow, turned = (model.coordinate_index(name) for name in ("elbow_flexion", "pro_sup"))
    couplers = (
        CoordinateCoupler("one", turned, (elbow,), (polynomial(0.0, 0.0, 0.5),)),
        CoordinateCoupler("other", elbow, (turned,), (polynomial(0.5, 1.0),)),
    )
    return replace(model, constraints=(*model.constraints, *couplers))


def driven(model: Model) -> list[str]:
    return [model.coordinate_names[actuator.coordinate] for actuator in model.actuators]


def problem_of(
    matrix: Any, weights: list[float], target: Any, solver: Solver = "interior_point", interval: float = 1.0
):
    """Two muscles and actuators without a glenoid; the matrix is that of every frame of target (frames, rows)."""
    target = np.asarray(target, dtype=float)
    frames, rows = target.shape
    return RedundancyProblem(
        time=np.arange(frames) * interval,
        interval=interval,
        weights=np.array(weights),
        time_constants=np.array([[0.01, 0.01], [0.04, 0.04]]),
        matrix=np.tile(matrix, (frames, 1, 1)),
        target=target[None],
        tracked=np.ones(rows, dtype=bool),
        reaction_matrix=np.zeros((frames, 6, len(weights))),
        reaction_at_rest=np.zeros((1, frames, 6)),
        cone=np.zeros((frames, 0, 3)),
        solver=solver,
    )


@pytest.mark.parametrize("solver", ["interior_point", "clarabel"])
def test_the_actuator_of_a_locked_coordinate_gives_nothing(solver: Solver) -> None:
    # without a weight, whatever its round-off columns happen to hold decided: up to 1.6e6 N m
    model = with_locks(MODEL, *LOCKED)
    found = solve_motion(model, SLOW, RedundancyOptions(solver=solver))
    assert set(found.outcomes) == {FrameOutcome.SOLVED}
    idle = [name in LOCKED for name in driven(model)]
    np.testing.assert_allclose(found.reserves[:, idle], 0.0, atol=1e-6)
    weighted = solve_motion(model, SLOW, RedundancyOptions(solver=solver, weights=dict.fromkeys(LOCKED, 1.0)))
    np.testing.assert_allclose(found.activations, weighted.activations, atol=1e-9)


def test_a_prescribed_coordinate_accelerates_by_its_function_and_takes_no_muscle_force() -> None:
    elbow, rise = MODEL.coordinate_index("elbow_flexion"), Sine(0.3, 2.0, 0.1, 0.5)
    model = replace(MODEL, constraints=(*MODEL.constraints, CoordinatePrescription("rise", elbow, rise)))
    mechanics = evaluate_motion(model, SLOW)
    wanted = -(2.0**2) * 0.3 * np.sin(2.0 * SLOW.time + 0.1)
    np.testing.assert_allclose(mechanics.equations.acceleration_unloaded[:, elbow], wanted, atol=1e-9)
    np.testing.assert_allclose(mechanics.maps(model).acceleration_per_control[:, elbow], 0.0, atol=1e-9)


def test_nothing_is_dropped_where_nothing_is_locked() -> None:
    mechanics = evaluate_motion(MODEL, SLOW)
    problem, maps = build_redundancy(MODEL, mechanics, RedundancyOptions()), mechanics.maps(MODEL)
    assert np.array_equal(problem.matrix, maps.acceleration_per_control)
    assert np.array_equal(problem.reaction_matrix, maps.reaction_per_control)


def test_a_residual_that_a_control_could_reduce_is_not_called_solved() -> None:
    # the last actuator's column is within the rank's tolerance of nothing, yet it could give the second row
    for last, outcome in ((2e-9, FrameOutcome.NOT_CONVERGED), (0.0, FrameOutcome.SOLVED)):
        matrix = [[3.0, 1.0, 1.0, 0.0], [0.0, 0.0, 0.0, last]]
        found = solve_redundancy(problem_of(matrix, [1.0, 1.0, 10.0, 0.0], [[1.0, 1.0]], "clarabel"))
        assert found.equality_residual[0, 0] == pytest.approx(1.0)
        assert found.outcomes[0, 0] is outcome
    assert found.controls[0, 0, 3] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("solver", ["interior_point", "clarabel"])
def test_a_frame_of_lower_rank_takes_no_equation_from_the_others(solver: Solver) -> None:
    ranks = np.array([[[3.0, 1.0, 1.0], [0.0, 0.0, 1.0]], [[3.0, 1.0, 1.0], [0.0, 0.0, 0.0]]])
    whole = problem_of(ranks[0], [1.0, 1.0, 10.0], [[1.0, 0.5]], solver)
    both = replace(problem_of(ranks[0], [1.0, 1.0, 10.0], [[1.0, 0.5]] * 2, solver), matrix=ranks)
    found = solve_redundancy(both)
    assert (found.outcomes == FrameOutcome.SOLVED).all()
    np.testing.assert_allclose(found.equality_residual[0], [0.0, 0.5], atol=1e-6)
    np.testing.assert_allclose(found.controls[0, 0], solve_redundancy(whole).controls[0, 0], atol=1e-6)
    assert found.residual_coordinate[0, 1] == 1
    behind_a_free_one = replace(both, tracked=np.array([True, False, True]))
    assert solve_redundancy(behind_a_free_one).residual_coordinate[0, 1] == 2


def test_a_posture_without_finite_accelerations_costs_its_frame_alone() -> None:
    positions = SLOW.positions.copy()
    positions[3] = np.nan
    found, whole = solve_motion(MODEL, replace(SLOW, positions=positions)), solve_motion(MODEL, SLOW)
    assert [frame for frame, outcome in enumerate(found.outcomes) if outcome is FrameOutcome.NOT_FINITE] == [3]
    assert found.unsolved == 1
    for name in ("activations", "reserves", "reaction", "effort", "equality_residual", "cone_slack"):
        assert np.isnan(getattr(found, name)[3]).all()
        np.testing.assert_allclose(getattr(found, name)[:3], getattr(whole, name)[:3], rtol=1e-12, atol=1e-9)
    after = solve_motion(MODEL, SLOW.cut(slice(4, None)))  # activations start anywhere again
    np.testing.assert_allclose(found.activations[4:], after.activations, rtol=1e-12)


def test_so_does_one_in_which_constraints_become_redundant() -> None:
    positions = SLOW.positions.copy()
    positions[5, MODEL.coordinate_index("elbow_flexion")] = 1.0
    found = solve_motion(with_a_singular_elbow(MODEL), replace(SLOW, positions=positions))
    assert [frame for frame, outcome in enumerate(found.outcomes) if outcome is FrameOutcome.NOT_FINITE] == [5]
    assert found.unsolved == 1


@pytest.mark.shared
@pytest.mark.skipif(not SUBJECT.is_dir(), reason="needs the public data of a lift with locked coordinates")
def test_a_lift_with_locked_coordinates_has_its_published_activations() -> None:
    # Hasan et al. 2025, their solution without a glenoid, made with other software
    model = read_osim(SUBJECT / "S8R_side_as_solved.osim")
    motion = differentiate(read_motion(SUBJECT / "S8R_side.mot", model))
    found = solve_motion(model, motion, RedundancyOptions(has_glenoid_cone=False))
    rows = (SUBJECT / "S8R_side_published_none.txt").read_text().splitlines()
    names, table = rows[0].split(","), np.array([row.split(",") for row in rows[1:]], dtype=float)
    published = table[:, [names.index(name) for name in model.muscle_names]]
    assert np.abs(found.activations - published).mean() < 3e-4


@pytest.mark.parametrize(
    ("option", "value", "known"),
    [
        ("tendons", "Elastic", "'elastic'"),
        ("path_mode", "geodesics", "'geodesic'"),
        ("muscle_force_model", "passive", "'active'"),
        ("solver", "slsqp", "'clarabel'"),
        ("exponent", 4, "2 or 3"),
        ("glenoid_aspect", np.nan, "above 0"),
        ("glenoid_aspect", -0.5, "above 0"),
        ("free_coordinates", "plane_elv", "('plane_elv',)"),
        ("unweighted_coordinates", "elbow_flexion", "('elbow_flexion',)"),
    ],
)
def test_a_value_that_is_not_known_is_refused_with_those_that_are(option: str, value: Any, known: str) -> None:
    with raises_refusal(SolverCode.WRONG_OPTION, naming=option) as caught:
        RedundancyOptions(**{option: value})
    assert known in str(caught.value)


@pytest.mark.parametrize(("option", "value"), [("joints", "knee_r"), ("on", "parents"), ("axes", "world")])
def test_a_request_of_reactions_is_checked_alike(option: str, value: Any) -> None:
    with raises_refusal(SolverCode.WRONG_OPTION, naming=f"{option} is '{value}'"):
        ReactionRequest(**{option: value})


@pytest.mark.parametrize("weight", [-1.0, np.nan])
def test_a_weight_is_a_number_from_zero(weight: float) -> None:
    with raises_refusal(SolverCode.NEGATIVE_WEIGHT, naming=f"{weight:g}"):
        effort_weights(bundled_model(), RedundancyOptions(muscle_weight=weight))
