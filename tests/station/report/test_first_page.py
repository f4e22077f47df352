"""The first page: effect of every cuff in words, the decision as assessed, and limits by their codes."""

from __future__ import annotations

from typing import Any

import pytest

from solver.suit.decision import DecisionRule
from station.assessment.assessment_json import CURVE_KEYS
from station.assessment.decision_json import undecided_by_fit
from station.assessment.total_json import with_total_intervals
from station.charts.marks import Band
from station.messages.codes import AssessmentCode
from station.messages.html import with_commands
from station.report.assessment_section import assessment_section, effort_figures
from station.report.first_page import BUNDLED_SUIT, findings_of, summary_of
from station.report.located import Source, located
from station.report.muscle_figures import cuffs_figure
from station.report.number_texts import entry_number, saving


def _assessment(**more: Any) -> Any:
    def optimum(effort: float | None) -> dict[str, Any]:
        return {
            "rest_length_m": _number(0.65),
            "normalised_cost": _number(effort),
            "permissible_error_m": _number(0.05),
        }

    plain = {
        "cost": {"rigid": _number(None), "hand": {"both": _number(None)}},
        "at_rigid_optimum": {"rigid": _number(0.88), "hand": {"both": _number(0.906, 0.83, 0.98)}},
        "optimum": {"rigid": optimum(0.87), "hand": {"both": optimum(0.865)}},
        "findings": ["tube has the least effort", "50 draws", "the cord pulls"],
        "finding_codes": [
            {"code": code, "figures": {}}
            for code in (AssessmentCode.LEAST_EFFORT, AssessmentCode.INTERVALS, AssessmentCode.CORD_FORCE)
        ],
        **more,
    }
    return located(plain, Source("assessment.json"))


def _number(value: float | None, *ci95: float) -> dict[str, Any]:
    return {"value": value, "ci95": list(ci95) or None}


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (_number(0.906), "9.4 % less effort"),
        (_number(0.906, 0.83, 0.98), "9.4 % less effort (2.0\u00a0to\u00a017.0)"),
        (_number(1.034, 1.01, 1.06), "3.4 % more effort (1.0\u00a0to\u00a06.0)"),
        (_number(0.906, 0.83, 0.98) | {"censored": "low"}, "9.4 % less effort (2.0\u00a0to\u00a0≥17.0)"),
        (_number(None), "effort not known"),
    ],
)
def test_an_effort_is_stated_as_the_change_from_the_slack_cord(number: dict[str, Any], text: str) -> None:
    assert str(saving(located(number, Source("assessment.json")))) == text


def test_the_first_page_has_every_cuff_the_theoretical_limit_and_the_decision_as_assessed() -> None:
    decision = undecided_by_fit(DecisionRule())
    summary = summary_of(_assessment(decision=decision), {})
    (effect,) = summary.effects
    assert (effect.cuff, str(effect.at_best), effect.best_rest_length_m) == ("hand", "13.5 % less effort", 0.65)
    assert str(summary.rigid) == "12.0 % less effort"
    assert summary.decision == (decision["at_reference"]["text"],), "the same sentence for both bases stands once"


def test_an_older_assessment_without_a_decision_has_its_choice() -> None:
    assert summary_of(_assessment(), {}).decision == ("tube has the least effort",)


def test_limits_are_listed_by_their_codes_and_apart_from_the_findings() -> None:
    assessment = _assessment()
    assert summary_of(assessment, {}).limits == ("50 draws", BUNDLED_SUIT)
    assert summary_of({**assessment, "subject": {"mass_kg": 75.0}}, {}).limits == ("50 draws",)
    assert findings_of(assessment) == ["tube has the least effort", "the cord pulls"]


@pytest.mark.parametrize(
    ("number", "digits", "text"),
    [
        (_number(0.7077431, 0.707691, 0.707822), 3, "0.708"),
        (_number(0.7077431, 0.7041, 0.7122), 3, "0.708 (0.704\u00a0to\u00a00.712)"),
        (_number(0.8534, 0.7142, 0.9913), 3, "0.85 (0.71\u00a0to\u00a00.99)"),
        (_number(None), 3, "–"),
    ],
)
def test_an_interval_of_the_fit_alone_gives_at_most_the_decimals_of_its_table(
    number: dict[str, Any], digits: int, text: str
) -> None:
    assert str(entry_number(located(number, Source("assessment.json")), digits=digits)) == text


def test_commands_of_a_sentence_are_code_and_the_rest_is_escaped() -> None:
    assert str(with_commands("a < b: run `station fit`")) == "a &lt; b: run <code>station fit</code>"


def test_with_drawn_people_the_page_has_their_intervals_and_bands() -> None:
    total = {
        "people": _number(100),
        "at_rigid_optimum": {"rigid": _number(0.88), "hand": {"both": _number(0.906, 0.7, 1.0)}},
        "cost": {"hand": {"both": {"value": [1.2, 0.87, 0.95], "ci95": [None, [0.7, 1.0], [0.8, 1.1]]}}},
    }
    curve = {"value": [1.2, 0.87, 0.95], "ci95": None}
    assessment = _assessment(
        total_uncertainty=total,
        cost={"rigid": curve, "hand": {"both": curve}},
        rest_lengths_m={"value": [0.6, 0.65, 0.7]},
        reference_rest_length_m=_number(0.7),
    )
    shown = with_total_intervals(assessment)
    assert str(summary_of(shown, {}).effects[0].at_reference) == "9 % less effort (0\u00a0to\u00a030)"
    assert str(summary_of(assessment, {}).effects[0].at_reference) == "9.4 % less effort (2.0\u00a0to\u00a017.0)"
    assert shown["optimum"] == assessment["optimum"], "figures that the people do not have stay as they are"
    ((panel,),) = cuffs_figure(shown).columns
    (band,) = (mark for mark in panel.marks if isinstance(mark, Band))
    assert band.high.tolist()[1:] == [1.0, 1.1] and panel.y_limits[0] is not None and panel.y_limits[0] < 0.7
    ((panel,),) = cuffs_figure({**assessment, "total_uncertainty": None}).columns
    assert not any(isinstance(mark, Band) for mark in panel.marks)


@pytest.mark.parametrize(("inputs", "is_advised"), [({}, True), ({"tendons": "elastic"}, False)])
def test_people_are_advised_only_where_they_can_be_drawn(inputs: dict[str, str], is_advised: bool) -> None:
    (figure,) = effort_figures(_assessment(inputs=inputs))
    assert ("--people" in str(figure.caption)) is is_advised


@pytest.mark.parametrize(
    ("more", "named", "is_of_cuffs_alone"),
    [
        ({"uncertainty": {"sources": ["cuffs"]}}, {"cuffs"}, True),
        ({"uncertainty": {"sources": ["cuffs", "motions"]}}, {"cuffs", "posture"}, False),
        ({"uncertainty": {"sources": ["motions"]}}, {"posture"}, False),
        ({"uncertainty": {"draws": _number(50)}}, {"cuffs"}, True),
        ({"uncertainty": {"draws": _number(50)}, "subject": {}}, {"cuffs"}, True),
        ({"uncertainty": {"draws": _number(50)}, "subject": {"mass_kg": 1.0}}, {"cuffs", "posture"}, False),
        ({"uncertainty": None}, set(), False),
    ],
)
def test_the_section_on_the_suit_names_what_its_intervals_contain(
    more: dict[str, Any], named: set[str], *, is_of_cuffs_alone: bool
) -> None:
    columns = {key: {"rigid": _number(1.0), "hand": {"both": _number(1.0)}} for key in CURVE_KEYS.values()}
    section = assessment_section(_assessment(inputs={}, **columns, **more), (), ())
    assert {word for word in ("cuffs", "posture") if word in section.intervals} == named
    assert section.only_cuffs_drawn == is_of_cuffs_alone
