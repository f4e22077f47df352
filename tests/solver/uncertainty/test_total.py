"""Total uncertainty: people are shifted to the assessment's figures, and the cuffs are decided on."""

from dataclasses import fields, replace

import numpy as np
import pytest

from solver.suit.decision import DecisionOutcome, DecisionRule
from solver.suit.quantity import Quantity
from solver.suit.readouts import CurveReadouts
from solver.uncertainty.people import person_spans
from solver.uncertainty.total import total_uncertainty
from tests.solver.uncertainty.test_people import CASE, EVERY, HAND, SUIT, WAIST, DrawSettings, assess, people  # noqa: F401


@pytest.fixture(scope="module")
def assessment():
    found = assess(CASE.motion, SUIT, (WAIST, HAND), every=EVERY, draws=DrawSettings(count=0))
    return replace(found, curves=tuple(shifted(curve, 0.01) for curve in found.curves))


def shifted(curve, by):
    """As of an assessment on more frames."""
    value = curve.figures["at_reference"].value + by
    return replace(curve, figures={**curve.figures, "at_reference": Quantity(value)})


def test_intervals_are_of_the_people_about_the_figures_of_the_assessment(assessment, people):  # noqa: F811
    total = total_uncertainty(assessment, people, EVERY, DecisionRule())
    assert (total.people, total.solved) == (3, 3)
    for curve in assessment.curves:
        figure, drawn = total.figures[curve.condition, curve.cuff]["at_reference"], people[curve.condition, curve.cuff]
        assert figure.value == curve.figures["at_reference"].value
        ends = np.quantile(drawn.at_reference[1:] + 0.01, [0.025, 0.975])
        expected = min(ends[0], figure.value), max(ends[1], figure.value)
        assert figure.ci95 == pytest.approx(expected, abs=1e-9)
        assert set(total.reduction[curve.condition, curve.cuff]) == set(curve.reduction)


def test_the_band_is_of_the_people_about_the_curve_of_the_assessment_where_enough_are_known(assessment, people):  # noqa: F811
    drawn = people["both", "hand"]
    efforts = drawn.efforts.copy()
    efforts[1, 0] = np.nan  # one of three people has no solution with the shortest cord
    found = {**people, ("both", "hand"): replace(drawn, efforts=efforts)}
    bands = total_uncertainty(assessment, found, EVERY, DecisionRule()).bands
    assert list(bands) == [("both", "hand")]
    low, high = bands["both", "hand"].low, bands["both", "hand"].high
    assert np.isnan([low[0], high[0]]).all() and np.isfinite(low[1:]).all()
    (curve,) = (curve for curve in assessment.curves if curve.condition == "both")
    ends = np.quantile((drawn.efforts[1:] - drawn.efforts[0] + curve.cost)[:, 3], [0.025, 0.975])
    assert (low[3], high[3]) == pytest.approx((min(ends[0], curve.cost[3]), max(ends[1], curve.cost[3])))


def test_one_cuff_alone_is_no_choice_and_too_many_unknown_people_leave_no_interval(assessment, people):  # noqa: F811
    numbers = [field.name for field in fields(CurveReadouts) if field.name != "outcome"]
    unknown = {
        place: replace(r, **{name: np.where([1, 1, 0, 0], getattr(r, name).T, np.nan).T for name in numbers})
        for place, r in people.items()
    }
    assert total_uncertainty(assessment, people, EVERY, DecisionRule()).decisions["at_best"].outcome == "only_cuff"
    total = total_uncertainty(assessment, unknown, EVERY, DecisionRule())
    assert total.decisions["at_reference"].outcome is DecisionOutcome.UNKNOWN
    assert total.figures["both", "hand"]["at_reference"].ci95 is None
    assert total.solved == 1


def test_people_without_an_effort_are_counted_once_by_their_outcome(assessment, people):  # noqa: F811
    unknown = {("rigid", None): [1], ("shift", "hand"): [1, 2, 3], ("both", "hand"): [2]}
    outcomes = {1: "infeasible", 2: "not_converged", 3: "infeasible"}
    found = dict(people)
    for place, persons in unknown.items():
        effort, outcome = people[place].at_reference.copy(), people[place].outcome.astype("U20")
        effort[persons] = np.nan
        outcome[persons] = [outcomes[person] for person in persons]
        found[place] = replace(people[place], at_reference=effort, outcome=outcome)
    total = total_uncertainty(assessment, found, EVERY, DecisionRule())
    assert list(total.unsolved.items()) == [("infeasible", 2), ("not_converged", 1)]
    assert total.solved == total.people - sum(total.unsolved.values()) == 0
    assert total_uncertainty(assessment, people, EVERY, DecisionRule()).unsolved == {}


def test_rest_lengths_of_people_are_around_the_optimum_or_all():
    optima = {("both", "hand"): (0.7, 0.05), ("rigid", None): (None, None)}
    spans = person_spans(SUIT, optima, {("both", "hand"): 0.02, ("rigid", None): 0.0})
    assert spans["both", "hand"] == pytest.approx((0.67, 0.77))
    assert spans["rigid", None] == pytest.approx((0.63, 0.87))
