"""A cuff that still gives way while it is pulled to and fro."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.dynamic.slip import Slip, find_slip
from fitting.results.codes import TrialNoteCode
from fitting.session import fit_session
from fitting.trial.oscillation import Oscillation
from fitting.trial.trial import build_trial
from tests.fitting.experiment import Session, published

K = 8000.0
SWING = Oscillation(2.0, 14.0, 1.0, 16.0)
time = np.arange(2.0, 14.0, 0.01)


def _find(offset: np.ndarray) -> Slip:
    noise = 2e-4 * np.random.default_rng(2).standard_normal(len(time))
    return find_slip(time, offset + noise, 2e-4, SWING, K, 2.0)


def test_a_cuff_that_holds_loses_no_cycle() -> None:
    slip = _find(np.full(len(time), 0.011))
    assert (slip.settles, slip.cycles) == (True, 0)
    assert slip.damping < 10


def test_slip_of_negligible_apparent_damping_costs_no_cycle() -> None:
    assert _find(np.minimum(time - 2.0, 2.0) * 1.5e-5).cycles == 0


def test_the_cycles_before_it_settles_are_counted() -> None:
    slip = _find(np.minimum((time - 2.0) / 3.0, 1.0) * 1e-3)
    assert slip.settles
    assert 2 <= slip.cycles <= 3
    assert slip.distance == pytest.approx(0.83e-3, abs=0.1e-3)
    assert slip.damping < 20


def test_slip_without_an_end_is_found_by_its_dissipated_work() -> None:
    slip = _find(0.5e-3 * (time - 2.0))
    assert not slip.settles
    assert slip.damping == pytest.approx(16 * 0.5e-3 / (np.pi * 2 * np.pi * (16 / K) ** 2), rel=0.05)


def test_a_hidden_cycle_is_no_slip() -> None:
    seen = (time < 6.0) | (time > 7.0)
    slip = find_slip(time[seen], np.full(np.count_nonzero(seen), 0.01), 2e-4, SWING, K, 2.0)
    assert slip == Slip(settles=True, cycles=0, distance=0.0, damping=pytest.approx(0.0, abs=1e-6))


def test_too_few_cycles_cannot_tell() -> None:
    assert find_slip(time, 1e-3 * time, 2e-4, replace(SWING, end=5.0), K, 2.0) == Slip(
        settles=True, cycles=0, distance=0.0, damping=0.0
    )


def test_damping_of_a_cuff_that_slips_anew_in_the_swing_is_from_the_cycles_after() -> None:
    """The static loads end below the crest of the swing, so that the swing carries the cuff on."""
    truth = published("hand", weights=(15.0, 25.0, 35.0), hold=4.0, amplitude=20.0, slowness=2000.0, duration=18.0)
    session = Session(truth, 5)
    trials = [build_trial(*session.static(), "s.mcap", "s"), build_trial(*session.dynamic(), "d.mcap", "d")]
    fit = fit_session(trials).cuffs["hand"]
    assert fit.damping
    assert abs(fit.damping.value - truth.damping) < 3 * fit.damping.standard_error
    assert fit.trials[1].notes[-1].code is TrialNoteCode.START_LEFT_OUT
