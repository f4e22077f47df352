"""Findings follow from the intervals, and an unknown figure is never a number."""

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


def test_a_cuff_is_chosen_by_differences_with_their_signs() -> None:
    choice, comparison, *_ = compared(0.04, (0.035, 0.045))
    assert choice.code is AssessmentCode.LEAST_EFFORT
    assert choice.figures == {"cuff": "tube", "effort": 0.84, "at_m": 0.74, "cuffs": "hand, tube"}
    assert comparison.code is AssessmentCode.DIFFERENT
    assert str(comparison) == "hand − tube: +4.00 % effort at 0.740 m (95 % CI +3.50 to +4.50 %)."
    finding = compared(-0.04, (-0.045, -0.035))[1]
    found = [finding.figures[name] for name in ("difference_percent", "low_percent", "high_percent")]
    assert found == ["-4.00", "-4.50", "-3.50"]
    assert "−4.00 % effort at 0.740 m (95 % CI −4.50 to −3.50 %)" in str(finding)
    assert findings(assessment(curve("hand", 0.85)))[0].code is AssessmentCode.ONLY_CUFF
    assert findings(assessment(curve("hand", None)))[0].code is AssessmentCode.NO_CHOICE


@pytest.mark.parametrize(
    ("value", "ci95", "code"),
    [(0.01, (-0.005, 0.025), AssessmentCode.NOT_DISTINGUISHED), (0.004, (0.0039, 0.0041), AssessmentCode.NOT_RELEVANT)],
)
def test_an_equivalent_cuff_is_named(value: float, ci95: tuple[float, float], code: AssessmentCode) -> None:
    choice, comparison, *_ = compared(value, ci95)
    assert (choice.code, choice.figures["equivalent"]) == (AssessmentCode.EQUIVALENT, "hand")
    assert comparison.code is code


@pytest.mark.parametrize(
    ("value", "code"), [(0.01, AssessmentCode.WITHOUT_INTERVAL), (None, AssessmentCode.NOT_COMPARED)]
)
def test_an_unknown_difference_or_interval_has_a_code(value: float | None, code: AssessmentCode) -> None:
    assert compared(value, None)[1].code is code


def migrated(condition: str = "both", lost: float = 0.2, cost: float = 3.2, ci95: tuple[float, float] | None = None):
    plain = with_figures(curve("hand", 0.83, condition), cord_force_lost=lost)
    return replace(plain, figures=plain.figures | {"cost_per_arm_migration": Quantity(cost, ci95)})


def with_reserves(cost: float) -> Assessment:
    return assessment(replace(curve("hand", 0.85), reserve_cost=np.array([4.0, cost])))


MIGRATED = migrated("shift", 0.3, 1.6), migrated()
RIGID = with_figures(curve(None, 0.79, "rigid"), to_slack=0.113, cord_force=54.0)
COST = {"cuff": "hand", "cuffs": "hand", "lost_percent": 20.0, "percent_per_cm": "+3.2"}
READOUTS = ("at_reference", "lowest_cost", "rest_length", "permissible_error")
UNKNOWN = replace(curve("hand", None), reserve_cost=np.full(2, np.nan))


@pytest.mark.parametrize(
    ("assessed", "code", "figures"),
    [
        (
            assessment(with_figures(curve("hand", 0.85), lowest_cost=0.7852, rest_length=0.692), curve("tube", 0.84)),
            AssessmentCode.BEST_REST_LENGTH,
            {"cuff": "hand", "effort": 0.7852, "at_m": 0.692},
        ),
        (assessment(*MIGRATED), AssessmentCode.MIGRATION_COST_ALONE, COST),
        (
            assessment(*MIGRATED, waist_cuff="belt"),
            AssessmentCode.MIGRATION_COST_ALONE,
            COST | {"cuffs": "hand and the belt cuff"},
        ),
        (
            assessment(migrated(cost=2.3, ci95=(-0.41, 8.27))),
            AssessmentCode.MIGRATION_COST_OPEN,
            {"low_per_cm": "-0.4", "high_per_cm": "+8.3"},
        ),
        (
            assessment(migrated(cost=2.3, ci95=(0.17, 5.65))),
            AssessmentCode.MIGRATION_COST,
            {"low_per_cm": "+0.2", "high_per_cm": "+5.7"},
        ),
        (
            replace(assessment(), curves=(RIGID,)),
            AssessmentCode.CORD_FORCE,
            {"force_n": 54.0, "slack_cm": pytest.approx(11.3), "slack_m": 0.87},
        ),
        (assessment(curve("hand", 0.85)), AssessmentCode.OUTSIDE_RANGE, {"first_m": 0.6, "last_m": 0.75}),
        (with_reserves(0.0012), AssessmentCode.RESERVES_SMALL, {"effort": 0.0012, "at_m": 0.75}),
        (with_reserves(3.0), AssessmentCode.RESERVES_LARGE, {"effort": 3.0, "at_m": 0.75}),
        (
            assessment(UNKNOWN, uncertainty=summary(dict.fromkeys(READOUTS, np.nan))),
            AssessmentCode.INTERVALS_UNVERIFIED,
            DRAWN,
        ),
        (
            assessment(
                curve("hand", 0.85),
                uncertainty=summary(dict(zip(READOUTS, (0.001, 0.002, 0.0005, 0.0015), strict=True))),
            ),
            AssessmentCode.INTERVALS,
            {**DRAWN, "effort": 0.002, "rest_length_mm": 0.5, "permissible_error_mm": 1.5},
        ),
    ],
    ids=lambda value: value.name if isinstance(value, AssessmentCode) else "",
)
def test_a_finding_has_its_figures(assessed: Assessment, code: AssessmentCode, figures: dict[str, object]) -> None:
    found = findings(assessed)
    given = one(found, code).figures
    if code in (AssessmentCode.MIGRATION_COST, AssessmentCode.MIGRATION_COST_OPEN):
        given = {name: given[name] for name in figures}  # the interval, whose cost has rows of its own
    assert given == figures
    assert not any("nan" in str(finding) for finding in found), "what is unknown is never a number"
    assert code is not AssessmentCode.RESERVES_LARGE or "--effort" in str(one(found, code)), "its remedy"


def test_best_rest_lengths_inside_the_range_need_no_explanation() -> None:
    rigid, arm = curve(None, 0.79, "rigid"), curve("a", 0.8)
    inside = tuple(with_figures(plain, rest_length=0.7, permissible_error=0.04) for plain in (rigid, arm))
    assert AssessmentCode.OUTSIDE_RANGE not in [found.code for found in findings(replace(assessment(), curves=inside))]


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
def test_infeasible_frames_are_of_the_glenoid_only_with_its_cone(*, has_cone: bool, code: AssessmentCode) -> None:
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
def test_drawn_people_without_a_solution_are_counted(unsolved: dict[str, int], reported: list[tuple[int, str]]) -> None:
    drawn = summary({"at_reference": np.nan}, people=50, solved=50 - sum(unsolved.values()), unsolved=unsolved)
    found = findings(assessment(curve("hand", 0.8), uncertainty=drawn))
    figures = [finding.figures for finding in found if finding.code == AssessmentCode.PEOPLE_UNSOLVED]
    assert [(figure["unsolved"], figure["outcomes"]) for figure in figures] == reported
