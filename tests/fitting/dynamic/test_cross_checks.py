"""What the cross-checks say of a record, and when they contradict the default."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.dynamic.cross_checks import Checks, check, disagreements, without_lag
from fitting.dynamic.errors_in_variables import Solution, estimate
from fitting.dynamic.swing import Swing
from fitting.results.codes import TrialNoteCode
from tests.fitting.swinging import swing


def _checked(record: Swing) -> tuple[Solution, Checks]:
    solution = estimate(record)
    return solution, check(record, solution, 1.0)


def test_three_other_methods_agree_on_a_spring_and_a_damper() -> None:
    for seed in range(12):
        solution, checks = _checked(swing(seed))
        assert [other.method for other in checks.others] == ["weak form", "output error", "complex stiffness"]
        assert disagreements(without_lag(solution), checks) == ()


def test_a_method_that_is_four_standard_errors_off_is_named_with_both_figures() -> None:
    solution, checks = _checked(swing(1))
    other = checks.others[0]
    k, c = without_lag(solution)
    apart = 4 * np.hypot(c.standard_error, other.damping.standard_error)
    wrong = replace(other, damping=replace(other.damping, value=c.value + apart))
    (note,) = disagreements((k, c), replace(checks, others=(wrong,)))
    assert (note.code, note.figures["method"], note.figures["quantity"]) == (
        TrialNoteCode.DISAGREES,
        "weak form",
        "damping",
    )
    assert note.figures["other"] == c.value + apart


@pytest.mark.parametrize(("colour", "is_coloured"), [(0.0, False), (0.05, True), (0.5, True)])
def test_correlated_marker_noise_is_distinguished_from_white_noise(colour: float, is_coloured: bool) -> None:
    found = [_checked(swing(seed, colour=colour))[1].is_coloured for seed in range(8)]
    assert found == [is_coloured] * 8


def test_a_bent_spring_shows_at_twice_the_swings_frequency() -> None:
    record = swing(2, force_noise=0.05, marker_noise=0.02e-3)
    way = np.interp(record.force_time, record.marker_time, record.displacement)
    _, straight = _checked(record)
    _, bent = _checked(replace(record, force=record.force + 4e5 * way**2))
    assert straight.harmonics[0] < 5 * straight.harmonic_noise
    assert bent.harmonics[0] > 5 * bent.harmonic_noise
    assert bent.harmonics[0] == pytest.approx(4e5 * np.var(way), rel=0.3)
