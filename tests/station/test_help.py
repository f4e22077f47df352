"""The help of every verb shows its texts as they are written, with the units in square brackets."""

from __future__ import annotations

import inspect
import subprocess
import sys
from itertools import pairwise
from typing import get_type_hints

import pytest
from typer.models import ParameterInfo

from station.cli import VERBS
from tests.station.command import help_of


@pytest.mark.parametrize("verb", VERBS)
def test_a_help_text_is_shown_as_it_is_written(verb: str) -> None:
    shown = _compact(help_of(verb, 400))
    for text in _help_texts(verb):
        assert _compact(text) in shown


@pytest.mark.parametrize("verb", VERBS)
def test_a_paragraph_of_a_help_text_breaks_only_where_the_line_is_full(verb: str) -> None:
    width = 100
    shown = help_of(verb, width)
    text = shown.partition("╭")[0].partition("Usage:")[2].partition("\n")[2]
    lines = [line.strip() for line in text.splitlines()]
    for line, following in pairwise(lines):
        if line and following:
            assert len(f" {line} {following.split()[0]} ") > width, line


def test_there_are_units_in_square_brackets() -> None:
    assert "Start time [s]." in _help_texts("id")


@pytest.mark.parametrize("module", ["station", "station.cli"])
def test_the_command_runs_under_both_names_of_its_module(module: str) -> None:
    command = [sys.executable, "-m", module, "--version"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout  # noqa: S603  (our own)
    assert shown.startswith("cuffstation ")


def _help_texts(verb: str) -> list[str]:
    """Docstring and visible options of the function, which the rendered help does not go through."""
    written = [inspect.getdoc(VERBS[verb]) or ""]
    for hint in get_type_hints(VERBS[verb], include_extras=True).values():
        for described in getattr(hint, "__metadata__", ()):
            if isinstance(described, ParameterInfo) and described.help and not described.hidden:
                written.append(described.help)
    return written


def _compact(text: str) -> str:
    """Without white space and the frame of a table, so that lines may break anywhere."""
    return "".join(text.replace("│", " ").split())
