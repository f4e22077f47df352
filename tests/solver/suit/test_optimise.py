"""Optimising the suit: it finds what the assessment's curve shows, and a stiffer search never ends worse."""

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.cuff import CuffParameters
from solver.motion import decimate, differentiate
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.assessment import assess
from solver.suit.optimise import SearchOutcome, optimise_suit
from solver.suit.suit import read_suit
from solver.uncertainty.varied_model import drawn_cuffs

MODEL = bundled_model()
MOTION = decimate(differentiate(simulate_arm_raise(MODEL)), 10)
SUIT = read_suit()
WAIST = CuffParameters("waist", "waist", 2140.0, 124.0, 0.012)
HAND = CuffParameters("hand", "arm", 8520.0, 210.0, 0.012, np.diag([200.0, 20.0, 0.01]) ** 2)


def found(*free, condition="visco_elastic", draws=0, arm=HAND, **options):
    drawn = [tuple(pair) for pair in drawn_cuffs((WAIST, arm), draws)]
    motion = LoadedMotion(MODEL, MOTION)
    return optimise_suit(motion, SUIT, (WAIST, arm), condition, free, drawn=drawn, every=10, **options)


@pytest.fixture(scope="module")
def rest_length_only():
    return found()


def test_the_best_rest_length_is_that_of_the_curve(rest_length_only):
    coarse = replace(SUIT, rest_lengths=np.linspace(0.66, 0.78, 9))
    curves = assess(LoadedMotion(MODEL, MOTION), coarse, [WAIST, HAND], every=10).curves
    (figures,) = [curve.figures for curve in curves if curve.condition == "visco_elastic"]
    assert rest_length_only.fitted.suit.reference_rest_length == pytest.approx(figures["rest_length"].value, abs=2e-3)


def test_what_was_not_freed_stays(rest_length_only):
    suit = rest_length_only.fitted.suit
    assert (suit.stiffness, suit.waist, suit.arm) == (SUIT.stiffness, SUIT.waist, SUIT.arm)
    assert rest_length_only.start.suit is SUIT
    assert rest_length_only.robust.suit.reference_rest_length == suit.reference_rest_length  # nothing was drawn


def test_more_freedom_saves_more(rest_length_only):
    freed = found("stiffness")
    assert freed.fitted.cost < rest_length_only.fitted.cost < rest_length_only.start.cost
    assert freed.fitted.suit.stiffness != SUIT.stiffness


def test_a_freed_point_moves_by_five_centimetres_at_most():
    freed = found("arm").fitted.suit
    moved = np.abs(freed.arm.location - SUIT.arm.location)
    assert 0 < moved.max() <= 0.05 + 1e-9
    np.testing.assert_array_equal(freed.waist.location, SUIT.waist.location)


def test_a_search_that_ends_at_a_bound_reports_it(rest_length_only):
    assert rest_length_only.fitted.at_limit == ()
    narrow = replace(SUIT, rest_lengths=np.linspace(0.6, 0.68, 5), reference_rest_length=0.66)
    stopped = optimise_suit(LoadedMotion(MODEL, MOTION), narrow, (WAIST, HAND), "rigid", every=10)
    assert stopped.fitted.at_limit == ("rest_length",)
    assert stopped.fitted.suit.reference_rest_length == pytest.approx(0.68, abs=1e-3)


def test_the_progress_of_a_search_that_converges_ends_with_the_suits_tried():
    calls = []
    tried = found(progress=lambda *call: calls.append(call)).tried
    assert calls[-1] == ("trying suits", tried, tried)
    assert [done for _, done, _ in calls] == list(range(tried + 1))
    assert {total for _, _, total in calls[:-1]} == {160} and tried < 160


def test_the_robust_optimum_is_the_better_one_on_average():
    # a cuff that slips by 12 ± 10 mm: too short a cord costs more than one that is too long
    both = found(condition="both", draws=12)
    assert len(both.robust.drawn) == 12
    assert both.robust.drawn.mean() <= both.fitted.drawn.mean() + 1e-5
    assert both.robust.suit.reference_rest_length != both.fitted.suit.reference_rest_length


def test_a_search_at_its_limit_of_evaluations_reports_it(rest_length_only, monkeypatch):
    assert rest_length_only.fitted.outcome is SearchOutcome.CONVERGED
    monkeypatch.setattr("solver.suit.optimise.TRIES_PER_FREEDOM", 2)
    starved = found()
    assert (starved.start.outcome, starved.fitted.outcome) == (SearchOutcome.CONVERGED, SearchOutcome.NOT_CONVERGED)
