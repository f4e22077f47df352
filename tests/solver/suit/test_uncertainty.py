"""Draws of a cuff: they have the fit's covariance, start with the fitted cuff, and are springs."""

import numpy as np
import pytest

from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.suit.uncertainty import DrawnSource, DrawSettings, draw_cuff
from tests.solver.refusals import raises_refusal

COVARIANCE = np.array([[200.0**2, 0.6 * 200 * 15, 0.0], [0.6 * 200 * 15, 15.0**2, 0.0], [0.0, 0.0, 0.001**2]])
HAND = CuffParameters("hand", "arm", 8520.0, 210.0, 0.012, COVARIANCE)


def drawn(cuff, count):
    cuffs = draw_cuff(cuff, count, np.random.default_rng(4))
    return np.array([[each.stiffness, each.damping, each.migration] for each in cuffs])


def test_the_first_is_the_fitted_cuff_and_the_others_are_as_many_as_asked_for():
    found = drawn(HAND, 20)
    assert found.shape == (21, 3)
    np.testing.assert_array_equal(found[0], [8520.0, 210.0, 0.012])
    assert np.unique(found, axis=0).shape == found.shape


def test_draws_have_the_fits_covariance():
    scale = np.sqrt(np.diag(COVARIANCE))
    found = (drawn(HAND, 20_000)[1:] - [8520.0, 210.0, 0.012]) / scale
    np.testing.assert_allclose(found.mean(axis=0), 0, atol=0.03)
    np.testing.assert_allclose(np.cov(found.T), COVARIANCE / np.outer(scale, scale), atol=0.03)


def test_a_draw_that_would_be_no_spring_is_drawn_again():
    soft = CuffParameters("soft", "arm", 100.0, 1.0, 0.0, np.diag([150.0**2, 0.0, 0.0]))
    found = drawn(soft, 500)
    assert len(found) == 501
    assert (found[:, 0] > 0).all()
    assert (found[:, 1:] == [1.0, 0.0]).all()


def test_draws_that_exceed_the_limit_of_tries_are_refused(monkeypatch):
    monkeypatch.setattr("solver.suit.uncertainty.MOST_TRIES", 1)
    with raises_refusal(SolverCode.STIFFNESS_NOT_DRAWN, naming="soft"):
        drawn(CuffParameters("soft", "arm", 100.0, 1.0, 0.0, np.diag([150.0**2, 0.0, 0.0])), 500)


@pytest.mark.parametrize(("frames", "apart"), [(601, 20), (794, 20), (131, 4), (25, 1)])
def test_a_short_motion_keeps_thirty_frames_for_the_draws(frames, apart):
    assert DrawSettings().frames_apart(frames) == apart
    assert DrawSettings(every=10).frames_apart(frames) == 10


def test_a_cuff_that_is_given_does_not_vary():
    given = CuffParameters("given", "arm", 100.0, 1.0, 0.01)
    assert (drawn(given, 5) == [100.0, 1.0, 0.01]).all()


@pytest.mark.parametrize(
    ("count", "motions", "covariance", "sources"),
    [
        (9, 0, COVARIANCE, (DrawnSource.CUFFS,)),
        (9, 3, COVARIANCE, (DrawnSource.CUFFS, DrawnSource.MOTIONS)),
        (9, 3, np.zeros((3, 3)), (DrawnSource.MOTIONS,)),
        (9, 0, np.zeros((3, 3)), ()),
        (0, 3, COVARIANCE, ()),
    ],
)
def test_what_is_drawn_follows_from_motions_and_the_covariance_of_the_cuffs(count, motions, covariance, sources):
    cuff = CuffParameters("hand", "arm", 8520.0, 210.0, 0.012, covariance)
    assert DrawSettings(count, motions=[None] * motions).sources([cuff]) == sources
