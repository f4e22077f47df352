"""Postures frame by frame beside those of the whole trial, and their deviations over moving skin."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.inverse_kinematics.solve import PostureOutcome, posture_uncertainty, solve_inverse_kinematics
from solver.model import ModelError
from solver.personalisation.estimate import estimate_body
from solver.stream.lag_window import PostureTracker
from tests.solver.personalisation.measured_person import MARKERS, RATE, measure_person
from tests.solver.stream.streams import (
    FIRST,
    FRAMES,
    INTERVAL,
    MODEL,
    NAMES,
    NOISE,
    TASKS,
    clean,
    raised,
    seen,
    solver,
    stream,
)

Array = NDArray[np.float64]
SIZE = 2e-3
AT = 30
"""The frame that is judged: those of the lag follow."""


def skin(random: np.random.Generator) -> Array:
    """(frames, markers, 3) of SIZE: sinusoids of 0.1 to 2 Hz, as of the simulated person."""
    shape = (40, 1, len(NAMES), 3)
    phase = random.uniform(0, 2 * np.pi, shape)
    angle = 2 * np.pi * random.uniform(0.1, 2.0, shape) * INTERVAL * np.arange(FRAMES)[:, None, None] + phase
    return np.asarray(SIZE * (random.standard_normal(shape) * np.sin(angle)).sum(axis=0) / np.sqrt(20))


def covered(draws: int, **options: float) -> Array:
    """(3,) share of q, q̇ and q̈ that are within 1.96 standard deviations of the truth."""
    truth = np.array([raised()[FIRST + AT], *np.gradient(raised()[FIRST : FIRST + FRAMES], INTERVAL, axis=0)[[AT]]])
    hits = []
    for draw in range(draws):
        markers = clean() + skin(np.random.default_rng(draw))
        frame = stream(markers[: AT + 16], solver({}, **options))[AT]
        state, deviations = np.array([frame.coordinates, frame.speeds]), frame.standard_deviations[:2]
        hits.append((np.abs(state - truth) < 1.96 * deviations)[:, np.isfinite(deviations[0])])
    return np.asarray(np.mean(hits, axis=(0, 2)))


def test_a_posture_over_moving_skin_is_covered_at_the_stated_size() -> None:
    position, speed = covered(12, soft_tissue_m=SIZE)
    assert 0.9 < position < 0.99
    assert speed > 0.9


def test_by_default_the_published_size_is_assumed() -> None:
    assert covered(2)[0] == 1.0


def test_without_soft_tissue_the_noise_of_the_cameras_remains() -> None:
    frames = stream(seen()[:20], solver({}, soft_tissue_m=0.0))
    others = stream(seen()[:20], solver({}, soft_tissue_m=SIZE))
    assert (frames[3].standard_deviations[0] < others[3].standard_deviations[0]).any()
    np.testing.assert_allclose(frames[3].coordinates, others[3].coordinates, rtol=0, atol=1e-8)


@pytest.mark.parametrize("wrong", [-1e-3, np.nan, np.ones(2)])
def test_a_wrong_size_is_refused(wrong: float) -> None:
    with pytest.raises(ModelError) as refused:
        solver({}, soft_tissue_m=wrong)
    assert refused.value.code is SolverCode.WRONG_NOISE


SOLVED = 20


def test_posture_covariance_and_residuals_are_those_of_the_whole_trial() -> None:
    observed = seen()[:SOLVED].copy()
    observed[8:12, NAMES.index("hand_0")] = np.nan
    whole = solve_inverse_kinematics(MODEL, observed, TASKS)
    noise = np.full(len(NAMES), NOISE)
    stated = posture_uncertainty(MODEL, observed, TASKS, whole, noise)
    tracker = PostureTracker(MODEL, TASKS, 3 * noise)
    for k, positions in enumerate(observed):
        found = tracker.solve(k * INTERVAL, positions, noise, is_start=k == 0)
        assert found.outcome is PostureOutcome.SOLVED
        np.testing.assert_allclose(found.coordinates, whole.coordinates[k], rtol=0, atol=1e-8)
        np.testing.assert_allclose(found.covariance, stated.covariance[k], rtol=1e-4, atol=1e-14)
        np.testing.assert_allclose(found.soft_tissue_covariance, 9 * found.covariance, rtol=1e-9, atol=1e-18)
        np.testing.assert_array_equal(found.is_held, stated.is_held[k])
        away = np.linalg.norm(positions - found.points, axis=1)
        np.testing.assert_allclose(away, whole.residuals[k], rtol=0, atol=1e-8)


def test_frames_without_markers_do_not_prevent_the_search_for_the_first_posture() -> None:
    noise = np.full(len(NAMES), NOISE)
    tracker = PostureTracker(MODEL, TASKS, noise)
    nothing = np.full_like(seen()[0], np.nan)
    assert tracker.solve(0.0, nothing, noise, is_start=True).outcome is PostureOutcome.NO_MARKERS
    found = tracker.solve(0.01, seen()[0], noise, is_start=True)
    assert found.outcome is PostureOutcome.SOLVED
    assert np.linalg.norm(seen()[0] - found.points, axis=1).max() < 6 * NOISE


def test_a_hanging_arm_is_solved_within_the_ranges_of_the_joints() -> None:
    """Its markers fit as well with an elevation of -16 degrees in the opposite plane."""
    seen = measure_person(21)
    body = estimate_body(bundled_model(), [bundled_model().marker(name) for name in MARKERS], seen.trials[:2])
    tracker = PostureTracker(body.model, body.tasks, body.priors.errors.scatter)
    elevation = body.model.coordinate_index("shoulder_elv")
    for k, positions in enumerate(seen.trials[2]):
        found = tracker.solve(k / RATE, positions, np.full(len(MARKERS), NOISE), is_start=k == 0)
        truth = seen.coordinates[2][k, seen.shoulder.index("shoulder_elv")]
        assert abs(found.coordinates[elevation] - truth) < np.radians(30.0)
