"""Result of a run of the command line: exit code, both streams, and the code of its error."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


@dataclass(frozen=True)
class Ran:
    """error: the code of the error that ended the run; "" if there is none."""

    code: int
    out: str
    err: str
    error: str = ""


def assert_refused(ran: Ran, exit_code: int, code: StrEnum) -> None:
    """The run failed with this exit code and one line on stderr, the sentence of this code."""
    assert_one_sentence(ran, exit_code)
    assert ran.error == code, ran.err


def assert_one_sentence(ran: Ran, code: int, *words: str) -> None:
    """The run failed with this exit code and one line that contains these words."""
    assert ran.code == code, ran.err
    assert ran.out == ""
    assert ran.err.startswith("station: ")
    assert ran.err.count("\n") == 1
    for word in words:
        assert word in ran.err
