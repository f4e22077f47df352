"""A message to the operator: a code for programs, rendered as a sentence for people at the very end.

A message states what happened, what it means and what to do, in the terms of the bench. Its template is found here by
its code; the templates of a subject are in one file of this folder.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Generic, TypeVar

from documents.interval import CountingFormatter
from station.messages.assessment_messages import ASSESSMENT, ASSESSMENT_FILE, DECISIONS
from station.messages.emg_messages import EMG
from station.messages.file_messages import FILES
from station.messages.kinematics_messages import KINEMATICS, PERSON_SENTENCES, SUBJECT, WEARER_SENTENCES
from station.messages.live_messages import LIVE
from station.messages.session_sentences import SESSION
from station.messages.setup_messages import SETUP
from station.messages.study_messages import STUDY, SWEEPS, VALIDATION

Code_co = TypeVar("Code_co", bound=StrEnum, covariant=True)
Figures = Mapping[str, float | str]
"""Name, with the unit at its end, → number or name that the sentence shows."""
SENTENCES: Mapping[StrEnum, str] = {
    **SESSION,
    **KINEMATICS,
    **PERSON_SENTENCES,
    **ASSESSMENT,
    **ASSESSMENT_FILE,
    **DECISIONS,
    **EMG,
    **FILES,
    **LIVE,
    **SETUP,
    **STUDY,
    **SUBJECT,
    **SWEEPS,
    **VALIDATION,
    **WEARER_SENTENCES,
}
"""Code → template, filled with the figures of the message."""


@dataclass(frozen=True)
class Message(Generic[Code_co]):
    """str() is the sentence. Raises KeyError there if a figure of the sentence is missing."""

    code: Code_co
    figures: Figures = field(default_factory=dict)

    def __str__(self) -> str:
        return _FORMATTER.vformat(SENTENCES[self.code], (), self.figures)

    def to_plain(self) -> dict[str, object]:
        """The code and its figures, as JSON."""
        return {"code": self.code.value, "figures": dict(self.figures)}

    @property
    def codes(self) -> tuple[str, ...]:
        """The code, and that of its cause where there is one: the error of a device."""
        cause = self.figures.get("code")
        return (self.code.value, str(cause)) if cause else (self.code.value,)

    @property
    def kind(self) -> str:
        """The code without its reason: the kind of the event in a recording."""
        return self.code.value.partition(".")[0]


class _WithMinusSigns(CountingFormatter):
    """Negative figures have a minus sign in the sentence and a hyphen in the JSON."""

    def format_field(self, value: Any, format_spec: str) -> str:
        text = super().format_field(value, format_spec)
        return f"−{text[1:]}" if re.fullmatch(r"-\d[\d.]*", text) else text


_FORMATTER = _WithMinusSigns()


def join_sentences(messages: Iterable[Message[StrEnum]]) -> str:
    """The sentences of several messages as one text."""
    return "; ".join(map(str, messages))
