"""A note: what a reader should know before believing a figure."""

from __future__ import annotations

from dataclasses import dataclass, field

from fitting.results.codes import NoteCode
from fitting.results.rendering import Figures, sentence_of


@dataclass(frozen=True)
class Note:
    """A code with its figures, in SI with the unit in the name; str() is the sentence."""

    code: NoteCode
    figures: Figures = field(default_factory=dict)

    def __str__(self) -> str:
        return sentence_of(self.code, self.figures)
