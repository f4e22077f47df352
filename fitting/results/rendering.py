"""Render codes with their figures as sentences. Programs use the codes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from string import Formatter
from types import MappingProxyType
from typing import Any

from fitting.results.codes import (
    EXPLAINED_BY,
    CauseCode,
    FindingCode,
    FitErrorCode,
    NoteCode,
    RejectionCode,
    TensorCode,
    TrialNoteCode,
    Verdict,
)
from fitting.results.sentences import NAMES, SENTENCES

Figures = Mapping[str, float | str]
"""Name → figure, in SI with the unit in the name."""


@dataclass(frozen=True)
class Note:
    """A code with its figures, in SI with the unit in the name; str() is the sentence."""

    code: NoteCode | TrialNoteCode | RejectionCode | TensorCode | FitErrorCode
    figures: Figures = field(default_factory=dict)

    def __str__(self) -> str:
        return sentence_of(self.code, self.figures)

    def to_plain(self) -> dict[str, object]:
        """The code and its figures, as JSON."""
        return {"code": self.code, "figures": dict(self.figures)}


_SCALES = {"mm": 1e3, "ms": 1e3, "percent": 100.0, "per_minute": 60.0, "ppm": 1e6}
"""Unit in which a template shows an SI figure (`{shift_m:mm .2f}`) → factor."""


def sentence_of(code: StrEnum, figures: Figures = MappingProxyType({})) -> str:
    """A code with its figures as a clause without capital or full stop. Raises KeyError if a figure is missing."""
    template = SENTENCES[code]
    if isinstance(template, str):
        return _FORMATTER.vformat(template, (), figures)
    return "".join(
        _FORMATTER.vformat(clause, (), figures) for clause in template if fields_of(clause) <= figures.keys()
    )


def name_of(code: CauseCode | FindingCode) -> str:
    """The name of a cause or a finding in a table."""
    return NAMES[code]


def verdict_sentences(verdicts: Iterable[Verdict], notes: Iterable[Note] = ()) -> tuple[str, ...]:
    """The verdicts as sentences. A note on a trial that ended early leads and replaces those that it explains."""
    causes = [note for note in notes if note.code in EXPLAINED_BY]
    explained = {verdict for note in causes for verdict in EXPLAINED_BY[note.code]}
    return (*map(str, causes), *(sentence_of(verdict) for verdict in verdicts if verdict not in explained))


def verdict_text(verdicts: Iterable[Verdict], notes: Iterable[Note] = ()) -> str:
    """All verdicts as one text."""
    return "; ".join(verdict_sentences(verdicts, notes))


def fields_of(clause: str) -> set[str]:
    """The figures that a clause shows."""
    return {field for _, field, _, _ in _FORMATTER.parse(clause) if field}


class _Scaled(Formatter):
    """Formats an SI figure in the unit that the template names, and a code as its sentence."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, StrEnum):
            return sentence_of(value)
        unit, _, form = format_spec.rpartition(" ")
        return format(_SCALES[unit] * value if unit else value, form)


_FORMATTER = _Scaled()
