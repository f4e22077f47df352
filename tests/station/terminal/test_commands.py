"""Commands as lines and as keys."""

from __future__ import annotations

import pytest

from station.messages.codes import CommandCode
from station.terminal.commands import KEYS, MEANINGS, Action, Command, UnknownCommand, parse_command
from station.terminal.keyboard import KeyParser
from tests.station.refusals import raises_refusal


@pytest.mark.parametrize(
    ("line", "command"),
    [
        ("keep", Command(Action.KEEP)),
        ("  k \r", Command(Action.KEEP)),
        ("redo the wearer coughed", Command(Action.REDO, "the wearer coughed")),
        ("R", Command(Action.REDO)),
        ("redon", Command(Action.REDON)),
        ("skip", Command(Action.SKIP)),
        ("?", Command(Action.HELP)),
    ],
)
def test_a_line_is_a_word_or_its_letter_and_a_reason(line: str, command: Command) -> None:
    assert parse_command(line) == command


@pytest.mark.parametrize(
    ("line", "code"), [("jump", CommandCode.UNKNOWN_COMMAND), ("keep it", CommandCode.UNEXPECTED_ARGUMENT)]
)
def test_a_line_that_is_not_a_command_is_refused(line: str, code: CommandCode) -> None:
    with raises_refusal(UnknownCommand, code):
        parse_command(line)


def test_every_command_has_a_unique_key_and_a_description() -> None:
    assert set(KEYS.values()) == set(Action) == set(MEANINGS)


def test_the_reason_of_a_redo_is_typed_and_escape_discards_it() -> None:
    shown: list[str | None] = []
    keys = KeyParser(shown.append)
    assert keys.feed("r") == [] and keys.feed("ab") == [] and keys.feed("\x7f") == []
    assert shown == ["", "a", "ab", "a"]
    assert keys.feed("\n") == [Command(Action.REDO, "a")] and shown[-1] is None
    assert keys.feed("d") == [] and keys.feed("\x1b") == []
    assert keys.feed("k") == [Command(Action.KEEP)], "what is typed is a key again"


def test_arrows_are_ignored_enter_arms_and_an_unknown_key_is_refused() -> None:
    keys = KeyParser(lambda _: None)
    assert keys.feed("\x1b[A") == []
    assert keys.feed("\r") == [Command(Action.ARM)]
    (unknown,) = keys.feed("z")
    assert isinstance(unknown, UnknownCommand) and unknown.code == CommandCode.UNKNOWN_KEY
    assert keys.feed("\x00") == []
