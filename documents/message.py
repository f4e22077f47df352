"""A message: a code for programs with its figures, which becomes a sentence for people at the very end.

A message to an operator states what happened, what it means and what to do, in the terms of the bench. A code and the
template of its sentence are one member of an enumeration; each subject has its own enumerations.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import EnumType, StrEnum
from types import MappingProxyType
from typing import Any, Generic, Self, TypeVar

from documents.interval import CountingFormatter

Figures = Mapping[str, float | str]
"""Name, with the unit at its end, → number or name that the sentence shows. A code is shown as its sentence."""
_SCALES = {"mm": 1e3, "ms": 1e3, "percent": 100.0, "per_minute": 60.0, "ppm": 1e6}
"""Unit in which a template shows an SI figure (`{shift_m:mm .2f}`) → factor."""


_CODE = re.compile(r"[a-z0-9_.]+")


class _CodeType(EnumType):
    """Put the code of a member, prefix and name, before its clauses, unless it has a code of its own there."""

    def __new__(
        metacls, name: str, bases: tuple[type, ...], namespace: Any, *, prefix: str | None = None, **options: Any
    ) -> Any:
        for member, value in namespace.items() if prefix is not None else ():
            clauses = (value,) if isinstance(value, str) else value
            if member.isupper() and not (len(clauses) > 1 and _CODE.fullmatch(clauses[0])):
                dict.__setitem__(namespace, member, (f"{prefix}{member.lower()}", *clauses))
        return super().__new__(metacls, name, bases, namespace, **options)


class Code(StrEnum, metaclass=_CodeType):
    """A stable code for programs, with the template of its sentence: NAME = "code", "{force_n:.1f} N, expected …".

    In an enumeration with a prefix, class SyncCode(Code, prefix="sync."), the code of NAME = "template" is sync.name.
    A code keeps its meaning for ever. A new one may be added; one that is no longer used stays, so that old files open.
    The part before its dot is the kind of the event, the part after it is the reason. Of several clauses, those whose
    figures are given are shown.
    """

    clauses: tuple[str, ...]

    def __new__(cls, code: str, *clauses: str) -> Self:
        member = str.__new__(cls, code)
        member._value_ = code
        member.clauses = clauses
        return member

    def sentence(self, figures: Figures = MappingProxyType({})) -> str:
        """A clause without capital or full stop in most cases. Raises KeyError if a figure is missing."""
        shown = [clause for clause in self.clauses if clause_fields(clause) <= figures.keys()]
        return "".join(_FORMATTER.vformat(clause, (), figures) for clause in shown or self.clauses[:1])


def clause_fields(clause: str) -> set[str]:
    """The figures that a clause shows."""
    return {field for _, field, _, _ in _FORMATTER.parse(clause) if field}


Code_co = TypeVar("Code_co", bound=Code, covariant=True)


@dataclass(frozen=True)
class Message(Generic[Code_co]):
    """str() is the sentence. Raises KeyError there if a figure of the sentence is missing."""

    code: Code_co
    figures: Figures = field(default_factory=dict)

    def __str__(self) -> str:
        return self.code.sentence(self.figures)

    def to_plain(self) -> dict[str, object]:
        """The code and its figures, as JSON."""
        return {"code": self.code.value, "figures": dict(self.figures)}

    @property
    def codes(self) -> tuple[str, ...]:
        """The code, and that of its cause where it has one."""
        cause = self.figures.get("reason_code")
        return (self.code.value, str(cause)) if cause else (self.code.value,)

    @property
    def kind(self) -> str:
        """The code without its reason: the kind of the event in a recording."""
        return self.code.value.partition(".")[0]


def because(cause: object) -> Figures:
    """Figures of the cause of a message, an error or another message: its sentence, and its code where it has one."""
    text = cause.strerror if isinstance(cause, OSError) and cause.strerror else str(cause)
    code = getattr(cause, "code", None)
    return {"reason": text, "reason_code": str(code)} if code else {"reason": text}


class _Formatter(CountingFormatter):
    """Shows an SI figure in the unit that the template names, a code as its sentence, and a minus sign as one."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Code):
            return value.sentence()
        unit, _, form = format_spec.rpartition(" ")
        is_scaled = unit in _SCALES
        text = super().format_field(_SCALES[unit] * value if is_scaled else value, form if is_scaled else format_spec)
        return f"−{text[1:]}" if re.fullmatch(r"-\d[\d.]*", text) else text


_FORMATTER = _Formatter()


def join_sentences(messages: Iterable[Message[Code]]) -> str:
    """The sentences of several messages as one text."""
    return "; ".join(map(str, messages))
