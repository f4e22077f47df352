"""Readings of a known mass: their uncertainty, their tolerance, the drift between them, and what they prove."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.results.codes import FitErrorCode
from fitting.trial.mass_checks import MassCheck, evaluate_reading, with_mass_checks
from fitting.trial.trial import build_trial
from tests.fitting.experiment import Session, published
from tests.fitting.refusals import raises_refusal


def test_readings_that_agree_change_nothing() -> None:
    checks = [MassCheck("", 2.0, 19.613, 19.60, 0.02, 0.1), MassCheck("", 2.0, 19.613, 19.63, 0.02, 0.4)]
    trial = build_trial(*Session(published("hand", weights=(20.0,), hold=2.0), 3).static(), "a.mcap", "hash")
    (checked,) = with_mass_checks([trial], checks)
    assert (checked.gain_sd, checked.is_gain_checked) == (trial.gain_sd, True)


@pytest.mark.parametrize(
    "checks",
    [
        [],
        [MassCheck("", 0.0, 0.0, 0.1, 0.02, None)],
        [MassCheck("", 2.0, 19.613, 19.6, 0.02, None)],
        [MassCheck("", 2.0, 19.613, 19.6, 0.02, 0.1), MassCheck("", 2.0, 19.613, 21.6, 0.02, 0.1)],
    ],
    ids=["no reading", "the empty cell alone", "no zero", "one reading is wrong"],
)
def test_the_gain_is_checked_by_readings_of_a_mass_that_are_all_right(checks: list[MassCheck]) -> None:
    trial = build_trial(*Session(published("hand", weights=(20.0,), hold=2.0), 3).static(), "a.mcap", "hash")
    assert not with_mass_checks([trial], checks)[0].is_gain_checked


def test_a_reading_is_without_the_zero_and_holds_its_uncertainty() -> None:
    noise = np.random.default_rng(1).standard_normal(6000)
    zero = evaluate_reading(3.0 + 0.1 * noise, 0.0, None)
    loaded = evaluate_reading(22.613 + 0.1 * noise[::-1], 2.0, zero)
    assert loaded.expected == pytest.approx(19.6133)
    assert loaded.found == pytest.approx(19.613, abs=4 * loaded.sd)
    assert zero.sd == pytest.approx(0.1 / np.sqrt(6000), rel=0.7)
    assert loaded.sd > zero.sd


def test_a_reading_may_be_off_by_its_uncertainty_the_scale_s_and_a_part_of_the_weight() -> None:
    check = MassCheck("", 2.0, 20.0, 20.0, 0.03, 0.0)
    assert check.tolerance(0.002, 50.0) == pytest.approx(3 * 0.05 + 0.2)
    empty = MassCheck("", 0.0, 0.0, 1.0, 0.0, None)
    assert empty.tolerance(0.002, 50.0) == pytest.approx(0.05 * 50 * 9.80665)


def test_too_few_samples_are_no_reading() -> None:
    with raises_refusal(FitErrorCode.CHECK_SHORT, samples=5, expected=6):
        evaluate_reading(np.zeros(5), 1.0, None)
