"""Commands as lines and as keys."""

import pytest

from station.messages.session_messages import CommandCode
from station.terminal.commands import KEYS, Action, Command, KeyParser, UnknownCommand, parse_command
from tests.refusals import raises_refusal


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
        ("next #5", Command(Action.NEXT, trial=5)),
        ("skip #5", Command(Action.SKIP, trial=5)),
        ("redo #5 the wearer coughed", Command(Action.REDO, "the wearer coughed", 5)),
        ("redo 2 weights fell off", Command(Action.REDO, "2 weights fell off")),
    ],
)
def test_a_line_is_a_word_or_its_letter_with_a_trial_and_a_reason(line: str, command: Command) -> None:
    assert parse_command(line) == command


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("jump", CommandCode.UNKNOWN_COMMAND),
        ("keep it", CommandCode.UNEXPECTED_ARGUMENT),
        ("keep #5", CommandCode.UNEXPECTED_ARGUMENT),
        ("next", CommandCode.TRIAL_NUMBER_EXPECTED),
        ("skip hand", CommandCode.TRIAL_NUMBER_EXPECTED),
    ],
)
def test_a_line_that_is_not_a_command_is_refused(line: str, code: CommandCode) -> None:
    with raises_refusal(code, kind=UnknownCommand):
        parse_command(line)


def test_every_command_has_a_unique_key_and_a_description() -> None:
    assert set(KEYS.values()) == set(Action) and all(action.meaning for action in Action)


def test_the_reason_of_a_redo_is_typed_and_escape_discards_it() -> None:
    shown: list[str | None] = []
    keys = KeyParser(shown.append)
    assert keys.feed("r") == [] and keys.feed("ab") == [] and keys.feed("\x7f") == []
    assert shown == ["reason? ", "reason? a", "reason? ab", "reason? a"]
    assert keys.feed("\n") == [Command(Action.REDO, "a")] and shown[-1] is None
    assert keys.feed("d") == [] and keys.feed("\x1b") == []
    assert keys.feed("k") == [Command(Action.KEEP)], "what is typed is a key again"


def test_the_number_of_the_next_trial_is_typed() -> None:
    keys = KeyParser(lambda _: None)
    assert keys.feed("x1") == [] and keys.feed("2\r") == [Command(Action.NEXT, trial=12)]
    (refused,) = keys.feed("x\r")
    assert isinstance(refused, UnknownCommand) and refused.code == CommandCode.TRIAL_NUMBER_EXPECTED


def test_arrows_are_ignored_enter_arms_and_an_unknown_key_is_refused() -> None:
    keys = KeyParser(lambda _: None)
    assert keys.feed("\x1b[A") == []
    assert keys.feed("\r") == [Command(Action.ARM)]
    (unknown,) = keys.feed("z")
    assert isinstance(unknown, UnknownCommand) and unknown.code == CommandCode.UNKNOWN_KEY
    assert keys.feed("\x00") == []
