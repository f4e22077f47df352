"""Motions drawn from the uncertainty of the markers, against the covariance that the linearised optimum gives."""

from __future__ import annotations

import numpy as np

from solver.bundled import bundled_model
from solver.inverse_kinematics.posture_draws import draw_postures
from solver.inverse_kinematics.solve import solve_inverse_kinematics
from solver.inverse_kinematics.uncertainty import posture_uncertainty
from tests.solver.inverse_kinematics.marked import tasks_of, with_markers
from tests.solver.inverse_kinematics.test_solve import noisy

NOISE = 1e-3
MODEL = with_markers(bundled_model())
TASKS = tasks_of(MODEL)


def test_draws_from_noise_spread_as_the_covariance_of_the_posture() -> None:
    _, observed = noisy(MODEL, 1, 0.01)
    solution = solve_inverse_kinematics(MODEL, observed, TASKS)
    expected = posture_uncertainty(MODEL, observed, TASKS, solution, NOISE).standard_deviation[0]
    drawn = np.array([q[0] for q in draw_postures(MODEL, observed, TASKS, solution, NOISE, 0.0, count=300)])
    np.testing.assert_allclose(drawn.std(axis=0), expected, rtol=0.17)  # 4 standard errors of a spread of 300


def test_an_offset_lasts_the_whole_trial_and_noise_does_not() -> None:
    observed = np.repeat(noisy(MODEL, 1, 0.0)[1], 3, axis=0)
    solution = solve_inverse_kinematics(MODEL, observed, TASKS)
    (shifted,) = draw_postures(MODEL, observed, TASKS, solution, 0.0, NOISE, count=1)
    assert np.ptp(shifted, axis=0).max() < 1e-9
    assert np.abs(shifted - solution.coordinates).max() > 1e-4
    (shaken,) = draw_postures(MODEL, observed, TASKS, solution, NOISE, 0.0, count=1)
    assert np.ptp(shaken, axis=0).max() > 1e-4


def test_a_frame_without_a_solution_keeps_its_posture() -> None:
    observed = np.repeat(noisy(MODEL, 1, 0.0)[1], 2, axis=0)
    observed[1] = np.nan
    solution = solve_inverse_kinematics(MODEL, observed, TASKS)
    (drawn,) = draw_postures(MODEL, observed, TASKS, solution, NOISE, NOISE, count=1)
    np.testing.assert_array_equal(drawn[1], solution.coordinates[1])
