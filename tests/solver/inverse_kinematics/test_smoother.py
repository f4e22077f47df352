"""The smoother on motions that are known: better than filter and differences, honest, and robust to swaps."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.inverse_kinematics.smoother import Array, SmootherOutcome, smooth_motion
from solver.inverse_kinematics.solve import solve_inverse_kinematics
from solver.motion import Motion, differentiate
from tests.refusals import raises_refusal
from tests.solver.inverse_kinematics.marked import (
    INTERVAL,
    MODEL,
    TASKS,
    Draw,
    arm_raise,
    gaps_of,
    minimum_jerk,
    seen_from,
    sines,
    white_jerk,
)

NOISE = 1e-3
CUTOFFS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0)
MOTIONS = ((white_jerk, 0), (white_jerk, 1), (white_jerk, 3), (sines, 3), (minimum_jerk, 3))
"""And the seed of each."""
INNER = slice(10, -10)
"""Frames away from the ends, where the filter that is compared has its own reflections."""


def seen(truth: Array, seed: int) -> Array:
    noise = NOISE * np.random.default_rng(seed).standard_normal((len(truth), len(MODEL.markers), 3))
    return seen_from(MODEL, truth) + noise


@dataclass(frozen=True)
class Comparison:
    """Parts (3,) of q, q̇, q̈ that the 95 % intervals hold, RMS errors of q̈, and the largest gap [m]."""

    held: Array
    rms: float
    rms_filtered: list[float]
    gap: float


@cache
def compared(motion: Draw, seed: int) -> Comparison:
    truth = motion(np.random.default_rng(seed))
    rates = np.gradient(truth, INTERVAL, axis=0)
    wanted = np.stack([truth, rates, np.gradient(rates, INTERVAL, axis=0)])
    observed = seen(truth, seed)
    found = smooth_motion(MODEL, observed, INTERVAL, TASKS, NOISE)
    assert found.outcome is SmootherOutcome.SOLVED
    away = np.stack([found.positions, found.speeds, found.accelerations]) - wanted
    held = (np.abs(away) < 1.96 * found.standard_deviations).mean(axis=(1, 2))
    frames = solve_inverse_kinematics(MODEL, observed, TASKS).coordinates
    raw = Motion(MODEL.coordinate_names, INTERVAL * np.arange(len(frames)), frames)
    filtered = [rms(differentiate(raw, cutoff).accelerations - wanted[2]) for cutoff in CUTOFFS]
    return Comparison(held, rms(away[2]), filtered, float(np.abs(gaps_of(MODEL, found.positions)).max()))


def rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors[INNER] ** 2)))


@pytest.mark.parametrize(
    ("motion", "seed"), [pytest.param(*motion, marks=[pytest.mark.slow] * (motion[1] != 3)) for motion in MOTIONS]
)
def test_accelerations_beat_filter_and_differences_at_any_cutoff(motion: Draw, seed: int) -> None:
    found = compared(motion, seed)
    assert found.rms < min(found.rms_filtered)
    assert found.rms < 0.3 * found.rms_filtered[-1]
    assert found.gap < 1e-5


def test_intervals_hold_the_truth_of_motions_that_are_drawn_from_the_prior_or_not() -> None:
    held = np.mean([compared(*motion).held for motion in MOTIONS], axis=0)
    assert (held > 0.93).all()
    assert (held < 0.97).all()


def test_markers_that_jump_or_are_swapped_for_a_while_do_not_count() -> None:
    interval = 6 * INTERVAL
    observed = seen(arm_raise(np.random.default_rng(0))[::6], 2)
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
    interval = 6 * INTERVAL
    observed = seen(arm_raise(np.random.default_rng(0))[::6], 3)
    observed[40:46] = np.nan
    found = smooth_motion(MODEL, observed, interval, TASKS, NOISE)
    assert np.isfinite(found.positions).all()
    moving = found.prior.intensity > 1e-3
    sd = found.standard_deviations[2][:, moving]
    assert moving.any()
    assert (sd[43] > sd[[36, 50]]).mean() > 0.8


def test_an_iteration_that_runs_out_of_rounds_and_a_trial_without_markers_have_outcomes() -> None:
    observed = seen(minimum_jerk(np.random.default_rng(0))[::10], 4)
    assert (
        smooth_motion(MODEL, observed, INTERVAL, TASKS, NOISE, most_rounds=1).outcome is SmootherOutcome.NOT_CONVERGED
    )
    nothing = smooth_motion(MODEL, np.full_like(observed, np.nan), INTERVAL, TASKS, NOISE)
    assert nothing.outcome is SmootherOutcome.NO_MARKERS
    assert np.isnan(nothing.positions).all()
    with raises_refusal(SolverCode.TOO_FEW_FRAMES):
        smooth_motion(MODEL, observed[:2], INTERVAL, TASKS, NOISE)
