"""Every code is rendered as a sentence, once."""

from __future__ import annotations

import re
from enum import StrEnum

import pytest

from fitting.results.codes import CauseCode, FindingCode, NoteCode, Verdict
from fitting.results.note import Note
from fitting.results.rendering import _SENTENCES, Figures, fields_of, name_of, sentence_of


def test_every_verdict_has_a_sentence_and_what_is_not_identified_says_what_to_do() -> None:
    sentences = {verdict: sentence_of(verdict) for verdict in Verdict}
    assert len(set(sentences.values())) == len(Verdict)
    for verdict, sentence in sentences.items():
        assert re.fullmatch(r"[a-z].*[^.]", sentence), verdict
        assert ("not identified" in sentence) == ("not_identified" in verdict)
        assert "; " in sentence or verdict in (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.NOT_UNLOADED), verdict


CODES = (*CauseCode, *FindingCode)


@pytest.mark.parametrize("code", CODES)
def test_every_cause_and_every_finding_has_its_own_name_and_shows_all_of_its_figures(code: StrEnum) -> None:
    template = _SENTENCES[code]
    clauses = (template,) if isinstance(template, str) else template
    names = set().union(*map(fields_of, clauses))
    texts = {"name", "law", "marker", *FindingCode}
    figures: Figures = {name: f"<{name}>" if name in texts else 0.0125 for name in names}
    sentence = sentence_of(code, figures)
    assert "{" not in sentence
    assert all(f"<{name}>" in sentence for name in names & texts)
    assert len({name_of(each) for each in CODES}) == len(CODES)


def test_a_figure_is_shown_in_the_unit_of_its_place_and_a_clause_without_its_figures_is_left_out() -> None:
    figures = {"value": -0.012, "standard_error": 1e-5}
    alone = sentence_of(FindingCode.START, figures)
    assert "-12.00 ± 0.01 mm" in alone
    assert sentence_of(FindingCode.START, {**figures, "force_n": 102.24}) == f"{alone}{FORCE}"
    assert "62 %" in sentence_of(CauseCode.CREEP, {"law": "creep", "gain": 0.62})
    with pytest.raises(KeyError):
        sentence_of(FindingCode.CURVATURE, {})


FORCE = "; with x counted from that zero F − k x would be off by +102.2 N"


@pytest.mark.parametrize("code", NoteCode)
def test_every_note_is_rendered(code: NoteCode) -> None:
    names = fields_of(_SENTENCES[code])
    figures: Figures = {name: f"<{name}>" if name in NOTE_TEXTS else 0.0125 for name in names}
    sentence = str(Note(code, figures))
    assert "{" not in sentence
    assert all(f"<{name}>" in sentence for name in names & NOTE_TEXTS)


NOTE_TEXTS = {"file", "before", "simulated", "at"}
