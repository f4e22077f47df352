"""A known stiffness tells the lag by what the swing's complex stiffness is long, and nothing more than that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.dynamic.errors_in_variables import C, LagPosterior, Solution, estimate, lag_from_magnitude
from fitting.uncertainty import normal_estimate
from tests.fitting.swinging import MASS, swing

SPREAD = 0.025 / np.sqrt(3)
"""Seconds: a lag anywhere within half a sample at 20 Hz."""


def _posterior(seed: int, k: float, c: float, lag: float) -> tuple[LagPosterior, float]:
    """What is found, and c at the lag that was found; the stiffness is known to 0.5 %, and drawn so."""
    record = swing(seed, k=k, c=c, rate=100.0, seconds=15.0, lag_error=lag)
    known = normal_estimate(k * (1 + 0.005 * float(np.random.default_rng(seed).standard_normal())), 0.005 * k)
    posterior = lag_from_magnitude(estimate(record), MASS, 1.0, known, SPREAD)
    at_lag: Solution = estimate(replace(record, force_time=record.force_time + posterior.lag))
    return posterior, float(at_lag.parameters[C])


@pytest.mark.parametrize("lag", [-0.025, 0.0, 0.025])
def test_a_damping_that_makes_much_of_the_magnitude_is_found_under_any_lag(lag: float) -> None:
    posterior, damping = _posterior(1, 2530.0, 139.0, lag)
    assert abs(damping - 139.0) < 3 * posterior.damping_sd < 0.2 * 139.0
    assert abs(posterior.lag - lag) < 3 * posterior.lag_sd


@pytest.mark.parametrize("lag", [-0.02, 0.02])
def test_one_that_makes_little_of_it_is_not_said_to_be_known(lag: float) -> None:
    """At c = 38 the magnitude is that of the spring alone within 0.1 %: whatever comes out, its error must hold it."""
    found = [_posterior(seed, 5530.0, 38.0, lag) for seed in range(12)]
    assert all(abs(damping - 38.0) < 3 * posterior.damping_sd for posterior, damping in found)
    assert min(posterior.damping_sd / damping for posterior, damping in found) > 0.15


def test_errors_are_those_of_the_draw() -> None:
    random = np.random.default_rng(9)
    z = []
    for seed in range(40):
        posterior, damping = _posterior(seed, 2530.0, 139.0, SPREAD * random.standard_normal())
        z.append((damping - 139.0) / posterior.damping_sd)
    assert 0.6 < float(np.std(z)) < 1.4


def test_a_lag_that_would_leave_a_negative_damping_does_not_count() -> None:
    posterior, damping = _posterior(2, 5530.0, 38.0, -0.025)
    assert damping > 0
    assert posterior.lag < 0
