"""Postures frame by frame beside those of the whole trial, and their deviations over moving skin."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.inverse_kinematics.marker_fit import posture_errors
from solver.inverse_kinematics.solve import PostureOutcome, posture_uncertainty, solve_inverse_kinematics
from solver.model import Array, ModelError
from solver.multibody.postures import postures
from solver.personalisation.estimate import estimate_body, within_ranges
from solver.personalisation.wearer_motion import WearerMotion, smooth_wearer
from solver.stream.lag_window import PostureTracker
from tests.refusals import raises_refusal
from tests.solver.personalisation.measured_person import MARKERS, RATE, MeasuredPerson, measure_person
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


@pytest.mark.slow
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
    with raises_refusal(SolverCode.WRONG_NOISE, kind=ModelError):
        solver({}, soft_tissue_m=wrong)


SOLVED = 20


def test_posture_covariance_and_residuals_are_those_of_the_whole_trial() -> None:
    observed = seen()[:SOLVED].copy()
    observed[8:12, NAMES.index("hand_0")] = np.nan
    whole = solve_inverse_kinematics(MODEL, observed, TASKS)
    noise = np.full(len(NAMES), NOISE)
    stated = posture_uncertainty(MODEL, observed, TASKS, whole, noise)
    tracker = PostureTracker(MODEL, TASKS, posture_errors(MODEL, TASKS.markers, 3 * noise, 0 * noise))
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
    tracker = PostureTracker(MODEL, TASKS, posture_errors(MODEL, TASKS.markers, noise, 0 * noise))
    nothing = np.full_like(seen()[0], np.nan)
    assert tracker.solve(0.0, nothing, noise, is_start=True).outcome is PostureOutcome.NO_MARKERS
    found = tracker.solve(0.01, seen()[0], noise, is_start=True)
    assert found.outcome is PostureOutcome.SOLVED
    assert np.linalg.norm(seen()[0] - found.points, axis=1).max() < 6 * NOISE


def test_a_hanging_arm_is_solved_within_the_ranges_of_the_joints() -> None:
    """Its markers fit as well with an elevation of -16 degrees in the opposite plane."""
    seen, wearer = measured(21)
    tracker = PostureTracker(wearer.skeleton, wearer.tasks, wearer.errors)
    elevation = wearer.skeleton.coordinate_index("shoulder_elv")
    for k, positions in enumerate(seen.trials[2]):
        found = tracker.solve(k / RATE, positions, np.full(len(MARKERS), NOISE), is_start=k == 0)
        truth = seen.coordinates[2][k, seen.shoulder.index("shoulder_elv")]
        assert abs(found.coordinates[elevation] - truth) < np.radians(20.0)


@cache
def measured(seed: int) -> tuple[MeasuredPerson, WearerMotion]:
    """A simulated person, and the posterior from the pose and the first raise."""
    generic, person = bundled_model(), measure_person(seed)
    markers = [generic.marker(name) for name in MARKERS]
    body = estimate_body(generic, markers, person.trials[:2])
    model, tasks = within_ranges(body.model, body.tasks)
    solved = [(observed, solve_inverse_kinematics(model, observed, tasks)) for observed in person.trials[:2]]
    return person, smooth_wearer(generic, markers, body, solved, solved[-1][1].coordinates)


def test_errors_grow_with_the_angle_from_the_posture_at_rest() -> None:
    """At 110 degrees of the upper arm alone, both parts count in full."""
    markers = [MODEL.marker(name) for name in ("humerus_0", "humerus_1")]
    targets = np.array([np.full(len(MODEL.coordinates), 0.1), np.full(len(MODEL.coordinates), 0.2)])
    errors = posture_errors(MODEL, markers, np.array([4e-3, 0.0]), np.array([3e-3, 9e-3]), targets)
    default = MODEL.default_coordinates[None]
    resting = postures(MODEL, default, 0.0 * default).rotation_to_ground[0]
    at_rest = errors.at(resting)
    np.testing.assert_allclose(at_rest[0], [4e-3, 0.0], atol=1e-15)
    np.testing.assert_allclose(at_rest[1], 0.1)
    turned = resting.copy()
    humerus = markers[0].body
    turned[humerus] = (
        Rotation.from_rotvec([2.0 * np.arcsin(np.radians(110.0) / 2.0), 0.0, 0.0]).as_matrix() @ turned[humerus]
    )
    raised = errors.at(turned)
    np.testing.assert_allclose(raised[0], [5e-3, 9e-3], rtol=1e-12)
    np.testing.assert_allclose(raised[1], np.hypot(0.1, 0.2), rtol=1e-12)
    np.testing.assert_allclose(errors.for_markers([1]).at(turned)[0], [9e-3], rtol=1e-12)


def test_a_measured_wearer_is_tracked_with_the_girdle_following_the_arm() -> None:
    """Without the slopes the scapula stays behind, and the elevation is too large."""
    person, wearer = measured(21)
    elevation = wearer.skeleton.coordinate_index("shoulder_elv")
    truth = person.coordinates[2][:, person.shoulder.index("shoulder_elv")]
    raised = truth > np.radians(70.0)
    away = {}
    for slopes in (wearer.tasks.coordinate_slopes, {}):
        tasks = replace(wearer.tasks, coordinate_slopes=slopes)
        found = solve_inverse_kinematics(*within_ranges(wearer.skeleton, tasks)[:1], person.trials[2], tasks)
        away[len(slopes)] = float((found.coordinates[raised, elevation] - truth[raised]).mean())
    assert away[3] < away[0] - np.radians(3.0)
