"""Postures frame by frame, beside inverse kinematics of the whole trial."""

from __future__ import annotations

import numpy as np

from solver.bundled import bundled_model
from solver.inverse_kinematics.posture_uncertainty import posture_uncertainty
from solver.inverse_kinematics.solve import PostureOutcome, solve_inverse_kinematics
from solver.personalisation.estimate import estimate_body
from solver.stream.frame_posture import PostureTracker
from tests.solver.personalisation.measured_person import MARKERS, RATE, measure_person
from tests.solver.stream.streams import INTERVAL, MODEL, NAMES, NOISE, TASKS, seen

FRAMES = 20


def test_posture_covariance_and_residuals_are_those_of_the_whole_trial() -> None:
    observed = seen()[:FRAMES].copy()
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
