"""Findings of a result: the solver adds none, the station those that its terminal prints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Protocol


class CodedFinding(Protocol):
    """A stable code and the figures of its sentence, which str() renders."""

    @property
    def code(self) -> StrEnum: ...

    @property
    def figures(self) -> Mapping[str, float | str]: ...


def describe_codes(findings: Iterable[CodedFinding]) -> str:
    """The last part of a repr: every code once; empty without findings."""
    codes = ", ".join(dict.fromkeys(finding.code for finding in findings))
    return f"; findings: {codes}" if codes else ""
