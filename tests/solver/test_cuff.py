"""The cuff's one force law."""

import numpy as np
import pytest

from solver.cuff import CuffParameters, cuff_force


def test_a_cuff_at_rest_is_a_spring():
    np.testing.assert_allclose(cuff_force(2140.0, 124.0, np.array([0.0, 0.01, -0.01]), np.zeros(3)), [0, 21.4, -21.4])


def test_a_cycle_costs_the_work_of_the_damper_alone():
    # π c ω X² over one period of a sine; the spring gives everything back
    omega, amplitude, damping = 2 * np.pi, 0.004, 124.0
    time = np.linspace(0, 1, 2001)
    displacement, velocity = amplitude * np.sin(omega * time), amplitude * omega * np.cos(omega * time)
    work = np.trapezoid(cuff_force(2140.0, damping, displacement, velocity) * velocity, time)
    assert work == pytest.approx(np.pi * damping * omega * amplitude**2, rel=1e-6)


def test_parameters_that_were_given_have_no_uncertainty():
    cuff = CuffParameters("hand", "arm", stiffness=8520.0, damping=210.0, migration=0.012)
    assert cuff.covariance.shape == (3, 3)
    assert not cuff.covariance.any()
