"""Drawn people give an assessment its intervals: shifted to its figures, by source, and with the decision."""

from dataclasses import fields, replace

import numpy as np
import pytest

from solver.scaling import Scaling
from solver.suit.assessment import Comparison, assess
from solver.suit.decision import DecisionOutcome, DecisionRule
from solver.suit.quantity import Quantity, content_of_intervals, interval_of_draws
from solver.suit.scenarios import CurveReadouts
from solver.uncertainty.factors import normal_scores, unit_sample
from solver.uncertainty.people import PeopleCase, solve_people
from solver.uncertainty.sources import UncertaintySources
from solver.uncertainty.total import INFEASIBLE_MOTION, explained_figures, mark_infeasible, with_people
from solver.uncertainty.varied_motion import DrawnMotion
from tests.solver.uncertainty.test_people import CASE, EVERY, HAND, SUIT, WAIST, people  # noqa: F401

UNSURE = replace(HAND, covariance=np.diag([100.0, 10.0, 0.002]) ** 2)
OF_FIT = UncertaintySources().fit_only
DRAWS = 8


@pytest.fixture(scope="module")
def assessment():
    found = assess(CASE.motion, SUIT, (WAIST, HAND), every=EVERY)
    return replace(found, curves=tuple(shifted(curve, 0.01) for curve in found.curves))


def shifted(curve, by):
    """As of an assessment on more frames."""
    value = curve.figures["at_reference"].value + by
    return replace(curve, figures={**curve.figures, "at_reference": Quantity(value)})


def summarised(assessment, readouts):
    return with_people(assessment, readouts, EVERY, ("fit", "body"), DecisionRule())


def drawn(*cuffs, suit=SUIT, sources=OF_FIT, count=DRAWS, motions=()):
    """The assessment of these cuffs, with the intervals of these sources."""
    found = assess(CASE.motion, suit, cuffs, every=EVERY)
    waist, *arms = cuffs if cuffs[0].site == "waist" else (None, *cuffs)
    case = PeopleCase(CASE.motion, suit, waist, tuple(arms), sources, EVERY, motions)
    unit = unit_sample(case.factors, count, "latin_hypercube", seed=1)
    scores = np.vstack([np.zeros(unit.shape[1]), normal_scores(unit)])
    return with_people(found, solve_people(case, scores, workers=1), EVERY, ("fit",), DecisionRule())


@pytest.fixture(scope="module")
def of_fit():
    return drawn(WAIST, UNSURE)


def curve_of(assessment, condition, cuff="hand"):
    (found,) = [c for c in assessment.curves if c.condition == condition and (c.cuff or cuff) == cuff]
    return found


def test_intervals_are_of_the_people_about_the_figures_of_the_assessment(assessment, people):  # noqa: F811
    found = summarised(assessment, people)
    assert (found.uncertainty.people, found.uncertainty.solved) == (3, 3)
    assert found.uncertainty.content == content_of_intervals(3)
    for before, curve in zip(assessment.curves, found.curves, strict=True):
        figure, versions = curve.figures["at_reference"], people[curve.condition, curve.cuff]
        assert figure.value == before.figures["at_reference"].value
        ends = interval_of_draws(versions.at_reference[1:] + 0.01)
        expected = min(ends[0], figure.value), max(ends[1], figure.value)
        assert figure.ci95 == pytest.approx(expected, abs=1e-9)
        assert set(curve.reduction) == set(before.reduction)
    assert found.uncertainty.largest_difference["at_reference"] == pytest.approx(0.01, abs=1e-9)


def test_the_band_is_of_the_people_about_the_curve_of_the_assessment_where_enough_are_known(assessment, people):  # noqa: F811
    versions = people["both", "hand"]
    efforts = versions.efforts.copy()
    efforts[1, 0] = np.nan  # one of three people has no solution with the shortest cord
    found = summarised(assessment, {**people, ("both", "hand"): replace(versions, efforts=efforts)})
    assert [curve.condition for curve in found.curves if curve.cost_ci95 is not None] == ["both"]
    curve = curve_of(found, "both")
    low, high = curve.cost_ci95.T
    assert np.isnan([low[0], high[0]]).all() and np.isfinite(low[1:]).all()
    ends = interval_of_draws((versions.efforts[1:] - versions.efforts[0] + curve.cost)[:, 3])
    assert (low[3], high[3]) == pytest.approx((min(ends[0], curve.cost[3]), max(ends[1], curve.cost[3])))


def test_one_cuff_alone_is_no_choice_and_too_many_unknown_people_leave_no_interval(assessment, people):  # noqa: F811
    numbers = [field.name for field in fields(CurveReadouts) if field.name != "outcome"]
    unknown = {
        place: replace(r, **{name: np.where([1, 1, 0, 0], getattr(r, name).T, np.nan).T for name in numbers})
        for place, r in people.items()
    }
    assert summarised(assessment, people).uncertainty.decisions["at_best"].outcome is DecisionOutcome.ONLY_CUFF
    found = summarised(assessment, unknown)
    assert found.uncertainty.decisions["at_reference"].outcome is DecisionOutcome.UNKNOWN
    assert curve_of(found, "both").figures["at_reference"].ci95 is None
    assert found.uncertainty.solved == 1


def test_people_without_an_effort_are_counted_once_by_their_outcome(assessment, people):  # noqa: F811
    unknown = {("rigid", None): [1], ("shift", "hand"): [1, 2, 3], ("both", "hand"): [2]}
    outcomes = {1: "infeasible", 2: "not_converged", 3: "infeasible"}
    found = dict(people)
    for place, persons in unknown.items():
        effort, outcome = people[place].at_reference.copy(), people[place].outcome.astype("U20")
        effort[persons] = np.nan
        outcome[persons] = [outcomes[person] for person in persons]
        found[place] = replace(people[place], at_reference=effort, outcome=outcome)
    summary = summarised(assessment, found).uncertainty
    assert list(summary.unsolved.items()) == [("infeasible", 2), ("not_converged", 1)]
    assert summary.solved == summary.people - sum(summary.unsolved.values()) == 0
    assert summarised(assessment, people).uncertainty.unsolved == {}


def test_drawn_migration_moves_the_best_rest_length_and_the_force_and_not_the_cost_there(of_fit):
    figures = curve_of(of_fit, "shift").figures
    (shortest, longest), (weakest, strongest) = figures["rest_length"].ci95, figures["cord_force"].ci95
    assert 0.001 < longest - shortest < 4 * 0.002  # eight draws with a standard error of 2 mm
    assert strongest - weakest == pytest.approx(SUIT.stiffness * (longest - shortest), rel=0.05)
    cheapest, dearest = figures["lowest_cost"].ci95
    assert dearest - cheapest < 1e-4


def test_every_figure_of_a_yielding_shifted_cuff_has_an_interval_around_it(of_fit):
    found = curve_of(of_fit, "both")
    for name, figure in found.figures.items():
        low, high = figure.ci95
        assert low <= figure.value <= high, name
    assert all(figure.ci95 for figure in found.reduction.values() if figure.value is not None)  # no idle muscle
    assert all(figure.ci95 is None for figure in curve_of(of_fit, "rigid").figures.values())


def test_cuffs_that_may_have_slipped_far_have_intervals_too():
    unsure = replace(HAND, covariance=np.diag([850.0, 60.0, 0.008]) ** 2)
    found = drawn(replace(WAIST, covariance=np.diag([200.0, 30.0, 0.006]) ** 2), unsure, count=30)
    figures = curve_of(found, "both").figures
    assert all(figure.ci95[0] <= figure.value <= figure.ci95[1] for figure in figures.values())
    assert np.ptp(figures["rest_length"].ci95) > 0.025


def test_on_the_same_frames_the_people_differ_by_interpolation_only(of_fit):
    assert max(of_fit.uncertainty.largest_difference.values()) < 5e-3
    along_the_bone = drawn(WAIST, UNSURE, suit=replace(SUIT, migration_direction="bone"), count=2)
    assert max(along_the_bone.uncertainty.largest_difference.values()) < 5e-3


def test_motions_drawn_beside_the_assessed_one_widen_the_intervals_of_rigid_cuffs():
    motion = CASE.motion.kinematics
    raised = (replace(motion, positions=motion.positions * (1 + share)) for share in (-0.06, -0.03))
    raised = tuple(DrawnMotion(Scaling(), one) for one in raised)
    found = drawn(WAIST, UNSURE, motions=raised)
    assert np.ptp(curve_of(found, "rigid").figures["at_reference"].ci95) > 1e-3


def test_two_cuffs_are_compared_person_by_person():
    tube = replace(HAND, name="tube", migration=0.003, covariance=UNSURE.covariance / 100)
    twin = replace(UNSURE, name="twin")
    found = drawn(WAIST, UNSURE, tube, twin, count=DRAWS)
    compared = {one.cuffs: one for one in found.comparisons}
    assert set(compared) == {("hand", "tube"), ("hand", "twin"), ("tube", "twin")}
    costs = [curve_of(found, "both", cuff).figures["at_reference"].value for cuff in ("hand", "tube")]
    assert compared["hand", "tube"].cost_difference.value == pytest.approx(costs[0] - costs[1])
    assert compared["hand", "tube"].differ
    assert compared["hand", "twin"].differ is False
    assert Comparison(("a", "b"), Quantity(0.1)).differ is None


def test_people_whose_muscles_cannot_do_the_motion_are_marked_counted_and_left_out(assessment, people):  # noqa: F811
    """By the rule of the assessed motion: reserves above a tenth of the effort with a slack cord, in any condition."""
    reserves = {("both", "hand"): [0.0, 17.0, 0.09, 0.0], ("rigid", None): [0.0, 3.2, 0.0, 0.12]}
    heavy = {place: replace(one, reserves=np.array(reserves.get(place, [0.0] * 4))) for place, one in people.items()}
    marked = mark_infeasible(heavy, has_assessed=True)
    assert (marked["shift", "hand"].outcome == INFEASIBLE_MOTION).tolist() == [False, True, False, True]
    found = summarised(assessment, marked)
    assert (found.uncertainty.people, found.uncertainty.infeasible, found.uncertainty.solved) == (3, 2, 1)
    assert found.uncertainty.content == content_of_intervals(1)
    only = {place: one.part(np.array([True, False, True, False])) for place, one in people.items()}
    assert [c.figures for c in found.curves] == [c.figures for c in summarised(assessment, only).curves]
    efforts = explained_figures(marked)["effort_at_reference", ("hand",)]
    assert np.isnan(efforts).tolist() == [False, True, False, True]


def test_where_the_assessed_motion_is_infeasible_no_person_is_left_out(people):  # noqa: F811
    heavy = {place: replace(one, reserves=np.array([0.2, 17.0, 0.0, 0.0])) for place, one in people.items()}
    marked = mark_infeasible(heavy, has_assessed=True)
    assert not any((one.outcome == INFEASIBLE_MOTION).any() for one in marked.values())
    assert mark_infeasible(heavy, has_assessed=False)["rigid", None].outcome[0] == INFEASIBLE_MOTION
