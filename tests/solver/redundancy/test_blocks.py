"""A motion solved in blocks has the solution of all frames at once, and only that takes memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.model import GROUND, CoordinateActuator, Model
from solver.motion import Kinematics, decimate, differentiate
from solver.multibody.external_loads import ExternalForce
from solver.multibody.joint_reactions import ReactionRequest
from solver.raise_arm import simulate_arm_raise
from solver.redundancy import motion as motion_module
from solver.redundancy.motion import solve_motion
from solver.redundancy.motion_solution import MotionSolution
from solver.redundancy.options import RedundancyOptions
from solver.redundancy.sequence import FrameOutcome, solve_sequence, solve_sequence_with_clarabel
from tests.solver.redundancy.test_interior_point import random_sequence
from tests.solver.redundancy.test_reachability import with_a_singular_elbow

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


def _solved(monkeypatch: pytest.MonkeyPatch, frames_at_once: int, solve: Solve) -> tuple[MotionSolution, int]:
    """The solution, and the number of frames of the longest part that was solved at once."""
    longest, kept = [], motion_module._solve

    def counted(motion: motion_module._Motion, *rest: object, **more: object) -> MotionSolution:
        longest.append(len(motion.kinematics.time))
        return kept(motion, *rest, **more)  # type: ignore[arg-type]

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
    [
        _with_a_lost_posture,
        _with_a_redundant_constraint_in_one_posture,
        _with_limited_actuators,
        _without_an_actuator,
    ],
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
