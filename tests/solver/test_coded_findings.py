"""The part of a repr that lists the codes of findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from solver.coded_findings import describe_codes


class Code(StrEnum):
    LENGTH = "rest_length.best"
    MODEL = "model.left_out"


@dataclass(frozen=True)
class Found:
    code: Code
    figures: Mapping[str, float | str] = field(default_factory=dict)


def test_a_code_that_several_findings_have_is_listed_once() -> None:
    found = [Found(Code.LENGTH), Found(Code.MODEL), Found(Code.LENGTH)]
    assert describe_codes(found) == "; findings: rest_length.best, model.left_out"
    assert describe_codes([]) == ""
