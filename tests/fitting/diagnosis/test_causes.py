"""The diagnosis on rigs and cuffs with a known defect: the cause is among the first two, and none where none is."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit
from fitting.diagnosis.causes import Diagnosis, Finding, find_causes
from fitting.laws.model_class import KELVIN_VOIGT, ClassScore, ModelComparison
from fitting.results.codes import CauseCode, FindingCode, NoteCode, Verdict
from fitting.results.trial_codes import TrialNoteCode
from fitting.session import fit_session
from fitting.trial.trial import Trial, build_trial
from tests.fitting.defects import Law, OddSession, Rig
from tests.fitting.experiment import Session, Truth, published

DEFECTS = {
    CauseCode.TARE: (Law(), Rig(dynamic_zero=-23.0)),
    CauseCode.ZERO_DRIFT: (Law(), Rig(dynamic_zero=-5.0)),
    CauseCode.DISPLACEMENT_ZERO: (Law(), Rig(dynamic_shift=0.012)),
    CauseCode.STIFFENING: (Law(stiffness=4520.0, bend=99.7), Rig()),
    CauseCode.SOFTENING: (Law(stiffness=9640.0, bend=-26.0), Rig()),
    CauseCode.FRICTION: (Law(friction=4.0), Rig()),
    CauseCode.STANDARD_LINEAR_SOLID: (Law(fast=(0.3, 0.3)), Rig()),
    CauseCode.CREEP: (Law(slow=(0.2, 15.0)), Rig()),
    CauseCode.SLIP: (Law(slip_from=20.0, hardening=2e3), Rig()),
    CauseCode.PULL_DIRECTION: (Law(), Rig(dynamic_angle=np.radians(40))),
    CauseCode.SKIN: (Law(), Rig(skin=0.05e-3)),
}
LAWS = {
    CauseCode.STIFFENING: "stiffening",
    CauseCode.SOFTENING: "softening",
    CauseCode.FRICTION: "friction",
    CauseCode.STANDARD_LINEAR_SOLID: "standard linear solid",
    CauseCode.CREEP: "creep",
    CauseCode.SLIP: "slip",
}
WEIGHED = Truth(friction=1e9, migration=0.0, duration=12.0, hold=5.0)


def _fitted(session: Session) -> CuffFit:
    (fit,) = fit_session(_trials(session)).cuffs.values()
    return fit


def _trials(session: Session) -> list[Trial]:
    return [build_trial(*session.static(), "s", "s"), build_trial(*session.dynamic(), "d", "d")]


@cache
def _diagnosed(cause: CauseCode | None, seed: int = 1) -> tuple[CuffFit, Diagnosis]:
    law, rig = DEFECTS[cause] if cause else (Law(), Rig())
    truth = Truth(friction=1e9, migration=0.0, duration=14.0, hold=5.0)
    fit = _fitted(OddSession(law, rig, seed, truth))
    assert fit.diagnosis
    return fit, fit.diagnosis


def _finding(diagnosis: Diagnosis, code: FindingCode) -> Finding:
    return next(finding for finding in diagnosis.findings if finding.code is code)


@pytest.mark.parametrize("code", DEFECTS)
def test_no_cause_is_named_beside_one_that_explains_more(code: CauseCode) -> None:
    fit, diagnosis = _diagnosed(code)
    assert [cause.code for cause in diagnosis.causes] == [code]
    assert not _finding(diagnosis, FindingCode.MARKER_CORRELATION).is_alarm
    assert TrialNoteCode.COLOURED not in [note.code for trial in fit.trials for note in trial.notes]
    if code is CauseCode.PULL_DIRECTION:
        return
    assert fit.classes.chosen == ((LAWS[code],) if code in LAWS else ())
    assert code not in LAWS or fit.classes.ranking[0].gain > 0.5, "of one repeat, which is judged by its stretches"


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 2, 3))])
def test_where_nothing_is_wrong_no_cause_is_named(seed: int) -> None:
    fit, diagnosis = _diagnosed(None, seed)
    assert diagnosis.causes == () and fit.classes.name == KELVIN_VOIGT
    correlation = _finding(diagnosis, FindingCode.MARKER_CORRELATION)
    assert not correlation.is_alarm and correlation.value < 0.1


@pytest.mark.parametrize("hold", [0.6, 1.5, 3.0])
def test_short_holds_are_reported_as_such_and_not_as_another_cause(hold: float) -> None:
    truth = Truth(friction=1e9, migration=0.0, duration=12.0, hold=hold, hold_jitter=hold / 6, has_rope_markers=True)
    fit = _fitted(OddSession(Law(), Rig(), 4, truth))
    assert fit.diagnosis.causes == ()
    if hold == 0.6:  # the loads are not held
        assert Verdict.FEW_LOADS in fit.verdicts
        return
    assert NoteCode.SHORT_HOLDS in [note.code for note in fit.notes]
    assert "stiffness" not in fit.missing
    low, high = fit.stiffness.ci95
    assert low < Law().stiffness < high
    assert high - low < 0.04 * Law().stiffness


@pytest.mark.parametrize("friction", [4.0, 10.0])
def test_friction_and_one_unloading_branch_give_the_stiffness_of_loading_and_no_damping(friction: float) -> None:
    truth = Truth(friction=1e9, migration=0.0, duration=14.0, unloads_at_once=True)
    fit = _fitted(OddSession(Law(friction=friction), Rig(), 6, truth))
    assert fit.missing == ("damping",)
    assert Verdict.FRICTION in fit.verdicts
    assert NoteCode.SLIP_OR_FRICTION in [note.code for note in fit.notes]
    assert fit.stiffness.value == pytest.approx(Law().stiffness, rel=0.02)
    low, high = fit.stiffness.ci95
    assert low < Law().stiffness < 1.05 * Law().stiffness < high, "slip would give more"


def test_the_shift_of_a_record_is_reported_in_millimetres_and_newtons() -> None:
    place = _finding(_diagnosed(CauseCode.DISPLACEMENT_ZERO)[1], FindingCode.START)
    assert place.value == pytest.approx(0.012, abs=1e-4)
    assert place.more["force_n"] == pytest.approx(-102, abs=1)


def test_migration_under_held_loads_is_distinguished_from_another_zero() -> None:
    fit = _fitted(Session(published("hand", hold=4.0, duration=12.0), 2))
    place = _finding(fit.diagnosis, FindingCode.START)
    assert "migrated_m" in place.more
    assert CauseCode.DISPLACEMENT_ZERO not in [cause.code for cause in fit.diagnosis.causes]


@pytest.mark.parametrize("code", [CauseCode.TARE, CauseCode.ZERO_DRIFT, CauseCode.DISPLACEMENT_ZERO])
def test_an_offset_leaves_stiffness_and_damping_alone(code: CauseCode) -> None:
    clean, odd = _diagnosed(None)[0], _diagnosed(code)[0]
    for one, other in ((clean.stiffness, odd.stiffness), (clean.damping, odd.damping)):
        assert abs(one.value - other.value) < 2 * np.hypot(one.standard_error, other.standard_error)


@pytest.mark.parametrize("gain", [0.95, 1.0, pytest.param(1.05, marks=pytest.mark.slow)])
def test_a_gain_error_is_reported_with_its_figure_where_the_weights_are_known(gain: float) -> None:
    trials = _trials(OddSession(Law(), Rig(), 1, WEIGHED))
    masses = (15 / 9.80665,) * 5
    read = [replace(each, force=gain * each.force, force_step=gain * each.force_step) for each in trials]
    (fit,) = fit_session([replace(each, step_masses=masses) for each in read]).cuffs.values()
    figures = {cause.code: cause.figures for cause in fit.diagnosis.causes}
    assert (CauseCode.GAIN in figures) == (gain != 1)
    assert fit.verdicts == ((Verdict.IDENTIFIED,) if gain == 1 else (Verdict.SCALE,))
    if gain == 1:
        return
    found, error = figures[CauseCode.GAIN]["gain"], figures[CauseCode.GAIN]["standard_error"]
    assert abs(found - gain) < 4 * error < 0.02
    (blind,) = fit_session(read).cuffs.values()
    assert blind.diagnosis.causes == ()
    assert blind.verdicts == (Verdict.IDENTIFIED,), "without the weights it cannot be known"


def test_a_load_cell_that_reads_a_known_mass_correctly_is_not_blamed_for_loads_that_are_not_the_protocol_s() -> None:
    trials = _trials(OddSession(Law(), Rig(), 1, WEIGHED))
    checked = [replace(each, step_masses=(10 / 9.80665,) * 5, is_gain_checked=True) for each in trials]
    (fit,) = fit_session(checked).cuffs.values()
    assert fit.diagnosis.causes[0].code is CauseCode.LOADS
    assert fit.diagnosis.causes[0].figures["gain"] == pytest.approx(1.5, abs=0.01)
    assert CauseCode.GAIN not in [cause.code for cause in fit.diagnosis.causes]
    assert fit.verdicts == (Verdict.SCALE,)


def test_a_tare_with_the_weight_on_is_reported_although_the_cell_s_zero_is_not_zero() -> None:
    truth = Truth(friction=1e9, migration=0.0, duration=14.0, hold=5.0, volt_zero=0.08)
    fit = _fitted(OddSession(Law(), Rig(dynamic_zero=-23.0), 2, truth))
    assert fit.diagnosis.causes[0].code is CauseCode.TARE


@pytest.mark.parametrize(("chosen", "creeps"), [(CauseCode.FRICTION, False), (CauseCode.CREEP, True)])
def test_creep_that_no_hold_shows_is_not_named_before_friction(chosen: CauseCode, creeps: bool) -> None:
    scores = tuple(ClassScore(name, 1.0, gain) for name, gain in (("creep", 0.62), ("friction", 0.61)))
    both = ModelComparison(scores, ("creep", "friction"))
    assert find_causes([], [], both, creeps=creeps)[0].code is chosen
    alone = ModelComparison(scores, ("creep",))
    assert find_causes([], [], alone, creeps=False)[0].code is CauseCode.CREEP, "weak creep may not show in the holds"


def test_a_stiffness_that_skin_makes_wrong_is_not_called_identified() -> None:
    assert Verdict.SKIN in _diagnosed(CauseCode.SKIN)[0].verdicts
    assert Verdict.IDENTIFIED not in _diagnosed(CauseCode.SKIN)[0].verdicts
    for code in (None, CauseCode.TARE, CauseCode.DISPLACEMENT_ZERO, CauseCode.STIFFENING):
        assert _diagnosed(code)[0].verdicts == (Verdict.IDENTIFIED,)


def test_every_check_has_its_number() -> None:
    checks = [finding.check for finding in _diagnosed(CauseCode.STIFFENING)[1].findings]
    assert [check for check in dict.fromkeys(checks) if check != "D5"] == ["D1", "D2", "D3", "D4", "D6", "D7", "D8"]
    stiffening, softening = (
        _finding(_diagnosed(code)[1], FindingCode.CURVATURE) for code in (CauseCode.STIFFENING, CauseCode.SOFTENING)
    )
    assert stiffening.is_alarm
    assert softening.is_alarm
    assert stiffening.value > 0 > softening.value
    assert _finding(_diagnosed(CauseCode.PULL_DIRECTION)[1], FindingCode.ANGLE).is_alarm
    assert _finding(_diagnosed(CauseCode.FRICTION)[1], FindingCode.STIFFNESS_RATIO).value > 1.1
