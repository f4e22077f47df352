"""Inverse kinematics: a stationary point, found again, whatever is hidden, locked or clamped; its covariance against
solving again with every observation moved.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import butter, sosfiltfilt

from recordings.exchange.trc import read_trc
from solver.bundled import bundled_model
from solver.constraint import ConstantDistanceConstraint, CoordinatePrescription, PointOnLineConstraint, WeldConstraint
from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.inverse_kinematics.solve import (
    PostureOutcome,
    TrackingTasks,
    allocate_workspace,
    assemble,
    build_problem,
    estimate_marker_noise,
    posture_uncertainty,
    solve_inverse_kinematics,
    uncertainty_of_postures,
)
from solver.model import Array, CoordinateCoupler, CoordinateLock, Model
from solver.osim.model_reader import read_osim
from solver.osim.tool_setups import read_ik_setup
from tests.refusals import raises_refusal
from tests.solver.inverse_kinematics.marked import cost_of, gaps_of, random_postures, seen_from, tasks_of, with_markers
from tests.solver.linkage import linkage
from tests.solver.osim.test_model_writer import with_first
from tests.solver.references import SHARED

MODELS = pytest.mark.parametrize("make", [bundled_model, linkage], ids=["bundled", "linkage"])
SOLVED = PostureOutcome.SOLVED


def noisy(model: Model, frames: int, noise: float, seed: int = 5) -> tuple[Array, Array]:
    """Postures, and markers that are up to `noise` [m] beside their places."""
    truth = random_postures(model, frames, 0.2, seed)
    away = np.random.default_rng(seed).uniform(-noise, noise, (frames, len(model.markers), 3))
    return truth, seen_from(model, truth) + away


def without_tip(model: Model) -> Model:
    """Without the markers that pronation moves."""
    tip = {model.body_index(name) for name in ("hand", "radius")}
    return replace(model, markers=tuple(marker for marker in model.markers if marker.body not in tip))


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
    both = [replace(tasks, weights=factor * tasks.weights) for factor in (1.0, 1e3)]
    one, other = (solve_inverse_kinematics(model, observed, each) for each in both)
    np.testing.assert_allclose(one.coordinates, other.coordinates, atol=1e-10)
    stated = [posture_uncertainty(model, observed, *each, 1e-3) for each in zip(both, (one, other), strict=True)]
    np.testing.assert_allclose(stated[0].standard_deviation, stated[1].standard_deviation, rtol=1e-8)


def test_a_coordinate_that_no_marker_moves_keeps_its_value_and_is_not_held() -> None:
    """A hidden frame has no figures."""
    model = without_tip(with_markers(bundled_model()))
    _, observed = noisy(model, 3, 0.01)
    observed[2] = np.nan
    start, unseen = assemble(model), model.coordinate_index("pro_sup")
    start[unseen] = 0.7
    found = solve_inverse_kinematics(model, observed, tasks_of(model), start)
    assert found.outcomes == (SOLVED, SOLVED, PostureOutcome.NO_MARKERS)
    np.testing.assert_allclose(found.coordinates[:2, unseen], 0.7, atol=1e-12)
    stated = posture_uncertainty(model, observed, tasks_of(model), found, 1e-3)
    assert np.flatnonzero(~stated.is_held[0]).tolist() == [unseen]
    assert np.isinf(stated.standard_deviation[0, unseen])
    assert np.isnan(stated.covariance[2]).all()


@pytest.mark.parametrize("slope", [None, -0.3], ids=["of one", "of two"])
def test_a_locked_coordinate_stays_and_a_coupled_one_follows(slope: float | None) -> None:
    model = with_markers(linkage())
    curve = polynomial([0.05, 0.5, 0.2])
    coupler = CoordinateCoupler("coupler", 7, (6,), (curve,))
    if slope is not None:
        coupler = CoordinateCoupler("coupler", 7, (6, 10), (curve, polynomial([0.0, slope])))
    bound = replace(model, constraints=(CoordinateLock("lock", 9, 0.3), coupler))
    _, observed = noisy(model, 2, 0.05)
    found = solve_inverse_kinematics(bound, observed, tasks_of(model))
    assert found.outcomes == (SOLVED, SOLVED)
    assert (found.coordinates[:, 9] == 0.3).all()
    q, other = found.coordinates[:, 6], found.coordinates[:, 10]
    np.testing.assert_allclose(
        found.coordinates[:, 7], 0.05 + 0.5 * q + 0.2 * q**2 + (slope or 0.0) * other, atol=1e-10
    )


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


SUBJECT = SHARED / "subject"
NOISE = 1e-3
MARKED = with_markers(bundled_model())
TASKS = tasks_of(MARKED)


def locked_linkage() -> Model:
    model = linkage()
    return replace(model, constraints=(CoordinateLock("lock", 9, 0.1),))


@pytest.mark.parametrize("make", [bundled_model, linkage, locked_linkage])
def test_covariance_is_that_of_solving_again_with_each_marker_moved(make: Callable[[], Model]) -> None:
    """At residuals of centimetres, where Gauss–Newton's figure is wrong."""
    model = with_markers(make(), each=2)
    tasks = tasks_of(model)
    _, observed = noisy(with_markers(make(), each=2), 1, 0.06)
    solution = solve_inverse_kinematics(model, observed, tasks)
    noise = np.random.default_rng(3).uniform(0.5e-3, 2e-3, len(model.markers))
    stated = posture_uncertainty(model, observed, tasks, solution, noise)
    step, covariance = 1e-5, np.zeros_like(stated.covariance[0])
    for marker, axis in np.ndindex(observed.shape[1:]):
        ends = []
        for side in (-step, step):
            moved = observed.copy()
            moved[0, marker, axis] += side
            ends.append(solve_inverse_kinematics(model, moved, tasks, solution.coordinates[0]).coordinates[0])
        slope = (ends[1] - ends[0]) / (2 * step)
        covariance += noise[marker] ** 2 * np.outer(slope, slope)
    scale = np.sqrt(np.diag(covariance)).max()
    np.testing.assert_allclose(stated.covariance[0], covariance, atol=1e-5 * scale**2)
    assert stated.is_held.all()


def test_targets_that_follow_a_coordinate_count_in_posture_and_covariance() -> None:
    """Two coordinates of the girdle follow the elevation; each target is moved."""
    model = with_markers(bundled_model(), each=2)
    slopes, leader = {"scapula_upward_rot": 0.43, "clav_prot": -0.26}, "shoulder_elv"
    weights, targets = dict.fromkeys(slopes, 2e-3), {"scapula_upward_rot": 0.1, "clav_prot": -0.2}
    tasks = replace(
        tasks_of(model), coordinate_weights=weights, coordinate_targets=targets, coordinate_slopes=slopes, leader=leader
    )
    _, observed = noisy(model, 1, 0.03)
    solution = solve_inverse_kinematics(model, observed, tasks)
    q = solution.coordinates[0]
    places = {name: model.coordinate_index(name) for name in (*slopes, leader)}
    away = {name: q[places[name]] - targets[name] - slope * q[places[leader]] for name, slope in slopes.items()}
    of_markers = np.average(solution.residuals[0] ** 2, weights=tasks.weights)
    own = 0.5 * of_markers + sum(0.5 * weights[name] * away[name] ** 2 for name in slopes)
    assert solution.cost[0] == pytest.approx(own, rel=1e-9)
    step, covariance, sigma = 1e-5, np.zeros((len(q), len(q))), np.zeros(len(q))
    for name, deviation in (("scapula_upward_rot", 0.2), ("clav_prot", 0.1)):
        ends = [
            solve_inverse_kinematics(
                model, observed, replace(tasks, coordinate_targets=targets | {name: targets[name] + side}), q
            ).coordinates[0]
            for side in (-step, step)
        ]
        slope = (ends[1] - ends[0]) / (2 * step)
        sigma[places[name]], covariance = deviation, covariance + deviation**2 * np.outer(slope, slope)
    problem = build_problem(model, tasks)
    work = allocate_workspace(model, problem)
    posed = observed, solution.coordinates, solution.multipliers
    (stated,) = uncertainty_of_postures(problem, work, posed, [(np.zeros(len(model.markers)), sigma)])
    np.testing.assert_allclose(stated.covariance[0], covariance, atol=1e-5 * covariance.max())
    alone = solve_inverse_kinematics(model, observed, replace(tasks, coordinate_slopes={}, leader="")).coordinates[0]
    assert np.abs(alone - q).max() > 0.01


def test_a_clamped_coordinate_that_no_marker_moves_is_not_held_where_it_stands_at_its_bound() -> None:
    model = without_tip(with_markers(bundled_model()))
    unseen = model.coordinate_index("pro_sup")
    lowest = model.default_coordinates[unseen]
    model = with_first(model, "coordinates", unseen, range=(lowest, lowest + 1.0), is_clamped=True)
    _, observed = noisy(model, 1, 0.01)
    solution = solve_inverse_kinematics(model, observed, tasks_of(model))
    assert solution.coordinates[0, unseen] == lowest
    assert not posture_uncertainty(model, observed, tasks_of(model), solution, 1e-3).is_held[0, unseen]


@pytest.mark.shared
@pytest.mark.parametrize("lift", ["side", "back"])
def test_standard_deviations_of_a_patients_lift_are_those_of_four_thousand_draws(lift: str) -> None:
    """Residuals of 23 and 27 mm; coordinates are locked, clamped, and one is at its bound."""
    model = read_osim(SUBJECT / f"S8R_{lift}_as_solved.osim")
    setup = read_ik_setup(SUBJECT / f"S8R_{lift}_ik_setup.xml")
    table = read_trc(SUBJECT / f"S8R_{lift}.trc", tracked=setup.markers)
    tasks = setup.tasks(model, table.labels, table.time_s)
    observed = 1e-3 * table.positions[150:151, [table.labels.index(marker.name) for marker in tasks.markers]]
    solution = solve_inverse_kinematics(model, observed, tasks)
    stated = posture_uncertainty(model, observed, tasks, solution, 1e-3)
    away = 1e-3 * np.random.default_rng(1).standard_normal((4000, *observed.shape[1:]))
    drawn = solve_inverse_kinematics(model, observed + away, tasks, solution.coordinates[0])
    assert drawn.unsolved == 0
    spread = drawn.coordinates.std(axis=0)
    free = stated.is_held[0] & (spread > 1e-9)
    assert free.sum() == {"side": 14, "back": 16}[lift]
    np.testing.assert_allclose(stated.standard_deviation[0, free], spread[free], rtol=0.05)


def test_marker_noise_is_found_beneath_motion_and_gaps() -> None:
    observed, noise = moving_markers()
    np.testing.assert_allclose(estimate_marker_noise(observed, 0.01), noise, rtol=0.06)
    assert np.isnan(estimate_marker_noise(np.full((60, 1, 3), np.nan), 0.01)).all()
    assert np.isnan(estimate_marker_noise(np.zeros((10, 1, 3)), 0.01)).all()


def test_a_marker_that_jumps_for_a_while_keeps_its_noise() -> None:
    observed, noise = moving_markers()
    observed[900:920, 1] += 0.6
    np.testing.assert_allclose(estimate_marker_noise(observed, 0.01), noise, rtol=0.15)


def test_marker_noise_is_found_in_a_file_that_was_filtered_at_20_hz() -> None:
    """What neighbouring frames show of it is a tenth."""
    observed, noise = moving_markers()
    filtered = sosfiltfilt(butter(2, 20.0, fs=100.0, output="sos"), np.nan_to_num(observed[450:]), axis=0)
    np.testing.assert_allclose(estimate_marker_noise(filtered, 0.01), noise, rtol=0.45)
    third = np.diff(filtered, n=3, axis=0).std(axis=(0, 2)) / np.sqrt(20.0)
    assert (third < 0.35 * noise).all()


def moving_markers() -> tuple[np.ndarray, np.ndarray]:
    """Two markers at 100 Hz, the first hidden for a second, and their noise [m]."""
    chance = np.random.default_rng(4)
    time = np.arange(0, 20, 0.01)
    noise = np.array([0.2e-3, 1e-3])
    motion = 0.3 * np.sin(2 * np.pi * 0.8 * time)[:, None, None]
    observed = motion + noise[:, None] * chance.standard_normal((len(time), 2, 3))
    observed[300:400, 0] = np.nan
    return observed, noise
