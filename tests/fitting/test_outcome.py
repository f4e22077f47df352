"""Every iteration of the fit, starved of rounds, says so, and the verdict of the donning calls nothing identified."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit
from fitting.dynamic.cross_checks import output_error
from fitting.dynamic.errors_in_variables import estimate
from fitting.errors import NotConverged
from fitting.pull.pull import Pull, make_pulls
from fitting.results.codes import FitOutcome, Verdict, worst
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.session import fit_session
from fitting.spatial.tensors import NoTensor, held_tensor, swung_tensor
from fitting.trial.bounce import BounceTrial, calibrate, fit_bounce
from fitting.trial.trial import Trial, build_bounce, build_trial
from tests.fitting.bouncing import Bounce
from tests.fitting.bouncing import recorded as bounced
from tests.fitting.experiment import Session, published
from tests.fitting.pulled_in_space import directions, elbow, pulled
from tests.fitting.pulls import DAMPING, STIFFNESS, swing

EIV, OUTPUT_ERROR = "fitting.dynamic.errors_in_variables", "fitting.dynamic.cross_checks"


@cache
def _trials() -> tuple[Trial, ...]:
    session = Session(published("hand", hold=6.0, duration=16.0), 1)
    return build_trial(*session.static(1), "s", "s"), build_trial(*session.dynamic(1), "d", "d")


def _fit() -> CuffFit:
    return fit_session(_trials()).cuffs["hand"]


@cache
def _bounce() -> BounceTrial:
    return build_bounce(*bounced(Bounce(), 1), "test-bounce_run-1.mcap", "hash")


@cache
def _in_space(test: str) -> tuple[Pull, ...]:
    random = np.random.default_rng(1)
    space = elbow(random)
    trials = [pulled(space, u, test, number, random) for number, u in enumerate(directions(30), 1)]
    return tuple(make_pulls(trials)[0])


def test_with_their_rounds_all_fits_converge() -> None:
    fit = _fit()
    assert fit.verdicts == (Verdict.IDENTIFIED,)
    assert [trial.swing.outcome for trial in fit.trials if trial.swing] == [FitOutcome.CONVERGED]
    assert held_tensor(_in_space("static"), 0.0).value.shape == (3, 3)
    assert swung_tensor(_in_space("dynamic"), {}, 0.0).value.shape == (3, 3)
    assert calibrate([_bounce()])[1] == {}


@pytest.mark.parametrize("limit", ["MAX_ROUNDS", "MAX_NOISE_ROUNDS"])
def test_a_damping_whose_fit_did_not_converge_is_reported_as_not_identified(
    limit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"{EIV}.{limit}", 1)
    assert estimate(swing(1)).outcome is FitOutcome.NOT_CONVERGED
    fit = _fit()
    assert fit.verdicts == (Verdict.DAMPING_NOT_CONVERGED,)
    assert fit.damping is not None
    assert fit.missing == ("damping",)
    assert TrialNoteCode.NOT_CONVERGED in [note.code for trial in fit.trials for note in trial.notes]


def test_output_error_that_did_not_converge_checks_nothing_unless_noise_is_coloured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(f"{OUTPUT_ERROR}.ROUNDS", 1)
    starved = output_error(swing(1), 0.8 * STIFFNESS, DAMPING)
    assert (starved.outcome, starved.estimates) == (FitOutcome.NOT_CONVERGED, None)
    fit = _fit()
    assert fit.verdicts == (Verdict.IDENTIFIED,), "the default does not rest on it where the noise is white"
    (found,) = [trial.swing for trial in fit.trials if trial.swing]
    assert found.checks.not_converged == ("output error",)
    monkeypatch.setattr(f"{OUTPUT_ERROR}.ROUNDS", 1)
    monkeypatch.setattr("fitting.dynamic.cross_checks.COLOURED", -1.0)
    assert _fit().verdicts == (Verdict.DAMPING_NOT_CONVERGED,)


@pytest.mark.parametrize("limit", ["stiffness.MAX_ROUNDS", "stiffness.MAX_STEPS", "held_loads.MAX_ROUNDS"])
def test_a_stiffness_whose_fit_did_not_converge_is_not_identified(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"fitting.static.{limit}", 1)
    fit = _fit()
    assert Verdict.STIFFNESS_NOT_CONVERGED in fit.verdicts
    assert fit.stiffness is None


@pytest.mark.parametrize(
    ("limit", "fit"),
    [
        ("MOST_HELD_ROUNDS", lambda: held_tensor(_in_space("static"), 0.0)),
        ("SWUNG_ROUNDS", lambda: swung_tensor(_in_space("dynamic"), {}, 0.0)),
    ],
)
def test_a_tensor_whose_fit_did_not_converge_is_not_identified(
    limit: str, fit: Callable[[], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"fitting.spatial.tensors.{limit}", 1)
    with pytest.raises(NoTensor) as caught:
        fit()
    assert caught.value.outcome is FitOutcome.NOT_CONVERGED


def test_a_bounce_whose_fit_did_not_converge_calibrates_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitting.trial.bounce.MAX_ROUNDS", 1)
    with pytest.raises(NotConverged) as caught:
        fit_bounce(_bounce())
    assert caught.value.outcome is FitOutcome.NOT_CONVERGED
    reason = calibrate([_bounce()])[1]["test-bounce_run-1.mcap"]
    assert reason.code is RejectionCode.BOUNCE_NOT_CONVERGED


def test_a_spread_between_repeats_that_did_not_converge_leaves_nothing_identified(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = Session(published("hand", hold=4.0, duration=12.0), 2)
    trials = []
    for repeat in (1, 2):
        trials.append(build_trial(*session.static(repeat), f"s{repeat}", "s"))
        trials.append(build_trial(*session.dynamic(repeat), f"d{repeat}", "d"))
    apart = [*trials[:2], *(replace(trial, force=1.1 * trial.force) for trial in trials[2:])]
    monkeypatch.setattr("fitting.uncertainty.ROUNDS", 5)
    fit = fit_session(apart).cuffs["hand"]
    assert {Verdict.STIFFNESS_NOT_CONVERGED, Verdict.DAMPING_NOT_CONVERGED} <= set(fit.verdicts)
    bounces = [_bounce(), replace(_bounce(), repeat=2, file="b", force=1.1 * _bounce().force)]
    calibration, _ = calibrate(bounces)
    assert calibration and TrialNoteCode.BOUNCES_NOT_CONVERGED in [note.code for note in calibration.notes]


def test_the_worst_part_is_the_outcome_of_the_whole() -> None:
    converged, not_converged, none = FitOutcome.CONVERGED, FitOutcome.NOT_CONVERGED, FitOutcome.NO_SOLUTION
    assert worst([]) is converged
    assert worst([converged, not_converged]) is not_converged
    assert worst([not_converged, none, converged]) is none
