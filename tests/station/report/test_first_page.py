"""The first page: effect of every cuff in words, the decision as assessed, and limits by their codes."""

from __future__ import annotations

from typing import Any

import pytest

from solver.suit.decision import DecisionRule
from station.assessment.decision_json import undecided_by_fit
from station.messages.codes import AssessmentCode
from station.report.first_page import BUNDLED_SUIT, findings_of, summary_of
from station.report.number_texts import counted, saving_text


def _assessment(**more: Any) -> dict[str, Any]:
    def optimum(effort: float | None) -> dict[str, Any]:
        return {
            "rest_length_m": _number(0.65),
            "normalised_cost": _number(effort),
            "permissible_error_m": _number(0.05),
        }

    return {
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
def test_an_effort_is_told_as_the_change_from_the_slack_cord(number: dict[str, Any], text: str) -> None:
    assert saving_text(number) == text


def test_the_first_page_has_every_cuff_the_theoretical_limit_and_the_decision_as_assessed() -> None:
    decision = undecided_by_fit(DecisionRule())
    summary = summary_of(_assessment(decision=decision), {})
    (effect,) = summary.effects
    assert (effect.cuff, effect.at_best, effect.best_rest_length_m) == ("hand", "13.5 % less effort", 0.65)
    assert summary.rigid == "12.0 % less effort"
    assert summary.decision == (decision["at_reference"]["text"],), "the same sentence for both bases stands once"


def test_an_older_assessment_without_a_decision_has_its_choice() -> None:
    assert summary_of(_assessment(), {}).decision == ("tube has the least effort",)


def test_limits_are_told_by_their_codes_and_apart_from_the_findings() -> None:
    assessment = _assessment()
    assert summary_of(assessment, {}).limits == ("50 draws", BUNDLED_SUIT)
    assert summary_of({**assessment, "subject": {"mass_kg": 75.0}}, {}).limits == ("50 draws",)
    assert findings_of(assessment) == ["tube has the least effort", "the cord pulls"]


def test_one_is_singular() -> None:
    assert (counted(1, "cuff"), counted(3, "cuff")) == ("1 cuff", "3 cuffs")
