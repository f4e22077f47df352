"""Notes and verdicts on a donning beside its figures."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from fitting.cuffs.cuff_fit import CuffFit
from fitting.diagnosis.identification import identify, interval_notes, migration_interval_notes
from fitting.dynamic.damping import fit_swings
from fitting.pull.pull import make_pulls
from fitting.results.codes import NoteCode, Verdict
from fitting.results.trial_codes import TrialNoteCode
from fitting.session import fit_donning, fit_session
from fitting.static.held_loads import fit_held_loads
from fitting.trial.trial import build_trial
from fitting.uncertainty import Estimate, Repeat, combine
from tests.fitting.defects import Law, OddSession, Rig
from tests.fitting.experiment import PUBLISHED, Session, Truth, published

USUAL = (NoteCode.NOT_CALIBRATED, NoteCode.NO_ROPE)
"""Notes of every session of the experiment, which has neither a bounce nor markers on the rope."""
RUBBING = {NoteCode.FRICTION_OR_CREEP, NoteCode.FRICTION_OR_MOVED, NoteCode.SLIP_OR_FRICTION}


@pytest.mark.parametrize(("apart", "is_said"), [(2.0, False), (60.0, True)])
def test_two_repeats_whose_interval_holds_zero_are_not_passed_over(apart: float, is_said: bool) -> None:
    damping = combine([Repeat(210.0 + side * apart, 5.0) for side in (-1, 1)])
    assert damping.standard_error < damping.value / 2, "by the standard error alone it is identified"
    notes = interval_notes(damping)
    assert bool(notes) == is_said
    assert all(note.code is NoteCode.DAMPING_INTERVAL for note in notes)
    assert interval_notes(None) == ()


@pytest.mark.slow
def test_a_damping_that_is_hardly_identified_is_given_without_choosing_by_its_value() -> None:
    """20 Hz and a stiff cuff: the unknown place of the edge between two samples changes c by about a third."""
    off, errors, is_called, is_small = [], [], [], []
    for seed in range(60):
        session = Session(published("hand", friction=1e9, migration=0.0, force_rate=20.0, duration=10.0), 700 + seed)
        fit = fit_donning([build_trial(*session.dynamic(), "d", "d")])
        assert fit.damping, "every session gives a figure"
        off.append(fit.damping.value - 210.0)
        errors.append(fit.damping.standard_error)
        is_called.append(Verdict.LAG not in fit.verdicts)
        is_small.append(not fit.damping.is_too_wide)
    z = np.array(off) / np.array(errors)
    low, high = stats.chi2.ppf([0.0005, 0.9995], len(z))
    assert low < np.sum(z**2) < high
    assert abs(z.mean()) < 3.3 / np.sqrt(len(z)), "the values are not biased"
    assert np.mean(np.abs(z) < 1.96) > 0.85
    called = z[np.array(is_called)]  # where the edges happen to lie close to samples
    assert 5 < len(called) < 50
    assert abs(called.mean()) < 3.3 / np.sqrt(len(called)), "nor are those that are identified"
    chosen = z[np.array(is_small)]
    assert 10 < len(chosen) < 50
    assert chosen.mean() > 3.3 / np.sqrt(len(z)), (
        "a choice of those whose error is small relative to the value would be biased upwards"
    )


@pytest.mark.parametrize(
    ("estimate", "is_identified"),
    [
        (Estimate(5463.0, 1767.0, (3154.0, 20374.0)), False),
        (Estimate(5463.0, 1767.0, (2000.0, 8927.0)), True),
        (Estimate(5463.0, 1767.0, (3154.0, math.inf)), False),
    ],
)
def test_a_stiffness_whose_interval_is_wider_than_its_value_is_not_identified(
    estimate: Estimate, is_identified: bool
) -> None:
    (pull,), _ = make_pulls([build_trial(*Session(published("hand"), 1).static(1), "s", "s")])
    held = fit_held_loads([pull], 0.0)
    held = replace(held, stiffness=replace(held.stiffness, stiffness=estimate))
    assert not estimate.is_too_wide
    identified = identify([pull], [pull], held, fit_swings([], estimate, 0.2, 0.0), (), has_friction=False)
    assert (identified.stiffness is not None) == is_identified
    assert (Verdict.STIFFNESS_UNCERTAIN in identified.verdicts) == (not is_identified)


@pytest.mark.parametrize(
    ("low", "high", "is_said"), [(-0.0047, 0.0083, True), (-0.00003, 0.00004, False), (0.01, 0.014, False)]
)
def test_a_migration_whose_interval_is_wider_than_its_value_is_said_unless_there_is_none(
    low: float, high: float, is_said: bool
) -> None:
    notes = migration_interval_notes(Estimate((low + high) / 2, (high - low) / 4, (low, high)))
    assert [note.code for note in notes] == [NoteCode.MIGRATION_INTERVAL] * is_said


@cache
def _fitted(law: Law, seed: int, *, unloads_at_once: bool = True, repeats: int = 2) -> CuffFit:
    """A donning of static trials."""
    truth = Truth(friction=1e9, migration=0.0, hold=6.0, unloads_at_once=unloads_at_once)
    session = OddSession(law, Rig(), seed, truth)
    trials = [build_trial(*session.static(i), f"s{i}", "s") for i in range(1, repeats + 1)]
    (fit,) = fit_session(trials).cuffs.values()
    return fit


def _codes(law: Law, seed: int, unloads_at_once: bool) -> list[NoteCode]:
    """Of the notes on the law of the held loads."""
    fit = _fitted(law, seed, unloads_at_once=unloads_at_once)
    assert fit.stiffness
    return [note.code for note in fit.notes if note.code not in USUAL]


@pytest.mark.parametrize(("repeats", "seed"), [(1, 0), (2, 1)])
@pytest.mark.parametrize(
    ("law", "is_too_wide"),
    [(Law(friction=2.0), True), (Law(friction=4.0), True), (Law(slip_from=45.0), False), (Law(), False)],
)
def test_weights_that_come_off_at_once_leave_friction_and_slip_open(
    law: Law, is_too_wide: bool, repeats: int, seed: int
) -> None:
    """4 N of friction make unloading 10 % steeper; loading is bent for a cuff that slips from 45 N."""
    fit = _fitted(law, seed, repeats=repeats)
    assert fit.stiffness.ci95[0] < 8520 < fit.stiffness.ci95[1]
    assert (NoteCode.SLIP_OR_FRICTION in [note.code for note in fit.notes]) == is_too_wide
    assert ("friction" in fit.stiffness.parts) == is_too_wide
    for trial in fit.trials:
        assert (TrialNoteCode.ONE_BRANCH in [note.code for note in trial.notes]) == is_too_wide
        assert not is_too_wide or (trial.stiffness and trial.stiffness.ci95[0] < 8520)


@pytest.mark.parametrize("cuff", ["hand", "waist", "tube", "elbow"])
def test_a_cuff_that_stays_out_farther_than_friction_holds_it_has_slipped(cuff: str) -> None:
    session = Session(published(cuff, unloads_at_once=True, has_rope_markers=True), 1)
    fit = fit_donning([build_trial(*session.static(1), "s", "s")])
    assert "friction" not in fit.stiffness.parts
    assert fit.stiffness.standard_error < 0.01 * fit.stiffness.value
    assert fit.stiffness.ci95[0] < PUBLISHED[cuff][0] < fit.stiffness.ci95[1]
    assert fit.damping is None and fit.verdicts == (Verdict.NO_DYNAMIC,)
    assert NoteCode.SLIP_OR_FRICTION not in [note.code for note in fit.notes]


@pytest.mark.parametrize(("unloads_at_once", "seed"), [pytest.param(False, 0, marks=pytest.mark.slow), (True, 1)])
def test_the_note_names_only_the_law_of_the_held_loads(unloads_at_once: bool, seed: int) -> None:
    assert _codes(Law(), seed, unloads_at_once) == []
    rubbing = _codes(Law(friction=4.0), seed, unloads_at_once)
    assert RUBBING & set(rubbing)
    assert not {NoteCode.CREEPS, NoteCode.SLIPS_AGAIN} & set(rubbing)
    assert _codes(Law(stiffness=9640.0, bend=-26.0), seed, unloads_at_once)[0] is NoteCode.SOFTENS
    creeping = _codes(Law(slow=(0.15, 15.0)), seed, unloads_at_once)
    assert creeping[0] is NoteCode.CREEPS
    assert not {NoteCode.SLIPS_AGAIN, *RUBBING} & set(creeping)
    assert not {NoteCode.SLIPS_AGAIN, NoteCode.SLIP_OR_FRICTION} & set(
        _codes(Law(slip_from=45.0), seed, unloads_at_once)
    )
