"""The published method on sessions whose truth is known: it gives what its equations give, with their errors."""

from __future__ import annotations

from functools import cache

import pytest

from fitting.cuffs.cuff_fit import SessionFit
from fitting.cuffs.published_method import PublishedFit, plain_published, published_fits
from fitting.results.codes import NoteCode
from fitting.session import fit_session
from fitting.trial.trial import build_trial
from tests.fitting.experiment import Session, published


@cache
def _fitted(cuff: str, noise: float) -> tuple[SessionFit, PublishedFit]:
    session = Session(published(cuff, hold=4.0, duration=14.0, migration=0.0, marker_noise=noise), 3)
    trials = [build_trial(*session.static(), "static", "s"), build_trial(*session.dynamic(), "dynamic", "d")]
    fitted = fit_session(trials)
    return fitted, published_fits(fitted)[cuff]


def test_marker_noise_takes_as_much_of_the_damping_as_predicted() -> None:
    for cuff, least, most in (("waist", 0.6, 0.9), ("hand", 0.1, 0.4)):
        _, paper = _fitted(cuff, 0.2e-3)
        assert paper.predicted_attenuation is not None
        assert least < paper.predicted_attenuation < most
        assert paper.observed_attenuation == pytest.approx(paper.predicted_attenuation, abs=0.06)


def test_the_damping_that_noise_takes_from_the_published_method_is_noted() -> None:
    codes = {noise: [note.code for note in _fitted("hand", noise)[0].cuffs["hand"].notes] for noise in (0.2e-3, 1e-6)}
    assert NoteCode.PUBLISHED_DAMPING in codes[0.2e-3]
    assert NoteCode.PUBLISHED_DAMPING not in codes[1e-6]


def test_without_noise_nothing_is_lost() -> None:
    _, paper = _fitted("hand", 1e-6)
    assert paper.predicted_attenuation == pytest.approx(1.0, abs=0.01)
    assert paper.observed_attenuation == pytest.approx(1.0, abs=0.05)


def test_an_intercept_removes_hook_and_zero_which_bend_a_line_through_the_origin() -> None:
    fitted, paper = _fitted("hand", 1e-6)
    stiffness = fitted.cuffs["hand"].stiffness
    assert stiffness
    assert paper.stiffness is not None
    assert paper.stiffness_through_origin is not None
    assert paper.stiffness == pytest.approx(stiffness.value, rel=2e-3)
    # The force reads 2.9 N too high (0.03 V) and x = 0 is under 2 N of hook: F = k x + 4.9 N over 15 to 75 N.
    assert 1.05 < paper.stiffness_through_origin / stiffness.value < 1.15


def test_as_plain_data_it_names_its_units() -> None:
    fitted, paper = _fitted("hand", 1e-6)
    plain = plain_published(published_fits(fitted))["hand"]
    assert plain["stiffness_n_per_m"] == paper.stiffness
    assert plain["stiffness_through_origin_n_per_m"] == paper.stiffness_through_origin
    assert plain["damping_n_s_per_m"] == paper.damping


def test_without_dynamic_trials_there_is_no_damping() -> None:
    session = Session(published("hand", hold=4.0), 3)
    fitted = fit_session([build_trial(*session.static(), "static", "s")])
    paper = published_fits(fitted)["hand"]
    assert paper.stiffness
    assert paper.damping is None
    assert paper.observed_attenuation is None
