"""Muscles frame by frame, beside all frames at once and beside Clarabel."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.motion import decimate, differentiate
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.problem import FrameOutcome, LoadResponse, RedundancyProblem, build_redundancy
from solver.redundancy.sequence import FrameByFrame, ScenarioSolutions, solve_redundancy

MODEL = bundled_model()
EVERY = 10
MUSCLES = len(MODEL.muscles)
KINDS = ("activation", "deactivation")
NARROW = np.repeat([[0.02], [0.3]], MUSCLES, axis=1)


@cache
def problem() -> RedundancyProblem:
    kinematics = decimate(differentiate(simulate_arm_raise(MODEL)), EVERY)
    return build_redundancy(MODEL, evaluate_motion(MODEL, kinematics), RedundancyOptions())


@cache
def loads() -> LoadResponse:
    """Two scenarios: none, and accelerations and forces that swing."""
    shape = problem().target.shape[1:]
    swing = np.sin(problem().time)[:, None] * np.random.default_rng(4).uniform(-1, 1, shape[1])
    force = np.concatenate([np.zeros((shape[0], 3)), np.full((shape[0], 3), 5.0)], axis=1)
    return LoadResponse(np.stack([np.zeros(shape), swing]), np.stack([0 * force, force]))


def frame_of(whole: RedundancyProblem, frame: int) -> RedundancyProblem:
    return whole.cut(slice(frame, frame + 1))


def loads_of(frame: int) -> LoadResponse:
    return LoadResponse(loads().acceleration[:, [frame]], loads().reaction[:, [frame]])


def frame_by_frame(whole: RedundancyProblem, frames: range) -> list[ScenarioSolutions]:
    running = FrameByFrame(2, MUSCLES)
    return [running.solve(frame_of(whole, k), loads_of(k)) for k in frames]


@pytest.mark.parametrize(
    "change",
    [{}, {"has_activation_dynamics": False}, {"activation_limits": NARROW}],
    ids=["published", "without dynamics", "limits of the muscles"],
)
def test_frames_one_by_one_are_the_frames_of_the_whole_motion(change: dict[str, Any]) -> None:
    changed = replace(problem(), time_constants=10 * problem().time_constants, **change) if change else problem()
    whole, frames = solve_redundancy(changed, loads()), range(len(problem().time))
    one_by_one = frame_by_frame(changed, frames)
    for k in frames:
        np.testing.assert_array_equal(one_by_one[k].outcomes[:, 0], whole.outcomes[:, k])
        np.testing.assert_allclose(one_by_one[k].controls[:, 0], whole.controls[:, k], rtol=0, atol=1e-7)
        np.testing.assert_allclose(one_by_one[k].reaction[:, 0], whole.reaction[:, k], rtol=0, atol=1e-4)


@pytest.mark.parametrize("limit", [np.inf, 1e3])
def test_clarabel_gives_the_same_frames_and_serves_controls_with_limits(limit: float) -> None:
    limits = np.full((2, len(MODEL.actuators)), limit) * [[-1], [1]]
    frames = range(10, 16)
    ours = frame_by_frame(problem(), frames)
    by_clarabel = frame_by_frame(replace(problem(), solver="clarabel"), frames)
    limited = frame_by_frame(replace(problem(), control_limits=limits), frames)
    for other in (by_clarabel, limited):
        for one, two in zip(ours, other, strict=True):
            np.testing.assert_allclose(one.controls, two.controls, rtol=0, atol=2e-5)


def test_after_a_gap_activations_may_change_by_as_much_as_the_time_allows() -> None:
    fast = replace(problem(), time_constants=10 * problem().time_constants)  # so slow that the bounds are active
    after, before = 30, 20
    whole = solve_redundancy(problem())
    a = whole.controls[0, before, :MUSCLES]
    seconds = float(fast.time[after] - fast.time[before])
    activation, deactivation = fast.time_constants
    pace = 0.5 + 1.5 * a
    lowest = np.fmax(a - seconds / deactivation * a * pace, 0)
    highest = np.fmin(a + seconds / activation * (1 - a) / pace, 1)
    running = FrameByFrame(1, MUSCLES)
    running.solve(frame_of(fast, before))
    (found,) = running.solve(frame_of(fast, after)).controls[:, 0, :MUSCLES]
    assert (found >= lowest - 1e-9).all()
    assert (found <= highest + 1e-9).all()
    assert ((np.abs(found - lowest) < 1e-9) | (np.abs(found - highest) < 1e-9)).any()
    forgotten = FrameByFrame(1, MUSCLES)
    forgotten.solve(frame_of(fast, before))
    forgotten.forget(0)
    free = forgotten.solve(frame_of(fast, after))
    alone = FrameByFrame(1, MUSCLES).solve(frame_of(fast, after))
    np.testing.assert_allclose(free.controls, alone.controls, rtol=0, atol=1e-9)


@pytest.mark.parametrize("without", ["activation and deactivation", "activation", "deactivation"])
def test_a_time_constant_of_zero_is_no_limit_of_these_muscles_alone(without: str) -> None:
    """The bounds are those of a second derivation: a time so short that every activation is reached in one step."""
    rows = [index for index, kind in enumerate(KINDS) if kind in without.split()]
    slow = np.array([[1000.0], [30.0]]) * problem().time_constants  # so slow that the bounds are active
    instant, shortest = slow.copy(), slow.copy()
    instant[rows, ::2], shortest[rows, ::2] = 0.0, 1e-9
    zero, tiny = (replace(problem(), time_constants=constants) for constants in (instant, shortest))
    expected = solve_redundancy(tiny)
    assert np.abs(expected.controls - solve_redundancy(replace(tiny, time_constants=slow)).controls).max() > 1e-3
    by_clarabel = solve_redundancy(replace(zero, solver="clarabel"))
    np.testing.assert_allclose(solve_redundancy(zero).controls, expected.controls, rtol=0, atol=1e-9)
    np.testing.assert_allclose(by_clarabel.controls, expected.controls, rtol=0, atol=2e-4)
    one_by_one = FrameByFrame(1, MUSCLES)
    for frame in range(6):
        found = one_by_one.solve(frame_of(zero, frame)).controls[:, 0]
        np.testing.assert_allclose(found, expected.controls[:, frame], rtol=0, atol=1e-7)


def test_a_frame_that_is_not_finite_is_an_outcome_and_the_next_one_is_solved() -> None:
    running = FrameByFrame(2, MUSCLES)
    running.solve(frame_of(problem(), 10), loads_of(10))
    broken = frame_of(problem(), 11)
    broken = replace(broken, target=np.full_like(broken.target, np.nan))
    assert (running.solve(broken, loads_of(11)).outcomes == FrameOutcome.NOT_FINITE).all()
    assert (running.solve(frame_of(problem(), 12), loads_of(12)).outcomes == FrameOutcome.SOLVED).all()
