"""Output error on records whose truth is written out, with markers' noise white and coloured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from fitting.dynamic.errors_in_variables import C, estimate
from fitting.dynamic.output_error import output_error
from fitting.results.outcome import FitOutcome
from tests.fitting.swinging import DAMPING, STIFFNESS, swing


def test_without_noise_it_returns_what_was_put_in() -> None:
    fitted = output_error(swing(1, force_noise=0.0, marker_noise=0.0), 5000.0, 100.0).estimates
    assert fitted
    assert fitted[0].value == pytest.approx(STIFFNESS, rel=2e-3)
    assert fitted[1].value == pytest.approx(DAMPING, rel=1e-2)


def test_noise_in_the_force_does_not_bias_the_damping_of_a_light_damper() -> None:
    found = [output_error(swing(seed, c=38.0), STIFFNESS, 38.0).estimates for seed in range(20)]
    assert np.mean([fit[1].value for fit in found if fit]) == pytest.approx(38.0, abs=2.0)


@pytest.mark.parametrize("colour", [0.0, 0.05])
def test_its_standard_error_is_honest_whatever_the_colour_of_the_noise(colour: float) -> None:
    z = []
    for seed in range(60):
        fitted = output_error(swing(seed, colour=colour), STIFFNESS, DAMPING).estimates
        assert fitted
        z.append((fitted[1].value - DAMPING) / fitted[1].standard_error)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 60)
    total = float(np.dot(z, z))
    assert low < total < high
    assert 4 * total > high


def test_coloured_noise_is_what_errors_in_variables_cannot_stand() -> None:
    z = []
    for seed in range(20):
        solution = estimate(swing(seed, colour=0.05, seconds=10.0))
        z.append((solution.parameters[C] - DAMPING) / np.sqrt(solution.covariance[C, C]))
    assert np.dot(z, z) > stats.chi2.ppf(0.9995, 20)


def test_a_force_that_falls_as_the_cuff_goes_has_no_answer() -> None:
    record = swing(1)
    backwards = output_error(replace(record, force=-record.force), STIFFNESS, DAMPING)
    assert (backwards.outcome, backwards.estimates) == (FitOutcome.NO_SOLUTION, None)
