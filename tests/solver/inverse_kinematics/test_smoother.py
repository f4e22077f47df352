"""The smoother on motions that are known: better than filter and differences, honest, and robust to swaps."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.inverse_kinematics.smoother import SmootherOutcome, smooth_motion
from solver.inverse_kinematics.solve import TrackingTasks, solve_inverse_kinematics
from solver.model import ModelError
from solver.motion import Motion, differentiate
from solver.raise_arm import simulate_arm_raise
from tests.solver.inverse_kinematics.marked import gaps_of, seen_from, with_markers
from tests.solver.linkage import linkage

Array = NDArray[np.float64]
MODEL = with_markers(bundled_model())
TASKS = TrackingTasks(MODEL.markers, np.ones(len(MODEL.markers)))
NOISE = 1e-3
INNER = slice(10, -10)
"""Frames away from the ends, where the filter that is compared has its own reflections."""


@cache
def raised() -> Motion:
    return simulate_arm_raise(bundled_model())


def seen(seed: int, every: int = 1) -> tuple[Array, float, Array]:
    """Truth (frames, coordinates), interval [s], and markers with noise."""
    motion = raised()
    truth = motion.coordinates[::every]
    away = NOISE * np.random.default_rng(seed).standard_normal((len(truth), len(MODEL.markers), 3))
    return truth, float(motion.time[every] - motion.time[0]), seen_from(MODEL, truth) + away


def test_accelerations_beat_filter_and_differences() -> None:
    truth, interval, observed = seen(1, every=2)
    frames = solve_inverse_kinematics(MODEL, observed, TASKS)
    found = smooth_motion(MODEL, observed, interval, TASKS, NOISE, frames)
    assert found.outcome is SmootherOutcome.SOLVED
    wanted = np.gradient(np.gradient(truth, interval, axis=0), interval, axis=0)[INNER]
    filtered = differentiate(Motion(MODEL.coordinate_names, raised().time[::2], frames.coordinates))
    off = [float(np.sqrt(np.mean((each.accelerations[INNER] - wanted) ** 2))) for each in (found, filtered)]
    assert off[0] < 0.2 * off[1]
    assert np.abs(gaps_of(MODEL, found.positions)).max() < 1e-4


def test_intervals_hold_a_truth_of_white_jerk() -> None:
    """Jerk is drawn and integrated here, frame by frame; a body without constraints may follow it."""
    model, interval, inside = with_markers(linkage(), each=6), 0.01, []
    tasks = TrackingTasks(model.markers, np.ones(len(model.markers)))
    for seed in range(6):
        chance = np.random.default_rng(seed)
        state, truth = np.zeros((3, len(model.coordinates))), []
        for _ in range(200):
            jerk = 4.0 * chance.standard_normal(state.shape[1])
            truth.append(state.copy())
            q, v, a = state
            h = interval
            state = np.array([q + h * v + h**2 / 2 * a + h**3 / 6 * jerk, v + h * a + h**2 / 2 * jerk, a + h * jerk])
        moved = np.swapaxes(truth, 0, 1)
        observed = seen_from(model, moved[0]) + NOISE * chance.standard_normal((200, len(model.markers), 3))
        found = smooth_motion(model, observed, interval, tasks, NOISE)
        assert found.outcome is SmootherOutcome.SOLVED
        away = np.stack([found.positions, found.speeds, found.accelerations]) - moved
        inside.append(np.abs(away) < 1.96 * found.standard_deviations)
    held = np.mean(inside, axis=(0, 2, 3))
    assert 0.91 < held.min() <= held.max() < 0.97
    assert 0.93 < held.mean() < 0.97


def test_markers_that_jump_or_are_swapped_for_a_while_do_not_count() -> None:
    _, interval, observed = seen(2, every=6)
    clean = smooth_motion(MODEL, observed, interval, TASKS, NOISE)
    disturbed = observed.copy()
    disturbed[30:34, 4] += [0.05, 0.0, 0.03]
    disturbed[50:54, [9, 14]] = observed[50:54, [14, 9]]
    found = smooth_motion(MODEL, disturbed, interval, TASKS, NOISE)
    assert not found.counts[30:34, 4].any()
    assert not found.counts[50:54, [9, 14]].any()
    assert found.counts.mean() > 0.99
    away = np.abs(found.positions - clean.positions) / clean.standard_deviations[0]
    assert away.max() < 4.0


def test_a_gap_is_bridged_with_wider_intervals() -> None:
    _, interval, observed = seen(3, every=6)
    observed[40:46] = np.nan
    found = smooth_motion(MODEL, observed, interval, TASKS, NOISE)
    assert np.isfinite(found.positions).all()
    moving = found.jerk_intensity > 1e-3
    sd = found.standard_deviations[2][:, moving]
    assert moving.any()
    assert (sd[43] > sd[[36, 50]]).mean() > 0.8


def test_an_iteration_that_runs_out_of_rounds_says_so_and_no_markers_are_no_motion() -> None:
    _, interval, observed = seen(4, every=20)
    assert (
        smooth_motion(MODEL, observed, interval, TASKS, NOISE, most_rounds=1).outcome is SmootherOutcome.NOT_CONVERGED
    )
    nothing = smooth_motion(MODEL, np.full_like(observed, np.nan), interval, TASKS, NOISE)
    assert nothing.outcome is SmootherOutcome.NO_MARKERS
    assert np.isnan(nothing.positions).all()
    with pytest.raises(ModelError, match="at least three frames"):
        smooth_motion(MODEL, observed[:2], interval, TASKS, NOISE)
