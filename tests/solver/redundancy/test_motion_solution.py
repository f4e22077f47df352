"""The redundancy problem: sharing by hand, the rank a constraint takes, activation dynamics, and a whole motion.

A motion solved in blocks has the solution of all frames at once, and only that takes memory.
"""

import tracemalloc
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.model import GROUND, CoordinateActuator, Model
from solver.motion import Kinematics, decimate, differentiate
from solver.multibody.dynamics import ReactionRequest
from solver.multibody.loads import ExternalForce
from solver.redundancy import motion_solution as motion_module
from solver.redundancy.effort import RedundancyOptions, Reserve, with_reserves
from solver.redundancy.mechanics import angle_between, evaluate_motion, glenoid_cone
from solver.redundancy.motion_solution import MotionSolution, solve_motion
from solver.redundancy.problem import FrameOutcome, LoadResponse, build_redundancy
from solver.redundancy.sequence import solve_redundancy, solve_sequence, solve_sequence_with_clarabel
from tests.refusals import raises_refusal
from tests.solver.redundancy.test_interior_point import random_sequence
from tests.solver.redundancy.test_problem import problem_of, with_a_singular_elbow

MODEL = bundled_model()
SLOW = decimate(differentiate(simulate_arm_raise(MODEL)), 40)
FRAMES = len(SLOW.time)
REACTIONS = RedundancyOptions(reactions=ReactionRequest(("GlenoHumeral",)))
LOAD = ExternalForce(
    name="push",
    body=MODEL.body_index("hand"),
    axes=GROUND,
    force=np.linspace([0.0, 0.0, 0.0], [10.0, -5.0, 2.0], FRAMES),
    torque=np.zeros((FRAMES, 3)),
    origin=MODEL.body_index("hand"),
    point=np.zeros((FRAMES, 3)),
)

Solve = Callable[[], MotionSolution]
CONE_ALONG_X = np.array([[0.5, 0, 0], [0, 1, 0], [0, 0, 1]])  # muscle 2 at most half of muscle 1
CONE_ALONG_Y = np.array([[0, 0.1, 0], [1, 0, 0], [0, 0, 1]])  # muscle 1 at most a tenth of muscle 2


def two_muscles(target, interval=1.0, cone=None):
    """Two muscles with moment arms 3 and 1 and a reserve of weight 10 on one coordinate, seen by two equal rows.

    The reaction is (muscle 1, muscle 2, 0) in the force's x, y, z.
    """
    problem = problem_of([[3.0, 1.0, 1.0]] * 2, [1.0, 1.0, 10.0], target, interval=interval)
    reaction = problem.reaction_matrix.copy()
    reaction[:, 3, 0] = reaction[:, 4, 1] = 1.0
    cones = problem.cone if cone is None else np.tile(cone, (len(target), 1, 1))
    return replace(problem, reaction_matrix=reaction, cone=cones)


def test_muscles_share_in_proportion_to_their_moment_arms_and_the_reserve_to_its_weight():
    solution = solve_redundancy(two_muscles([[1.01, 1.01]]))
    np.testing.assert_allclose(solution.controls[0, 0], np.array([3, 1, 0.1]) / 10.1 * 1.01, atol=1e-7)
    assert solution.equality_residual[0, 0] == pytest.approx(0, abs=1e-7)


def test_what_the_constraint_forbids_is_left_out_and_reported():
    solution = solve_redundancy(two_muscles([[1.0, 1.2]]))
    assert solution.outcomes[0, 0] is FrameOutcome.SOLVED
    np.testing.assert_allclose(solution.controls[0, 0] @ [3, 1, 1], 1.1, atol=1e-7)
    assert solution.equality_residual[0, 0] == pytest.approx(0.1, abs=1e-7)


def test_activation_changes_no_faster_than_the_muscle_can():
    solution = solve_redundancy(two_muscles([[3.0, 3.0], [0.0, 0.0]], interval=0.01))
    before, after = solution.controls[0, :, :2]
    np.testing.assert_allclose(after, before - before * (0.5 + 1.5 * before) * 0.01 / 0.04, atol=1e-6)


def test_the_cone_makes_muscles_share_otherwise():
    free = solve_redundancy(two_muscles([[1.0, 1.0]])).controls[0, 0]
    held = solve_redundancy(two_muscles([[1.0, 1.0]], cone=CONE_ALONG_Y))
    assert free[0] > free[1]
    assert held.controls[0, 0, 0] == pytest.approx(0.1 * held.controls[0, 0, 1], abs=1e-5)
    assert held.cone_slack[0, 0] == pytest.approx(0, abs=1e-2)


def test_a_frame_beyond_the_activation_rate_alone_is_solved_with_that_outcome():
    # the cone turns by a right angle between two frames: muscle 1 cannot let go within a millisecond
    problem = two_muscles([[3.0, 3.0], [1.0, 1.0]], interval=0.001, cone=CONE_ALONG_X)
    solution = solve_redundancy(replace(problem, cone=np.stack([CONE_ALONG_X, CONE_ALONG_Y])))
    assert list(solution.outcomes[0]) == [FrameOutcome.SOLVED, FrameOutcome.BEYOND_ACTIVATION_RATE]
    assert np.isfinite(solution.controls).all()


def test_an_infeasible_frame_is_an_outcome_and_the_next_one_is_solved():
    problem = two_muscles([[1.0, 1.0], [1.0, 1.0]], cone=CONE_ALONG_X)
    pushed_out = np.zeros((1, 2, 6))
    pushed_out[0, 0, 3] = -50.0  # more than the muscles can make good
    solution = solve_redundancy(problem, LoadResponse(np.zeros((1, 2, 2)), pushed_out))
    assert list(solution.outcomes[0]) == [FrameOutcome.INFEASIBLE, FrameOutcome.SOLVED]
    assert np.isnan(solution.controls[0, 0]).all()
    assert np.isfinite(solution.controls[0, 1]).all()
    # muscle 1, which alone pulls along the axis, gives 1 N of the 50; muscle 2 is left what hardly matters
    assert solution.cone_slack[0, 0] == pytest.approx(-0.5 * 49, abs=0.5)
    assert solution.equality_residual[0, 0] == pytest.approx(0, abs=1e-4)


def test_a_load_far_beyond_the_muscles_is_left_to_the_reserves_as_by_clarabel():
    # 60 kg: multipliers beyond 1e6, where the interior point comes to the end of its numbers
    motion = decimate(differentiate(simulate_arm_raise(MODEL)), 8)
    frames, hand = len(motion.time), len(MODEL.bodies) - 1
    weight = np.tile([0.0, -9.80665 * 60, 0.0], (frames, 1))
    place = np.tile(MODEL.bodies[hand].mass_center, (frames, 1))
    load = ExternalForce("weight", hand, GROUND, weight, np.zeros_like(weight), hand, place)
    problem = build_redundancy(MODEL, evaluate_motion(MODEL, motion, loads=[load]), RedundancyOptions())
    found, known = solve_redundancy(problem), solve_redundancy(replace(problem, solver="clarabel", interval=1e3))
    assert (found.outcomes == FrameOutcome.SOLVED).all()
    found = solve_redundancy(replace(problem, interval=1e3))  # the very same problems for both
    effort, expected = ((problem.weights * each.controls[0] ** 2).sum(axis=-1) for each in (found, known))
    assert effort.max() > 1e6
    np.testing.assert_allclose(effort, expected, rtol=1e-6)


def test_scenarios_solved_together_are_those_solved_alone():
    problem = two_muscles([[1.0, 1.0], [2.0, 2.0]], cone=CONE_ALONG_X)
    loads = LoadResponse(np.random.default_rng(2).uniform(0, 1, (3, 2, 2)), np.zeros((3, 2, 6)))
    together = solve_redundancy(problem, loads)
    for i in range(3):
        alone = solve_redundancy(problem, LoadResponse(loads.acceleration[[i]], loads.reaction[[i]]))
        np.testing.assert_allclose(together.controls[i], alone.controls[0], atol=1e-6)


def test_scenarios_divided_among_workers_are_those_of_one():
    mechanics = evaluate_motion(MODEL, SLOW)
    problem = build_redundancy(MODEL, mechanics, RedundancyOptions())
    frames, rows = len(SLOW.time), len(problem.tracked)
    more = np.linspace(-1, 1, 5)[:, None, None]
    loads = LoadResponse(more * np.ones((1, frames, rows)), 5 * more * np.ones((1, frames, 6)))
    one, four = (solve_redundancy(problem, loads, workers=workers) for workers in (1, 4))
    np.testing.assert_array_equal(four.outcomes, one.outcomes)
    np.testing.assert_array_equal(four.residual_coordinate, one.residual_coordinate)
    for name in ("controls", "equality_residual", "reaction", "cone_slack"):
        np.testing.assert_allclose(getattr(four, name), getattr(one, name), rtol=1e-9, atol=1e-9)


def test_a_raised_arm_keeps_its_head_in_the_socket_and_its_equations():
    mechanics = evaluate_motion(MODEL, SLOW)
    result = solve_motion(MODEL, SLOW)
    cone = glenoid_cone(MODEL)
    angle = angle_between(mechanics.state.rotation_to_ground[:, cone.body] @ cone.axis, result.reaction[:, 3:])
    assert result.unsolved == 0
    assert angle.max() <= cone.half_angle + 1e-6
    assert result.cone_slack.min() > -1e-2
    tension = mechanics.forces.active * result.activations + mechanics.forces.passive
    np.testing.assert_allclose(result.muscle_forces, tension)
    assert 0.001 < result.equality_residual.max() < 0.3  # what the acromioclavicular joint forbids of u := dq/dt


def test_without_the_cone_the_effort_is_smaller_and_the_head_leaves_the_rim_of_the_glenoid():
    held, loose = solve_motion(MODEL, SLOW), solve_motion(MODEL, SLOW, RedundancyOptions(has_glenoid_cone=False))
    assert (loose.activations**2).sum() < (held.activations**2).sum()
    assert np.isinf(loose.cone_slack).all()
    rim = np.array(glenoid_cone(MODEL).rim)
    assert np.hypot(*(held.contact / rim).T).max() <= 1 + 1e-6
    assert np.hypot(*(loose.contact / rim).T).max() > 1.1
    forces = np.array([actuator.optimal_force for actuator in MODEL.actuators[8:]])
    expected = (held.activations**2).sum(axis=1) + 10 * ((held.reserves[:, 8:] / forces) ** 2).sum(axis=1)
    np.testing.assert_allclose(held.effort, expected, rtol=1e-9)


def test_a_free_coordinate_is_not_tracked_and_saves_effort():
    options = RedundancyOptions(free_coordinates=("plane_elv", "axial_rot"))
    problem = build_redundancy(MODEL, evaluate_motion(MODEL, SLOW), options)
    assert problem.matrix.shape[1] == 15
    tracked, free = solve_motion(MODEL, SLOW), solve_motion(MODEL, SLOW, options)
    assert (free.activations**2).sum() < (tracked.activations**2).sum()


def test_a_weight_by_name_is_that_of_the_muscle_or_of_the_coordinates_actuator():
    dear = MODEL.muscle_names[4]
    options = RedundancyOptions(weights={dear: 7.0, "plane_elv": 3.0})
    weights = build_redundancy(MODEL, evaluate_motion(MODEL, decimate(SLOW, 10)), options).weights
    plane = [actuator.coordinate for actuator in MODEL.actuators].index(MODEL.coordinate_index("plane_elv"))
    assert weights[4] == 7.0
    assert weights[33 + plane] == 3.0
    assert sorted(set(weights)) == [0.0, 1.0, 3.0, 7.0, 10.0]


def test_a_stronger_reserve_takes_the_place_of_the_coordinates_own():
    stronger = with_reserves(MODEL, {"plane_elv": Reserve(20.0)})
    assert len(stronger.actuators) == len(MODEL.actuators)
    usual, eased = solve_motion(MODEL, SLOW), solve_motion(stronger, SLOW)
    own = [actuator.coordinate for actuator in MODEL.actuators].index(MODEL.coordinate_index("plane_elv"))
    assert stronger.actuators[-1].optimal_force == 20.0
    assert np.abs(eased.reserves[:, -1]).max() > 2 * np.abs(usual.reserves[:, own]).max()


def test_a_narrower_glenoid_costs_more():
    round_one, narrow = (solve_motion(MODEL, SLOW, RedundancyOptions(glenoid_aspect=aspect)) for aspect in (1.0, 0.7))
    assert (narrow.activations**2).sum() > (round_one.activations**2).sum()
    assert narrow.cone_slack.min() > -1e-3


def test_the_joint_whose_reaction_counts_may_have_another_name():
    motion = decimate(SLOW, 2)
    renamed = replace(
        MODEL,
        joints=tuple(replace(each, name="shoulder") if each.name == "GlenoHumeral" else each for each in MODEL.joints),
    )
    found, expected = solve_motion(renamed, motion, RedundancyOptions(joint="shoulder")), solve_motion(MODEL, motion)
    np.testing.assert_array_equal(found.reaction, expected.reaction)
    elbow = solve_motion(MODEL, motion, RedundancyOptions(has_glenoid_cone=False, joint="elbow"))
    assert np.linalg.norm(elbow.reaction[:, 3:], axis=1).max() < np.linalg.norm(expected.reaction[:, 3:], axis=1).max()
    assert np.isnan(elbow.contact).all()
    with raises_refusal(SolverCode.UNKNOWN_NAME, naming="GlenoHumeral"):
        solve_motion(renamed, motion)


@pytest.mark.parametrize(
    ("model", "options", "code", "naming"),
    [
        (MODEL, {"weights": {"no_such_muscle": 1.0}}, SolverCode.UNKNOWN_NAME, "no_such_muscle"),
        (MODEL, {"weights": {"plane_elv": -1.0}}, SolverCode.NEGATIVE_WEIGHT, "-1"),
        (MODEL, {"free_coordinates": ("elbow_twist",)}, SolverCode.UNKNOWN_NAME, "elbow_twist"),
        (replace(MODEL, muscles=()), {}, SolverCode.NO_MUSCLES, ""),
    ],
    ids=["weight of no muscle", "negative weight", "unknown free coordinate", "no muscles"],
)
def test_a_problem_that_cannot_be_built_is_refused(model, options, code, naming):
    with raises_refusal(code, naming):
        solve_motion(model, decimate(SLOW, 10), RedundancyOptions(**options))


def test_a_motion_in_which_nothing_can_be_evaluated_is_refused():
    with raises_refusal(SolverCode.NO_ACCELERATIONS, naming="16 postures"):
        solve_motion(MODEL, replace(SLOW, positions=np.full_like(SLOW.positions, np.nan)))


def test_a_control_keeps_its_limits_and_muscles_do_the_rest():
    problem = two_muscles([[4.0, 4.0]])
    free = solve_redundancy(replace(problem, weights=np.array([1.0, 1.0, 0.01])))
    held = solve_redundancy(
        replace(problem, weights=np.array([1.0, 1.0, 0.01]), control_limits=np.array([[-np.inf], [0.5]]))
    )
    assert free.controls[0, 0, 2] > 1
    assert held.outcomes[0, 0] is FrameOutcome.SOLVED
    assert held.controls[0, 0, 2] == pytest.approx(0.5, abs=1e-6)
    np.testing.assert_allclose(held.controls[0, 0] @ [3, 1, 1], 4.0, atol=1e-6)


def test_a_problem_without_a_cone_that_limits_make_infeasible_misses_as_little_as_can_be():
    limits = np.array([[-0.5], [0.5]])
    solution = solve_redundancy(replace(two_muscles([[6.0, 6.0]]), control_limits=limits))
    assert solution.outcomes[0, 0] is FrameOutcome.INFEASIBLE
    assert solution.equality_residual[0, 0] == pytest.approx(6.0 - 4.5, abs=1e-3)


def _solved(monkeypatch: pytest.MonkeyPatch, frames_at_once: int, solve: Solve) -> tuple[MotionSolution, int]:
    """The solution, and the number of frames of the longest part that was solved at once."""
    longest, kept = [], motion_module._solve

    def counted(motion: Any, *rest: Any, **more: Any) -> MotionSolution:
        longest.append(len(motion.kinematics.time))
        return kept(motion, *rest, **more)

    with monkeypatch.context() as patch:
        patch.setattr(motion_module, "FRAMES_AT_ONCE", frames_at_once)
        patch.setattr(motion_module, "_solve", counted)
        return solve(), max(longest)


def _assert_equal(found: MotionSolution, known: MotionSolution) -> None:
    for field in fields(MotionSolution):
        ours, theirs = getattr(found, field.name), getattr(known, field.name)
        if field.name == "joint_reactions":
            for part in fields(theirs):
                np.testing.assert_array_equal(getattr(ours, part.name), getattr(theirs, part.name))
        else:
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("frames_at_once", [1, 7])
def test_blocks_of_any_size_have_the_solution_of_all_frames_at_once(
    monkeypatch: pytest.MonkeyPatch, frames_at_once: int
) -> None:
    def solve() -> MotionSolution:
        return solve_motion(MODEL, SLOW, REACTIONS, loads=[LOAD])

    known, at_once = _solved(monkeypatch, FRAMES, solve)
    found, longest = _solved(monkeypatch, frames_at_once, solve)
    assert at_once == FRAMES and longest <= frames_at_once + 1
    _assert_equal(found, known)


def _with_a_lost_posture() -> tuple[Model, Kinematics]:
    positions = SLOW.positions.copy()
    positions[FRAMES // 2] = np.nan
    return MODEL, replace(SLOW, positions=positions)


def _with_a_redundant_constraint_in_one_posture() -> tuple[Model, Kinematics]:
    positions = SLOW.positions.copy()
    positions[FRAMES // 2, MODEL.coordinate_index("elbow_flexion")] = 1.0
    return with_a_singular_elbow(MODEL), replace(SLOW, positions=positions)


def _with_limited_actuators() -> tuple[Model, Kinematics]:
    actuators = [replace(one, min_control=-50.0) for one in MODEL.actuators if isinstance(one, CoordinateActuator)]
    return replace(MODEL, actuators=tuple(actuators)), SLOW


def _without_an_actuator() -> tuple[Model, Kinematics]:
    elevation = MODEL.coordinate_index("shoulder_elv")
    kept = [one for one in MODEL.actuators if isinstance(one, CoordinateActuator) and one.coordinate != elevation]
    return replace(MODEL, actuators=tuple(kept)), SLOW


@pytest.mark.parametrize(
    "irregular",
    [_with_a_lost_posture, _with_a_redundant_constraint_in_one_posture, _with_limited_actuators, _without_an_actuator],
)
def test_a_motion_whose_frames_depend_on_one_another_is_solved_as_a_whole(
    monkeypatch: pytest.MonkeyPatch, irregular: Callable[[], tuple[Model, Kinematics]]
) -> None:
    model, kinematics = irregular()
    known, _ = _solved(monkeypatch, FRAMES, lambda: solve_motion(model, kinematics))
    found, longest = _solved(monkeypatch, 7, lambda: solve_motion(model, kinematics))
    assert longest == FRAMES
    _assert_equal(found, known)


def test_progress_counts_the_frames_of_all_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[int, int]] = []
    monkeypatch.setattr(motion_module, "FRAMES_AT_ONCE", 7)
    solve_motion(MODEL, SLOW, progress=lambda done, total: seen.append((done, total)))
    assert seen[0] == (0, FRAMES) and seen[-1] == (FRAMES, FRAMES) and len(seen) > 2
    assert seen == sorted(seen)


def test_a_longer_motion_takes_memory_for_its_solution_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion_module, "FRAMES_AT_ONCE", 10)
    monkeypatch.setattr(motion_module, "keep_freed_memory", lambda: None)
    longer = {name: np.concatenate([getattr(SLOW, name)] * 4) for name in ("positions", "speeds", "accelerations")}
    four_times = replace(SLOW, time=np.arange(4 * FRAMES) * SLOW.interval, **longer)
    once, more = _peak(SLOW), _peak(four_times)
    solution = 2 * 3000  # bytes per frame, of the parts and of what they are joined to; a frame is solved in 45 kB
    assert more - once < 3 * FRAMES * solution


def _peak(kinematics: Kinematics) -> int:
    solve_motion(MODEL, kinematics)
    tracemalloc.start()
    try:
        solve_motion(MODEL, kinematics)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_rank_that_changes_after_the_first_block_is_solved_by_clarabel() -> None:
    sequence = random_sequence(3, frames=203)
    matrix, target = sequence.matrix.copy(), sequence.target.copy()
    matrix[201:, 1] = matrix[201:, 0]
    matrix[201:, 2:] = 0.0
    target[:, 201:, 1], target[:, 201:, 2:] = target[:, 201:, 0], 0.0
    changing = replace(sequence, matrix=matrix, target=target)
    found, outcomes = solve_sequence(changing, lambda *_: None)
    known, expected = solve_sequence_with_clarabel(changing, lambda *_: None)
    np.testing.assert_array_equal(found, known)
    np.testing.assert_array_equal(outcomes, expected)
    assert FrameOutcome.SOLVED in outcomes
