"""Inverse kinematics against its statement: a stationary point, found again, whatever is hidden, locked or clamped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from solver.bundled import bundled_model
from solver.constraint import (
    ConstantDistanceConstraint,
    CoordinatePrescription,
    PointOnLineConstraint,
    WeldConstraint,
)
from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.inverse_kinematics.solve import PostureOutcome, TrackingTasks, assemble, solve_inverse_kinematics
from solver.model import CoordinateCoupler, CoordinateLock, Model
from tests.refusals import raises_refusal
from tests.solver.inverse_kinematics.marked import (
    cost_of,
    gaps_of,
    random_postures,
    seen_from,
    tasks_of,
    with_markers,
)
from tests.solver.linkage import linkage

Array = NDArray[np.float64]
MODELS = pytest.mark.parametrize("make", [bundled_model, linkage], ids=["bundled", "linkage"])
SOLVED = PostureOutcome.SOLVED


def noisy(model: Model, frames: int, noise: float, seed: int = 5) -> tuple[Array, Array]:
    """Postures, and markers that are up to `noise` [m] beside their places."""
    truth = random_postures(model, frames, 0.2, seed)
    away = np.random.default_rng(seed).uniform(-noise, noise, (frames, len(model.markers), 3))
    return truth, seen_from(model, truth) + away


@MODELS
def test_markers_at_their_places_give_the_posture_back(make: Callable[[], Model]) -> None:
    model = with_markers(make())
    truth, observed = noisy(model, 4, 0.0)
    found = solve_inverse_kinematics(model, observed, tasks_of(model))
    assert found.outcomes == (SOLVED,) * 4
    np.testing.assert_allclose(found.coordinates, truth, atol=1e-8)
    assert found.residuals.max() < 1e-9
    assert found.gap.max() < 1e-10


@MODELS
def test_a_first_frame_far_from_the_default_posture_reaches_the_lowest_optimum(make: Callable[[], Model]) -> None:
    model = with_markers(make())
    for observed in seen_from(model, random_postures(model, 10, 1.0, 3)):
        found = solve_inverse_kinematics(model, observed[None], tasks_of(model))
        assert found.outcomes == (SOLVED,)
        assert found.cost[0] < 1e-15
        turned = np.abs(found.coordinates[0] - model.default_coordinates)
        assert turned.max() < np.pi + 0.1  # no whole turns


@MODELS
def test_the_lagrangian_is_stationary_at_the_posture_found(make: Callable[[], Model]) -> None:
    """Derivatives by central differences of another derivation of points and gaps."""
    model = with_markers(make())
    tasks = replace(tasks_of(model), coordinate_weights={model.coordinate_names[2]: 1e-3})
    _, observed = noisy(model, 3, 0.03)
    found = solve_inverse_kinematics(model, observed, tasks)
    assert found.outcomes == (SOLVED,) * 3
    np.testing.assert_allclose(cost_of(model, tasks, observed, found.coordinates), found.cost, rtol=1e-12)
    step = 1e-6
    for k in range(len(model.coordinates)):
        moved = np.zeros(len(model.coordinates))
        moved[k] = step
        ends = [
            cost_of(model, tasks, observed, q) + (gaps_of(model, q) * found.multipliers).sum(axis=1)
            for q in (found.coordinates + moved, found.coordinates - moved)
        ]
        assert np.abs(ends[0] - ends[1]).max() / (2 * step) < 1e-9


def test_a_frame_is_solved_without_its_hidden_markers_and_an_empty_one_is_no_posture() -> None:
    model = with_markers(bundled_model())
    tasks = tasks_of(model)
    _, observed = noisy(model, 3, 0.01)
    observed[1, ::4] = np.nan
    shown = np.isfinite(observed[1, :, 0])
    part = TrackingTasks(tuple(np.array(model.markers, object)[shown]), tasks.weights[shown])
    alone = solve_inverse_kinematics(model, observed[1:2, shown], part)
    whole = solve_inverse_kinematics(model, observed, tasks)
    np.testing.assert_allclose(whole.coordinates[1], alone.coordinates[0], atol=1e-9)
    assert np.isnan(whole.residuals[1]).tolist() == (~shown).tolist()

    before = whole.coordinates[2]
    observed[1] = np.nan
    gone = solve_inverse_kinematics(model, observed, tasks)
    assert gone.outcomes == (SOLVED, PostureOutcome.NO_MARKERS, SOLVED)
    assert gone.unsolved == 1
    assert np.isnan(gone.coordinates[1]).all()
    np.testing.assert_allclose(gone.coordinates[2], before, atol=1e-9)


def test_only_ratios_of_marker_weights_matter() -> None:
    model = with_markers(bundled_model())
    _, observed = noisy(model, 2, 0.02)
    tasks = tasks_of(model)
    one = solve_inverse_kinematics(model, observed, tasks)
    other = solve_inverse_kinematics(model, observed, replace(tasks, weights=1e3 * tasks.weights))
    np.testing.assert_allclose(one.coordinates, other.coordinates, atol=1e-10)


def test_a_coordinate_that_no_marker_moves_keeps_its_value() -> None:
    model = with_markers(bundled_model())
    tip = {model.body_index(name) for name in ("hand", "radius")}
    kept = tuple(marker for marker in model.markers if marker.body not in tip)
    model = replace(model, markers=kept)
    _, observed = noisy(model, 2, 0.01)
    start = assemble(model)
    unseen = model.coordinate_index("pro_sup")
    start[unseen] = 0.7
    found = solve_inverse_kinematics(model, observed, tasks_of(model), start)
    assert found.outcomes == (SOLVED, SOLVED)
    np.testing.assert_allclose(found.coordinates[:, unseen], 0.7, atol=1e-12)


def test_a_locked_coordinate_stays_and_a_coupled_one_follows() -> None:
    model = with_markers(linkage())
    lock = CoordinateLock("lock", 9, 0.3)
    coupler = CoordinateCoupler("coupler", 7, (6,), (polynomial([0.05, 0.5, 0.2]),))
    bound = replace(model, constraints=(lock, coupler))
    _, observed = noisy(model, 2, 0.05)
    found = solve_inverse_kinematics(bound, observed, tasks_of(model))
    assert found.outcomes == (SOLVED, SOLVED)
    assert (found.coordinates[:, 9] == 0.3).all()
    q = found.coordinates[:, 6]
    np.testing.assert_allclose(found.coordinates[:, 7], 0.05 + 0.5 * q + 0.2 * q**2, atol=1e-10)


def test_a_coordinate_follows_several() -> None:
    model = with_markers(linkage())
    coupler = CoordinateCoupler("coupler", 7, (6, 9), (polynomial([0.05, 0.5, 0.2]), polynomial([0.0, -0.3])))
    _, observed = noisy(model, 2, 0.05)
    found = solve_inverse_kinematics(replace(model, constraints=(coupler,)), observed, tasks_of(model))
    assert found.outcomes == (SOLVED, SOLVED)
    q, other = found.coordinates[:, 6], found.coordinates[:, 9]
    np.testing.assert_allclose(found.coordinates[:, 7], 0.05 + 0.5 * q + 0.2 * q**2 - 0.3 * other, atol=1e-10)


def test_a_weld_holds_as_locks_of_the_same_coordinates_do() -> None:
    model = with_markers(linkage())
    locks = tuple(CoordinateLock(f"lock {k}", k, 0.0) for k in (8, 9, 10))  # of the ball between the last two bodies
    joint = model.joints[2]
    ends = joint.frame_in_parent, joint.frame_in_child
    places, turns = [end.translation for end in ends], [end.rotation for end in ends]
    weld = WeldConstraint("weld", joint.parent, joint.child, *places, *turns)
    _, observed = noisy(model, 2, 0.05)
    bound = [replace(model, constraints=held) for held in ((weld,), locks)]
    welded, locked = (solve_inverse_kinematics(each, observed, tasks_of(model)) for each in bound)
    assert welded.outcomes == (SOLVED, SOLVED)
    np.testing.assert_allclose(welded.coordinates, locked.coordinates, atol=1e-7)


@pytest.mark.parametrize("kind", ["distance", "line", "prescription"])
def test_a_constraint_that_inverse_kinematics_lacks_is_refused_by_name(kind: str) -> None:
    ends = np.zeros(3), np.ones(3)
    constraint = {
        "distance": ConstantDistanceConstraint("rod", 0, 3, *ends, 0.4),
        "line": PointOnLineConstraint("rail", 0, 3, *ends, np.array([1.0, 0.0, 0.0])),
        "prescription": CoordinatePrescription("rise", 8, polynomial([0.0, 1.0])),
    }[kind]
    with raises_refusal(SolverCode.UNSUPPORTED, naming=constraint.name):
        assemble(replace(linkage(), constraints=(constraint,)))


def test_clamped_coordinates_reach_the_optimum_that_scipy_finds() -> None:
    model = with_markers(linkage())
    clamped = {0: (-0.05, 0.05), 6: (-0.02, 0.3), 8: (0.04, 0.2)}
    model = replace(
        model,
        coordinates=tuple(
            replace(coordinate, range=clamped[k], is_clamped=True) if k in clamped else coordinate
            for k, coordinate in enumerate(model.coordinates)
        ),
    )
    tasks = tasks_of(model)
    free = replace(model, coordinates=linkage().coordinates)
    observed = noisy(free, 3, 0.02, seed=8)[1]
    found = solve_inverse_kinematics(model, observed, tasks)
    assert found.outcomes == (SOLVED,) * 3
    bounds = [clamped.get(k, (None, None)) for k in range(len(model.coordinates))]
    at_bound = 0
    assert found.rounds.max() < 20
    for frame, q in enumerate(found.coordinates):
        seen = observed[frame : frame + 1]
        best = minimize(
            lambda x, seen=seen: 1e4 * cost_of(free, tasks, seen, x[None])[0],
            q + 0.01,
            method="L-BFGS-B",
            bounds=bounds,
            options={"ftol": 1e-15, "gtol": 1e-10, "maxiter": 2000},
        )
        assert found.cost[frame] <= best.fun / 1e4 + 1e-12
        np.testing.assert_allclose(q, best.x, atol=2e-4)
        at_bound += sum(q[k] in limits for k, limits in clamped.items())
    assert at_bound >= 3


@MODELS
def test_a_frame_at_the_limit_of_rounds_is_not_converged(make: Callable[[], Model]) -> None:
    model = with_markers(make())
    _, observed = noisy(model, 2, 0.02)
    starved = solve_inverse_kinematics(model, observed, tasks_of(model), most_rounds=1)
    assert starved.outcomes == (PostureOutcome.NOT_CONVERGED,) * 2
    assert starved.rounds.tolist() == [1, 1]


def test_constraints_that_contradict_each_other_are_refused() -> None:
    model = with_markers(linkage())
    coupler = CoordinateCoupler("coupler", 7, (6,), (polynomial([0.0, 1.0]),))
    locks = (CoordinateLock("one", 6, 0.1), CoordinateLock("two", 7, 0.4))
    bound = replace(model, constraints=(coupler, *locks))
    found = solve_inverse_kinematics(bound, noisy(model, 1, 0.0)[1], tasks_of(model), model.default_coordinates)
    assert found.outcomes == (PostureOutcome.GAP_OPEN,)
    assert found.gap[0] == pytest.approx(0.3)
    with raises_refusal(SolverCode.CONSTRAINTS_NOT_MET):
        assemble(bound)


@pytest.mark.parametrize(
    ("weights", "code"),
    [
        ([1.0, -1.0], SolverCode.NEGATIVE_WEIGHT),
        ([np.nan, 1.0], SolverCode.NEGATIVE_WEIGHT),
        ([1.0], SolverCode.WRONG_SHAPE),
    ],
)
def test_invalid_weights_are_refused(weights: list[float], code: SolverCode) -> None:
    model = with_markers(linkage())
    tasks = TrackingTasks(model.markers[:2], np.array(weights))
    with raises_refusal(code):
        solve_inverse_kinematics(model, np.zeros((1, 2, 3)), tasks)
