"""A message: a code for programs with its figures, which becomes a sentence for people at the very end.

A message to an operator states what happened, what it means and what to do, in the terms of the bench. A code and the
template of its sentence are one member of an enumeration; each subject has its own enumerations.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Generic, Self, TypeVar

from documents.interval import CountingFormatter


class Code(StrEnum):
    """A stable code for programs, with the template of its sentence: NAME = "code", "{figure:.1f} N, expected …".

    A code keeps its meaning for ever. A new one may be added; one that is no longer used stays, so that old files open.
    The part before its dot is the kind of the event, the part after it is the reason.
    """

    template: str

    def __new__(cls, code: str, template: str = "") -> Self:
        member = str.__new__(cls, code)
        member._value_ = code
        member.template = template
        return member


Code_co = TypeVar("Code_co", bound=Code, covariant=True)
Figures = Mapping[str, float | str]
"""Name, with the unit at its end, → number or name that the sentence shows."""


@dataclass(frozen=True)
class Message(Generic[Code_co]):
    """str() is the sentence. Raises KeyError there if a figure of the sentence is missing."""

    code: Code_co
    figures: Figures = field(default_factory=dict)

    def __str__(self) -> str:
        return _FORMATTER.vformat(self.code.template, (), self.figures)

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


def join_sentences(messages: Iterable[Message[Code]]) -> str:
    """The sentences of several messages as one text."""
    return "; ".join(map(str, messages))
