"""Every code is rendered as a sentence, once."""

import re

import pytest

from documents.message import Code, Figures, clause_fields
from fitting.results.codes import CauseCode, FindingCode, FitErrorCode, NoteCode, Verdict
from fitting.results.sentences import NAMES
from fitting.results.trial_codes import RejectionCode, TensorCode, TrialNoteCode
from fitting.trial.calibration import GainMistake

CODES: tuple[Code, ...] = (
    *(*Verdict, *CauseCode, *FindingCode, *NoteCode, *FitErrorCode),
    *(*RejectionCode, *TrialNoteCode, *TensorCode, *GainMistake),
)
TEXTS = {
    *("at", "before", "cuff", "damage", "device_errors", "file", "found", "law", "marker", "markers", "method"),
    *("missing", "mistake", "name", "outcome", "present", "problem", "quantity", "reason", "recorded_as"),
    *("recording", "simulated", "stream", "test", "unit", "verdict"),
    *FindingCode,
}
"""Figures that are text."""


def test_every_verdict_has_a_sentence_and_what_is_not_identified_says_what_to_do() -> None:
    sentences = {verdict: verdict.sentence() for verdict in Verdict}
    assert len(set(sentences.values())) == len(Verdict)
    for verdict, sentence in sentences.items():
        assert re.fullmatch(r"[a-z].*[^.]", sentence), verdict
        assert ("not identified" in sentence) == ("not_identified" in verdict)
        assert "; " in sentence or verdict in (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.NOT_UNLOADED), verdict


def test_every_code_is_rendered_with_all_of_its_figures_and_every_cause_and_finding_has_its_own_name() -> None:
    for code in CODES:
        names = set().union(*map(clause_fields, code.clauses))
        figures: Figures = {name: f"<{name}>" if name in TEXTS else 0.0125 for name in names}
        sentence = code.sentence(figures)
        assert sentence and "{" not in sentence
        assert all(f"<{name}>" in sentence for name in names & TEXTS)
    assert len({NAMES[code] for code in (*CauseCode, *FindingCode)}) == len(CauseCode) + len(FindingCode)


def test_a_figure_is_shown_in_the_unit_of_its_place_and_a_clause_without_its_figures_is_left_out() -> None:
    figures = {"value": -0.012, "standard_error": 1e-5}
    alone = FindingCode.START.sentence(figures)
    assert "−12.00 ± 0.01 mm" in alone
    assert FindingCode.START.sentence({**figures, "force_n": 102.24}).startswith(alone)
    assert "+102.2 N" in FindingCode.START.sentence({**figures, "force_n": 102.24})
    assert "62 %" in CauseCode.CREEP.sentence({"law": "creep", "gain": 0.62})
    with pytest.raises(KeyError):
        FindingCode.CURVATURE.sentence({})
    figures: Figures = {"file": "a", "gain": 2.0, "mass_kg": 1.0, "mistake": GainMistake.CAPACITY_DOUBLED}
    assert GainMistake.CAPACITY_DOUBLED.sentence() in TrialNoteCode.BOUNCE_GAIN.sentence(figures)
