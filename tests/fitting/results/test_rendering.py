"""Every code is rendered as a sentence, once."""

from __future__ import annotations

import re

from fitting.results.codes import Verdict
from fitting.results.rendering import verdict_sentence


def test_every_verdict_has_a_sentence_and_what_is_not_identified_says_what_to_do() -> None:
    sentences = {verdict: verdict_sentence(verdict) for verdict in Verdict}
    assert len(set(sentences.values())) == len(Verdict)
    for verdict, sentence in sentences.items():
        assert re.fullmatch(r"[a-z].*[^.]", sentence), verdict
        assert ("not identified" in sentence) == ("not_identified" in verdict)
        assert "; " in sentence or verdict in (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.NOT_UNLOADED), verdict
