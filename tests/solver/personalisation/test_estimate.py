"""A body from markers: simulated persons come back, with standard errors that hold; derivatives are exact."""

from __future__ import annotations

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.multibody.postures import postures
from solver.personalisation.effective_frames import effective_frames
from solver.personalisation.estimate import EstimateOutcome, _Problem, estimate_body
from solver.personalisation.linearise import linearise_postures
from solver.personalisation.priors import population_priors
from tests.solver.personalisation.simulated_person import MARKERS, MODEL, draw_person
from tests.solver.refusals import raises_refusal

PRIORS = population_priors(MODEL, MARKERS)


def test_a_person_whose_skin_hardly_moves_comes_back() -> None:
    """The prior's offsets remain, so a size is known to a few percent and no better; what is reported says so."""
    person = draw_person(3, scatter=0.1)
    body = estimate_body(MODEL, MARKERS, person.trials)
    assert body.outcome is EstimateOutcome.CONVERGED
    away = (np.log(body.factors) - np.log(person.factors)) / (body.factor_errors / body.factors)
    assert np.abs(away).max() < 3.0
    prior = np.sqrt(np.diag(PRIORS.covariance))
    assert (body.factor_errors / body.factors < prior).all()
    residual = np.concatenate([solution.residuals for solution in body.postures])
    assert float(np.sqrt(np.mean(residual**2))) < 0.005
    marker = body.tasks.markers[0]
    np.testing.assert_allclose(marker.location, MARKERS[0].location * body.factors[:3] + body.offsets[0], atol=1e-12)


@pytest.mark.slow
def test_standard_errors_hold_for_twenty_persons() -> None:
    """Squares of errors over standard errors have mean 1 (a chi-square over 20 × 7 and 20 × 36 values, correlated)."""
    sizes, places = [], []
    for seed in range(20):
        person = draw_person(100 + seed)
        body = estimate_body(MODEL, MARKERS, person.trials)
        assert body.outcome is EstimateOutcome.CONVERGED
        sizes.append((np.log(body.factors) - np.log(person.factors)) / (body.factor_errors / body.factors))
        places.append(((body.offsets - person.offsets) / body.offset_errors).ravel())
    assert 0.6 < np.mean(np.square(sizes)) < 1.5
    assert 0.6 < np.mean(np.square(places)) < 1.5


def test_the_reduced_gradient_is_that_of_the_cost_with_postures_solved_again() -> None:
    person = draw_person(5)
    hidden = person.trials[0].copy()
    hidden[3:9, 2] = np.nan  # a marker that is hidden in some frames
    problem = _Problem(MODEL, MARKERS, (hidden, person.trials[1]), PRIORS, np.array([5.0, 3.0]))
    sizes = np.repeat([0.1, 0.01, 0.1], [len(PRIORS.factors), 3 * len(MARKERS), len(PRIORS.girdle)])
    at = 0.3 * sizes * np.random.default_rng(1).standard_normal(problem.parameters)
    state = problem.solve(at)
    _, gradient = problem.normal_equations(state)
    step = 1e-5
    for k in (0, 2, 4, 5, len(PRIORS.factors), len(PRIORS.factors) + 16, len(at) - 2):
        along = step * (np.arange(len(at)) == k)
        above, below = (problem.solve(at + side, state).cost for side in (along, -along))
        assert gradient[k] == pytest.approx((above - below) / (2 * step), rel=1e-4, abs=1e-2)


def test_marker_jacobians_are_the_derivatives_of_the_markers() -> None:
    problem = _Problem(MODEL, MARKERS, (), PRIORS, np.zeros(0))
    tasks = problem.body(np.zeros(problem.parameters))[1]
    at = MODEL.default_coordinates + np.random.default_rng(2).uniform(-0.3, 0.3, (3, len(MODEL.coordinates)))
    found = linearise_postures(MODEL, tasks, at)
    step = 1e-6
    for k in range(at.shape[1]):
        along = step * (np.arange(at.shape[1]) == k)
        above, below = (_points(at + side) for side in (along, -along))
        np.testing.assert_allclose(found.jacobian[..., k], (above - below) / (2 * step), atol=1e-8)


def _points(coordinates: np.ndarray) -> np.ndarray:
    state = postures(MODEL, coordinates, np.zeros_like(coordinates))
    rotation, origin = state.rotation_to_ground, state.origin_in_ground
    return np.stack([origin[:, m.body] + rotation[:, m.body] @ m.location for m in MARKERS], axis=1)


def test_a_pose_is_one_observation_and_a_motion_is_as_many_as_it_decorrelates() -> None:
    chance = np.random.default_rng(3)
    pose = np.tile(chance.uniform(-0.3, 0.3, (1, 4, 3)), (200, 1, 1)) + 1e-4 * chance.standard_normal((200, 4, 3))
    assert effective_frames(pose, 0.01) == pytest.approx(1.0, abs=0.05)
    white = 0.3 * chance.standard_normal((200, 4, 3))
    assert effective_frames(white, 0.01) == pytest.approx(200.0, rel=0.15)
    slow = np.repeat(0.3 * chance.standard_normal((20, 4, 3)), 10, axis=0)  # each posture held for ten frames
    assert effective_frames(slow, 0.01) == pytest.approx(20.0, rel=0.3)


def test_trials_that_do_not_fit_are_refused() -> None:
    with raises_refusal(SolverCode.WRONG_SHAPE):
        estimate_body(MODEL, MARKERS, [np.zeros((5, 2, 3))])
    with raises_refusal(SolverCode.MARKERS_DO_NOT_FIT, naming="trial 1"):
        estimate_body(MODEL, MARKERS, [np.full((5, len(MARKERS), 3), np.nan)])
