"""Splines of a motion: derivatives beside those known exactly, the gain of the filter, and what constraints hold."""

import numpy as np
import pytest

from solver.constraint import CoordinateCoupler, CoordinateLock
from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.model import Coordinate, Model
from solver.motion import Motion
from solver.motion_splines import LEAST_FRAMES, differentiate_by_splines, held_by_constraints
from tests.solver.refusals import raises_refusal

TIME = np.arange(201) / 100


def motion(time=TIME, frequency=1.0):
    phase = 2 * np.pi * frequency * time
    return Motion(("knee", "patella", "toes"), time, np.column_stack([np.sin(phase), np.cos(phase), 0.1 + 0 * time]))


@pytest.mark.parametrize("accelerations", ["curvatures", "slopes_of_speeds"])
def test_derivatives_of_a_sine_are_exact_away_from_the_ends(accelerations):
    found = differentiate_by_splines(motion(), None, 0.5, 1.5, accelerations)
    rate, phase = 2 * np.pi, 2 * np.pi * found.time
    np.testing.assert_allclose(found.speeds[:, 0], rate * np.cos(phase), atol=1e-6)
    np.testing.assert_allclose(found.accelerations[:, 0], -(rate**2) * np.sin(phase), atol=1e-4)
    np.testing.assert_allclose(found.positions[:, 2], 0.1, atol=1e-12)
    assert len(found.time) == 101
    assert found.filter == "none"


@pytest.mark.parametrize(("frequency", "gain"), [(1.0, 1.0), (6.0, 0.5), (20.0, 0.0)])
def test_the_filter_halves_its_cutoff_frequency(frequency, gain):
    """Each of the two passes leaves 1/√2 of it."""
    found = differentiate_by_splines(motion(frequency=frequency), 6.0, 0.5, 1.5)
    assert np.ptp(found.positions[:, 0]) / 2 == pytest.approx(gain, abs=0.01)
    assert found.filter == "Butterworth low-pass at 6 Hz, order 3, forwards and backwards"


@pytest.mark.parametrize("accelerations", ["curvatures", "slopes_of_speeds"])
def test_times_that_were_rounded_change_no_acceleration(accelerations):
    """A walk of 1.3 m/s at 120 Hz: 5 µs of rounding over a step of 8 ms would be 0.2 m/s²."""
    exact = 0.125 + np.arange(125) / 120
    phase = 2 * np.pi * exact
    walk = np.column_stack([1.3 * exact + 0.02 * np.sin(phase), np.sin(phase), np.cos(phase)])
    found, expected = (
        differentiate_by_splines(Motion(("x", "y", "z"), time, walk), 6.0, accelerations=accelerations)
        for time in (exact.round(5), exact)
    )
    np.testing.assert_allclose(found.accelerations, expected.accelerations, rtol=1e-4, atol=1e-4)


def test_constraints_hold_what_is_locked_and_what_follows():
    coordinates = tuple(Coordinate(name, "rotation", 0.0, (-1.0, 1.0)) for name in ("knee", "patella", "toes"))
    follows = CoordinateCoupler("follows", 1, (0,), (polynomial([0.2, 0.5, 0.3]),))
    constraints = (follows, CoordinateLock("locked", 2, -0.4))
    body = Model("test", np.zeros(3), (), coordinates, (), (), (), constraints, (), ())
    free = differentiate_by_splines(motion())
    held = held_by_constraints(body, free)
    knee = free.positions[:, 0]
    np.testing.assert_allclose(held.positions[:, 1], 0.2 + 0.5 * knee + 0.3 * knee**2, atol=1e-12)
    np.testing.assert_array_equal(held.positions[:, 2], -0.4)
    np.testing.assert_array_equal(held.speeds[:, 2], 0.0)
    numeric = np.gradient(held.positions[:, 1], 0.01)
    np.testing.assert_allclose(held.speeds[2:-2, 1], numeric[2:-2], atol=0.02)
    numeric = np.gradient(held.speeds[:, 1], 0.01)
    np.testing.assert_allclose(held.accelerations[2:-2, 1], numeric[2:-2], atol=0.3)
    np.testing.assert_array_equal(held_by_constraints(body, free, ("toes",)).positions[:, :2], free.positions[:, :2])


def test_a_motion_that_is_too_short_or_a_cutoff_that_is_too_high_is_refused():
    with raises_refusal(SolverCode.NO_FRAMES):
        differentiate_by_splines(motion(TIME[: LEAST_FRAMES - 1]))
    with raises_refusal(SolverCode.WRONG_CUTOFF):
        differentiate_by_splines(motion(), 50.0)
