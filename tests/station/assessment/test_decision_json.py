"""The decision in assessment.json: a code for each outcome, figures, and the sentence that they make."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from solver.suit.assessment import UncertaintySummary
from solver.suit.decision import Basis, CuffDecision, DecisionRule, decide
from solver.uncertainty.indices import SobolIndices
from station.assessment.decision_json import DecisionEntry, percent, plain_decision, without_decision
from station.messages.codes import DecisionCode

RULE = DecisionRule()
SPREAD = np.linspace(-0.02, 0.02, 1001)
LOW = np.full(1001, 0.8)
SHARES = np.array([0.2, 0.7])
INDICES = {
    (f"difference_{basis}", ("hand", "tube")): SobolIndices(
        ("fit", "donning"), SHARES, SHARES / 2, SHARES, SHARES, 1.0, 64
    )
    for basis in ("at_reference", "at_best")
}


def summary(decisions: Mapping[Basis, CuffDecision]) -> UncertaintySummary:
    return UncertaintySummary(1001, 1001, 1, {}, ("fit", "body"), (0.9, 0.99), {}, decisions, RULE)


@pytest.mark.parametrize(
    ("efforts", "code", "sentence"),
    [
        (
            {"hand": LOW + 0.001, "tube": LOW},
            DecisionCode.EQUIVALENT,
            "At 0.740 m, tube and hand: equivalent within 2 points of effort (probability > 99 %); choose by comfort "
            "or migration.",
        ),
        (
            {"hand": LOW + 0.001, "tube": LOW, "elbow": LOW + 0.1},
            DecisionCode.EQUIVALENT_AND_WORSE,
            "At 0.740 m, tube and hand: equivalent within 2 points of effort (probability > 99 %), and each saves "
            "at least 2 points more than elbow; choose by comfort or migration.",
        ),
        (
            {"hand": LOW + 0.0385 + SPREAD, "tube": LOW},
            DecisionCode.CHOOSE,
            "At 0.740 m, choose tube: it saves at least 2 points of effort more than hand (probability 96 %).",
        ),
        (
            {"hand": LOW + 0.02 + SPREAD, "tube": LOW},
            DecisionCode.UNDECIDED,
            "At 0.740 m, undecided: tube has the least mean effort. It saves at least 2 points more than hand with a "
            "probability of 50 %, is equivalent to it with 50 %, and saves at least 2 points less with < 1 %.",
        ),
        ({"hand": LOW}, DecisionCode.ONLY_CUFF, "At 0.740 m, hand is the only cuff; there is no other to compare"),
        (
            {"hand": LOW * np.nan, "tube": LOW},
            DecisionCode.UNKNOWN,
            "At 0.740 m, no decision: only 0 of 1001 drawn people have a solution for every cuff.",
        ),
    ],
    ids=lambda value: value.value if isinstance(value, DecisionCode) else "",
)
def test_every_outcome_has_its_code_and_its_sentence(
    efforts: dict[str, np.ndarray], code: DecisionCode, sentence: str
) -> None:
    decision = decide(efforts, RULE)
    decisions: Any = {"at_reference": decision, "at_best": decision}
    plain = plain_decision(summary(decisions), INDICES, 0.74)
    entry = DecisionEntry.model_validate(plain)
    assert entry.at_reference.code is code
    assert entry.at_reference.text.startswith(sentence)
    settle = entry.at_reference.settle
    assert (settle is not None) == (code is DecisionCode.UNDECIDED)
    assert settle is None or settle.text == (
        "donning explains 70 % of the variance of hand − tube, the largest share; to reduce it, measure more donnings "
        "of each cuff."
    )
    assert entry.at_best.text.startswith("Each at its own best rest length, ")


def test_an_open_decision_without_indices_asks_for_them() -> None:
    decision = decide({"hand": LOW + 0.02 + SPREAD, "tube": LOW}, RULE)
    decisions: Any = {"at_reference": decision, "at_best": decision}
    settle = DecisionEntry.model_validate(plain_decision(summary(decisions), {}, 0.74)).at_reference.settle
    assert settle is not None and settle.code is DecisionCode.SETTLE_UNKNOWN
    assert settle.figures == {"first": "tube", "second": "hand"}


@pytest.mark.parametrize(("can_draw_people", "code"), [(True, DecisionCode.FIT_ONLY), (False, DecisionCode.NO_PEOPLE)])
def test_without_people_there_is_no_decision(*, can_draw_people: bool, code: DecisionCode) -> None:
    entry = DecisionEntry.model_validate(without_decision(can_draw_people=can_draw_people))
    assert (entry.contains, entry.people.value, entry.at_reference.code, entry.at_best.code) == ("fit", 0, code, code)


@pytest.mark.parametrize(("probability", "text"), [(1.0, "> 99"), (0.972, "97"), (0.004, "< 1"), (0.0, "< 1")])
def test_draws_do_not_resolve_certainty(probability: float, text: str) -> None:
    assert percent(probability) == text
