"""Every code is rendered as a sentence, once."""

from __future__ import annotations

import re

import pytest

from fitting.results.codes import CauseCode, FindingCode, GainMistake, TrialNoteCode, Verdict
from fitting.results.sentences import SENTENCES, Figures, fields_of, name_of, sentence_of

NAMED = (*CauseCode, *FindingCode)
TEXTS = {
    *("at", "before", "cuff", "damage", "device_errors", "file", "found", "law", "marker", "markers", "method"),
    *("missing", "mistake", "name", "outcome", "present", "problem", "quantity", "reason", "recorded_as"),
    *("recording", "simulated", "stream", "test", "unit", "verdict"),
    *FindingCode,
}
"""Figures that are text."""


def test_every_verdict_has_a_sentence_and_what_is_not_identified_says_what_to_do() -> None:
    sentences = {verdict: sentence_of(verdict) for verdict in Verdict}
    assert len(set(sentences.values())) == len(Verdict)
    for verdict, sentence in sentences.items():
        assert re.fullmatch(r"[a-z].*[^.]", sentence), verdict
        assert ("not identified" in sentence) == ("not_identified" in verdict)
        assert "; " in sentence or verdict in (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.NOT_UNLOADED), verdict


def test_every_code_is_rendered_with_all_of_its_figures() -> None:
    for code, template in SENTENCES.items():
        assert set(type(code)) <= SENTENCES.keys(), "no code without a sentence"
        clauses = (template,) if isinstance(template, str) else template
        names = set().union(*map(fields_of, clauses))
        figures: Figures = {name: f"<{name}>" if name in TEXTS else 0.0125 for name in names}
        sentence = sentence_of(code, figures)
        assert "{" not in sentence
        assert all(f"<{name}>" in sentence for name in names & TEXTS)


def test_every_cause_and_every_finding_has_its_own_name() -> None:
    assert len({name_of(code) for code in NAMED}) == len(NAMED)


def test_a_figure_is_shown_in_the_unit_of_its_place_and_a_clause_without_its_figures_is_left_out() -> None:
    figures = {"value": -0.012, "standard_error": 1e-5}
    alone = sentence_of(FindingCode.START, figures)
    assert "-12.00 ± 0.01 mm" in alone
    assert sentence_of(FindingCode.START, {**figures, "force_n": 102.24}).startswith(alone)
    assert "+102.2 N" in sentence_of(FindingCode.START, {**figures, "force_n": 102.24})
    assert "62 %" in sentence_of(CauseCode.CREEP, {"law": "creep", "gain": 0.62})
    with pytest.raises(KeyError):
        sentence_of(FindingCode.CURVATURE, {})


def test_a_code_among_the_figures_is_shown_as_its_sentence() -> None:
    figures: Figures = {"file": "a", "gain": 2.0, "mass_kg": 1.0, "mistake": GainMistake.CAPACITY_DOUBLED}
    assert sentence_of(GainMistake.CAPACITY_DOUBLED) in sentence_of(TrialNoteCode.BOUNCE_GAIN, figures)
