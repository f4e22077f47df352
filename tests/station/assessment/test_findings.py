"""Findings follow from the intervals, and an unknown figure is never a number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np
import pytest

from solver.muscle import MuscleOutcome
from solver.redundancy.problem import FrameOutcome
from solver.suit.assessment import Assessment, Comparison, EffortCurve, UncertaintySummary
from solver.suit.decision import DecisionRule
from solver.suit.quantity import Quantity
from solver.suit.scenarios import CurveReadouts
from station.assessment.assessment_json import count, motion_entries
from station.assessment.findings import MUSCLE_OUTCOMES, OUTCOMES, Finding, findings
from station.messages.assessment_messages import AssessmentCode

DRAWN = {
    "people": 200,
    "solved": 198,
    "every": 20,
    "sources": "the fit of the cuffs and motion",
    "least_percent": 92.0,
    "most_percent": 98.0,
}


def curve(cuff: str | None, cost: float | None, condition: str = "both") -> EffortCurve:
    names = [field.name for field in fields(CurveReadouts)]
    values = {name: Quantity(None) for name in names} | {"at_reference": Quantity(cost)}
    nothing = np.zeros((0, 0))
    return EffortCurve(condition, cuff, np.ones(2), np.array([0.5, 0.0012]), nothing, 0, values, {})  # type: ignore[arg-type]


def with_figures(plain: EffortCurve, **figures: float) -> EffortCurve:
    return replace(plain, figures={**plain.figures, **{name: Quantity(value) for name, value in figures.items()}})


def assessment(*curves: EffortCurve, **more: object) -> Assessment:
    nothing = np.zeros(0)
    plain = Assessment(
        muscles=(),
        time=np.array([0.0, 0.1]),
        rest_lengths=np.array([0.6, 0.75]),
        reference_rest_length=0.74,
        bare_body_cost=0.95,
        longest_cord=0.87,
        waist_cuff=None,
        slack=nothing,
        curves=(curve(None, 0.79, "rigid"), *curves),
        comparisons=(),
        uncertainty=None,
        scenarios=4,
        outcomes={},
        muscle_outcomes={},
    )
    return replace(plain, **more)  # type: ignore[arg-type]


def summary(change: Mapping[str, float], **more: object) -> UncertaintySummary:
    plain = UncertaintySummary(200, 198, 20, {}, ("fit", "motion"), (0.92, 0.98), change, {}, DecisionRule())
    return replace(plain, **more)  # type: ignore[arg-type]


def compared(value: float | None, ci95: tuple[float, float] | None) -> list[Finding]:
    pair = (curve("hand", 0.88), curve("tube", 0.84))
    return findings(assessment(*pair, comparisons=(Comparison(("hand", "tube"), Quantity(value, ci95)),)))


def one(found: list[Finding], code: AssessmentCode) -> Finding:
    (finding,) = (finding for finding in found if finding.code is code)
    return finding


def test_the_cuff_with_the_least_effort_is_chosen_if_all_others_differ() -> None:
    choice, comparison, *_ = compared(0.04, (0.035, 0.045))
    assert choice.code is AssessmentCode.LEAST_EFFORT
    assert choice.figures == {"cuff": "tube", "effort": 0.84, "at_m": 0.74, "cuffs": "hand, tube"}
    assert comparison.code is AssessmentCode.DIFFERENT
    assert str(comparison) == "hand − tube: +4.00 % effort at 0.740 m (95 % CI +3.50 to +4.50 %)."


@pytest.mark.parametrize(
    ("value", "ci95", "code"),
    [(0.01, (-0.005, 0.025), AssessmentCode.NOT_DISTINGUISHED), (0.004, (0.0039, 0.0041), AssessmentCode.NOT_RELEVANT)],
)
def test_an_equivalent_cuff_is_named(value: float, ci95: tuple[float, float], code: AssessmentCode) -> None:
    choice, comparison, *_ = compared(value, ci95)
    assert (choice.code, choice.figures["equivalent"]) == (AssessmentCode.EQUIVALENT, "hand")
    assert comparison.code is code


def test_a_negative_difference_keeps_its_sign_and_interval() -> None:
    finding = compared(-0.04, (-0.045, -0.035))[1]
    found = [finding.figures[name] for name in ("difference_percent", "low_percent", "high_percent")]
    assert found == ["-4.00", "-4.50", "-3.50"]
    assert "−4.00 % effort at 0.740 m (95 % CI −4.50 to −3.50 %)" in str(finding)


@pytest.mark.parametrize(
    ("value", "code"), [(0.01, AssessmentCode.WITHOUT_INTERVAL), (None, AssessmentCode.NOT_COMPARED)]
)
def test_an_unknown_difference_or_interval_has_a_code(value: float | None, code: AssessmentCode) -> None:
    assert compared(value, None)[1].code is code


def test_one_cuff_alone_and_none_that_was_solved() -> None:
    assert findings(assessment(curve("hand", 0.85)))[0].code is AssessmentCode.ONLY_CUFF
    assert findings(assessment(curve("hand", None)))[0].code is AssessmentCode.NO_CHOICE


def test_the_effort_with_the_best_rest_length_is_given_if_it_is_known() -> None:
    best = with_figures(curve("hand", 0.85), lowest_cost=0.7852, rest_length=0.692)
    finding = one(findings(assessment(best, curve("tube", 0.84))), AssessmentCode.BEST_REST_LENGTH)
    assert finding.figures == {"cuff": "hand", "effort": 0.7852, "at_m": 0.692}


@pytest.mark.parametrize(("waist", "cuffs"), [(None, "hand"), ("belt", "hand and the belt cuff")])
def test_the_cost_of_migration_is_that_with_compliance(waist: str | None, cuffs: str) -> None:
    migrated = [
        with_figures(curve("hand", 0.83, condition), cord_force_lost=lost, cost_per_arm_migration=cost)
        for condition, lost, cost in (("shift", 0.3, 1.6), ("both", 0.2, 3.2))
    ]
    finding = one(findings(assessment(*migrated, waist_cuff=waist)), AssessmentCode.MIGRATION_COST_ALONE)
    assert finding.figures == {"cuff": "hand", "cuffs": cuffs, "lost_percent": 20.0, "percent_per_cm": "+3.2"}


@pytest.mark.parametrize(
    ("ci95", "ends", "code"),
    [
        ((-0.41, 8.27), ("-0.4", "+8.3"), AssessmentCode.MIGRATION_COST_OPEN),
        ((0.17, 5.65), ("+0.2", "+5.7"), AssessmentCode.MIGRATION_COST),
    ],
)
def test_a_cost_of_migration_whose_interval_contains_0_is_open(
    ci95: tuple[float, float], ends: tuple[str, str], code: AssessmentCode
) -> None:
    migrated = with_figures(curve("hand", 0.83), cord_force_lost=0.2)
    migrated = replace(migrated, figures={**migrated.figures, "cost_per_arm_migration": Quantity(2.3, ci95)})
    figures = one(findings(assessment(migrated)), code).figures
    assert (figures["low_per_cm"], figures["high_per_cm"]) == ends


def test_the_rest_length_of_the_slack_cord_is_given_and_its_distance_from_the_best_one() -> None:
    rigid = with_figures(curve(None, 0.79, "rigid"), to_slack=0.113, cord_force=54.0)
    finding = one(findings(replace(assessment(), curves=(rigid,))), AssessmentCode.CORD_FORCE)
    assert finding.figures == {"force_n": 54.0, "slack_cm": pytest.approx(11.3), "slack_m": 0.87}


def test_a_dash_that_is_no_failure_is_explained() -> None:
    finding = one(findings(assessment(curve("hand", 0.85))), AssessmentCode.OUTSIDE_RANGE)
    assert finding.figures == {"first_m": 0.6, "last_m": 0.75}
    inside = tuple(
        with_figures(plain, rest_length=0.7, permissible_error=0.04)
        for plain in (curve(None, 0.79, "rigid"), curve("a", 0.8))
    )
    assert AssessmentCode.OUTSIDE_RANGE not in [found.code for found in findings(replace(assessment(), curves=inside))]


@pytest.mark.parametrize(
    ("reserve", "code"), [(0.0012, AssessmentCode.RESERVES_SMALL), (3.0, AssessmentCode.RESERVES_LARGE)]
)
def test_the_effort_of_reserves_near_the_reference_is_given(reserve: float, code: AssessmentCode) -> None:
    cuff = replace(curve("hand", 0.85), reserve_cost=np.array([4.0, reserve]))
    finding = one(findings(assessment(cuff)), code)
    assert finding.figures == {"effort": reserve, "at_m": 0.75}
    assert code is not AssessmentCode.RESERVES_LARGE or "--effort" in str(finding), "its remedy"


def test_what_unsolved_frames_leave_unknown_is_never_a_number() -> None:
    unknown = replace(curve("hand", None), reserve_cost=np.full(2, np.nan))
    names = ("at_reference", "rest_length", "lowest_cost", "permissible_error")
    found = findings(assessment(unknown, uncertainty=summary(dict.fromkeys(names, np.nan))))
    assert one(found, AssessmentCode.INTERVALS_UNVERIFIED).figures == DRAWN
    assert not any("nan" in str(finding) for finding in found)


def test_the_effect_of_decimation_is_given() -> None:
    names = ("at_reference", "lowest_cost", "rest_length", "permissible_error")
    change = summary(dict(zip(names, (0.001, 0.002, 0.0005, 0.0015), strict=True)))
    finding = one(findings(assessment(curve("hand", 0.85), uncertainty=change)), AssessmentCode.INTERVALS)
    assert finding.figures == {**DRAWN, "effort": 0.002, "rest_length_mm": 0.5, "permissible_error_mm": 1.5}


@pytest.mark.parametrize(
    ("are_people_drawn", "code"), [(True, AssessmentCode.NO_COVARIANCE), (False, AssessmentCode.NO_INTERVALS)]
)
def test_the_reason_of_missing_intervals_is_given(*, are_people_drawn: bool, code: AssessmentCode) -> None:
    found = findings(assessment(curve("hand", 0.85)), are_people_drawn=are_people_drawn)
    assert one(found, code).code is code


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_frames_without_a_regular_solution_are_counted_by_outcome(outcome: FrameOutcome) -> None:
    found = findings(assessment(curve("hand", None), outcomes={outcome: 3}))
    assert (found[-1].code, found[-1].figures) == (OUTCOMES[outcome], {"frames": 3, "all_frames": 8})


@pytest.mark.parametrize("outcome", MUSCLE_OUTCOMES)
def test_frames_with_an_unconverged_muscle_are_counted_by_outcome_in_findings_and_file(outcome: MuscleOutcome) -> None:
    counted = assessment(curve("hand", 0.85), muscle_outcomes={outcome: 1})
    found = findings(counted)[-1]
    assert (found.code, found.figures) == (MUSCLE_OUTCOMES[outcome], {"frames": 1, "all_frames": 2})
    assert motion_entries(counted)["muscle_outcome_codes"] == {outcome: count(1)}


def test_every_outcome_but_solved_has_a_finding() -> None:
    assert set(OUTCOMES) == set(FrameOutcome) - {FrameOutcome.SOLVED}
    assert set(MUSCLE_OUTCOMES) == set(MuscleOutcome) - {MuscleOutcome.CONVERGED}


@pytest.mark.parametrize(
    ("has_cone", "code"), [(True, AssessmentCode.INFEASIBLE), (False, AssessmentCode.INFEASIBLE_WITHOUT_CONE)]
)
def test_the_sentence_on_infeasible_frames_has_the_glenoid_only_with_its_cone(
    *, has_cone: bool, code: AssessmentCode
) -> None:
    lost = replace(assessment(), outcomes={FrameOutcome.INFEASIBLE: 2}, has_glenoid_cone=has_cone)
    assert ("glenoid" in str(one(findings(lost), code))) == has_cone


@pytest.mark.parametrize(
    ("unsolved", "reported"),
    [
        ({}, []),
        (
            {"infeasible": 17, "suit_unusable.cuff_beyond_shoulder": 1},
            [(18, "infeasible 17, suit_unusable.cuff_beyond_shoulder 1")],
        ),
    ],
)
def test_drawn_people_without_a_solution_are_counted_by_outcome(
    unsolved: dict[str, int], reported: list[tuple[int, str]]
) -> None:
    drawn = summary({"at_reference": np.nan}, people=50, solved=50 - sum(unsolved.values()), unsolved=unsolved)
    found = findings(assessment(curve("hand", 0.8), uncertainty=drawn))
    figures = [finding.figures for finding in found if finding.code == AssessmentCode.PEOPLE_UNSOLVED]
    assert [(figure["unsolved"], figure["outcomes"]) for figure in figures] == reported
