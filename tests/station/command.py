"""The command line in this process: exit code, both streams, the code of an error; and the help of a verb."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cache

import pytest
import typer.main
from typer.testing import CliRunner

from station.cli import app

command_of = cache(typer.main.get_command)  # typer builds the commands of all verbs anew at every call


@dataclass(frozen=True)
class Ran:
    """error: the code of the error that ended the run; "" if there is none."""

    code: int
    out: str
    err: str
    error: str = ""


Station = Callable[..., Ran]
"""The fixture `station` of conftest.py: runs a verb with these arguments."""


def assert_refused(ran: Ran, exit_code: int, code: StrEnum, *words: str) -> None:
    """The run failed with this exit code and one line on stderr, the sentence of this code with these words."""
    assert_one_sentence(ran, exit_code, *words)
    assert ran.error == code, ran.err


def assert_one_sentence(ran: Ran, code: int, *words: str) -> None:
    """The run failed with this exit code and one line that contains these words."""
    assert ran.code == code, ran.err
    assert ran.out == ""
    assert ran.err.startswith("station: ")
    assert ran.err.count("\n") == 1
    for word in words:
        assert word in ran.err


def help_of(verb: str, columns: int) -> str:
    """What --help prints on a terminal of so many columns."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("typer.testing._get_command", command_of)
        ran = CliRunner().invoke(app, [verb, "--help"], env={"COLUMNS": str(columns), "TERM": "dumb"})
    assert ran.exit_code == 0
    return ran.stdout
