"""Commands as lines and as keys."""

from __future__ import annotations

import pytest

from station.terminal.commands import KEYS, MEANINGS, Action, Command, UnknownCommand, parse_command
from station.terminal.keyboard import KeyParser, LineParser


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


@pytest.mark.parametrize(("line", "words"), [("jump", "no command is 'jump'"), ("keep it", "keep takes nothing after")])
def test_what_is_no_command_is_a_sentence(line: str, words: str) -> None:
    with pytest.raises(UnknownCommand, match=words):
        parse_command(line)


def test_every_command_has_a_key_of_its_own_and_a_meaning() -> None:
    assert set(KEYS.values()) == set(Action) == set(MEANINGS)


def test_a_redo_asks_for_its_reason_and_escape_drops_it() -> None:
    shown: list[str | None] = []
    keys = KeyParser(shown.append)
    assert keys.feed("r") == [] and keys.feed("ab") == [] and keys.feed("\x7f") == []
    assert shown == ["", "a", "ab", "a"]
    assert keys.feed("\n") == [Command(Action.REDO, "a")] and shown[-1] is None
    assert keys.feed("d") == [] and keys.feed("\x1b") == []
    assert keys.feed("k") == [Command(Action.KEEP)], "what is typed is a key again"


def test_arrows_mean_nothing_enter_arms_and_an_unknown_key_is_told() -> None:
    keys = KeyParser(lambda _: None)
    assert keys.feed("\x1b[A") == []
    assert keys.feed("\r") == [Command(Action.ARM)]
    (unknown,) = keys.feed("z")
    assert isinstance(unknown, UnknownCommand)
    assert keys.feed("\x00") == []


def test_a_pipe_gives_lines_in_any_pieces_and_bytes_that_are_no_text_are_no_command() -> None:
    lines = LineParser()
    assert lines.feed(b"ke") == []
    assert lines.feed(b"ep\n\nskip\nre") == [Command(Action.KEEP), Command(Action.SKIP)]
    assert lines.feed(b"do it \xc3\xbc\n") == [Command(Action.REDO, "it ü")]
    (unknown,) = lines.feed(b"\xff\xfe\n")
    assert isinstance(unknown, UnknownCommand)
