"""The published method on sessions whose truth is known; the repeat that disagrees; a cuff as OpenSim's force."""

from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit, SessionFit, TrialFit, find_outliers, has_slipped
from fitting.cuffs.published_method import PublishedFit, published_fits, published_json
from fitting.cuffs.wearable_cuff import bushing_force
from fitting.results.codes import FitErrorCode, NoteCode, Verdict
from fitting.session import fit_session
from fitting.trial.trial import build_trial
from fitting.uncertainty import normal_estimate
from tests.fitting.experiment import Session, published
from tests.refusals import raises_refusal

FIT = CuffFit(
    name="hand",
    site="arm",
    donning="1",
    stiffness=normal_estimate(8520.5, 10.0),
    damping=normal_estimate(210.25, 6.0),
    migration=normal_estimate(0.012, 1e-5),
    verdicts=(Verdict.IDENTIFIED,),
    covariance=np.zeros((3, 3)),
)


@cache
def _fitted(cuff: str, noise: float) -> tuple[SessionFit, PublishedFit]:
    session = Session(published(cuff, hold=4.0, duration=14.0, migration=0.0, marker_noise=noise), 3)
    trials = [build_trial(*session.static(), "static", "s"), build_trial(*session.dynamic(), "dynamic", "d")]
    fitted = fit_session(trials)
    return fitted, published_fits(fitted)[cuff]


def test_marker_noise_takes_as_much_of_the_damping_as_predicted_and_no_noise_nothing() -> None:
    for cuff, least, most in (("waist", 0.6, 0.9), ("hand", 0.1, 0.4)):
        _, paper = _fitted(cuff, 0.2e-3)
        assert paper.predicted_attenuation is not None
        assert least < paper.predicted_attenuation < most
        assert paper.observed_attenuation == pytest.approx(paper.predicted_attenuation, abs=0.06)
    _, paper = _fitted("hand", 1e-6)
    assert paper.predicted_attenuation == pytest.approx(1.0, abs=0.01)
    assert paper.observed_attenuation == pytest.approx(1.0, abs=0.05)


def test_the_damping_that_noise_takes_from_the_published_method_is_noted() -> None:
    codes = {noise: [note.code for note in _fitted("hand", noise)[0].cuffs["hand"].notes] for noise in (0.2e-3, 1e-6)}
    assert NoteCode.PUBLISHED_DAMPING in codes[0.2e-3]
    assert NoteCode.PUBLISHED_DAMPING not in codes[1e-6]


def test_an_intercept_removes_hook_and_zero_which_bend_a_line_through_the_origin() -> None:
    fitted, paper = _fitted("hand", 1e-6)
    stiffness = fitted.cuffs["hand"].stiffness
    assert paper.stiffness is not None
    assert paper.stiffness_through_origin is not None
    assert paper.stiffness == pytest.approx(stiffness.value, rel=2e-3)
    # The force reads 2.9 N too high (0.03 V) and x = 0 is under 2 N of hook: F = k x + 4.9 N over 15 to 75 N.
    assert 1.05 < paper.stiffness_through_origin / stiffness.value < 1.15
    fitted, paper = _fitted("hand", 1e-6)
    plain = published_json(published_fits(fitted))["hand"]
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


def _trial(stiffness: float, sd: float = 10.0, migration: float = 0.0) -> TrialFit:
    return TrialFit(
        "a.mcap",
        "hash",
        "static",
        1,
        1,
        "used",
        stiffness=normal_estimate(stiffness, sd),
        migration=normal_estimate(migration, 1e-4),
    )


def test_a_repeat_is_outlying_beyond_three_combined_standard_errors_and_the_spread_of_the_others() -> None:
    others = [_trial(1000.0), _trial(1000.0)]
    assert find_outliers(_trial(1000.0 + 2.9 * 10 * 2**0.5), others) == ()
    (outlier,) = find_outliers(_trial(1000.0 + 3.1 * 10 * 2**0.5), others)
    assert (outlier.quantity, outlier.mean) == ("stiffness", 1000.0)
    assert round(outlier.distance, 6) == 3.1
    assert find_outliers(_trial(1200.0), [_trial(900.0), _trial(1100.0)]) == ()
    assert find_outliers(_trial(1.0), []) == ()


def test_a_cuff_that_migrates_further_than_any_published_one_has_slipped() -> None:
    assert not has_slipped(_trial(1000.0, migration=0.022))
    assert has_slipped(_trial(1000.0, migration=0.026))


def test_a_bushing_has_the_cuff_s_figures_and_a_cuff_without_damping_none() -> None:
    element = ElementTree.fromstring(bushing_force(FIT.wearable()))  # noqa: S314
    assert element.tag == "BushingForce"
    assert element.get("name") == "hand_cuff"
    texts = {child.tag: child.text for child in element if isinstance(child.tag, str)}
    assert texts["translational_stiffness"] == "8520.5 8520.5 8520.5"
    assert texts["translational_damping"] == "210.25 210.25 210.25"
    assert texts["rotational_stiffness"] == "0 0 0"
    with raises_refusal(FitErrorCode.NOT_IDENTIFIED, cuff="hand", missing="damping"):
        bushing_force(replace(FIT, damping=None).wearable())


@pytest.mark.oracle
def test_opensim_knows_every_element_of_it() -> None:
    simulation = pytest.importorskip("opensim.simulation", reason="OpenSim is not installed")
    force = simulation.BushingForce()
    element = ElementTree.fromstring(bushing_force(FIT.wearable()))  # noqa: S314
    known = {force.getPropertyByIndex(i).getName() for i in range(force.getNumProperties())}
    assert {child.tag for child in element if isinstance(child.tag, str) and "socket" not in child.tag} <= known
