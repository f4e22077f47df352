from __future__ import annotations

import numpy as np
import pytest

from drivers.simulators.markers import random_wander

T = np.linspace(0.0, 400.0, 80_001)
WANDER = random_wander(np.random.default_rng(5), np.array([2.0, 0.0, 0.3]), 0.05, 0.8)


def test_it_has_the_standard_deviation_asked_for() -> None:
    assert WANDER.value(T).std(axis=0) == pytest.approx([2.0, 0.0, 0.3], rel=0.1, abs=1e-12)


def test_its_rate_is_its_derivative_and_the_derivative_of_its_integral_is_it() -> None:
    value, dt = WANDER.value(T), T[1]
    np.testing.assert_allclose(np.gradient(value, dt, axis=0)[1:-1], WANDER.rate(T)[1:-1], rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(np.gradient(WANDER.integral(T), dt, axis=0)[1:-1], value[1:-1], rtol=1e-6, atol=1e-3)


def test_projected_it_is_the_projection_of_its_values() -> None:
    directions = np.array([[1.0], [2.0], [-3.0]])
    np.testing.assert_allclose(WANDER.along(directions).value(T), WANDER.value(T) @ directions, rtol=1e-6, atol=1e-12)
