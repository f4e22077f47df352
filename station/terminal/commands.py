"""Commands of a session without a page, from lines on a pipe or keys on a terminal, and the answers to them.

A command is one word per line, or its letter as a key. #5 is the fifth trial of the plan. A thread reads, because no
asynchronous read of a terminal works on all systems.
"""

from __future__ import annotations

import asyncio
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

from documents.message import Message
from station.errors import StationError
from station.messages.session_messages import CommandCode
from station.session.open_session import CommandRefused
from station.session.trial_runner import LiveTrial
from station.standard_input import POLL_INTERVAL_S, READ_SIZE, read_lines
from station.terminal.events import CommandAnswered, PlanListed, SessionEvent

LONGEST_QUOTE = 40
_TRIAL = re.compile(r"#(\d{1,4})(?:\s+|$)")
KEY_TIMEOUT_S = 1.0
"""On Windows, for the key that is being read at the end: kbhit() may announce one that getwch() waits for."""
ENTER, ESCAPE, BACKSPACE = "\r\n", "\x1b", "\x7f\b"


class Action(StrEnum):
    """Word, key and meaning; keys of keep, redo, redon, arm, mark, stop and silence are those of the console page."""

    key: str
    meaning: str

    def __new__(cls, word: str, key: str, meaning: str) -> Action:
        member = str.__new__(cls, word)
        member._value_, member.key, member.meaning = word, key, meaning
        return member

    KEEP = "keep", "k", "keep the recording that waits"
    REDO = (
        "redo",
        "r",
        "repeat the trial of the recording that waits, runs, or was kept last, or trial #5; give the reason",
    )
    REDON = "redon", "d", "as redo, after donning the cuff anew; its repeats start again"
    UNDO = "undo", "u", "undo the last decision; its recording waits for a decision again"
    SKIP = "skip", "n", "skip the next trial of the plan, or trial #5"
    NEXT = "next", "x", "record trial #5 next; a skipped one is taken up again"
    TRIALS = "trials", "t", "list the trials of the plan with their numbers"
    PAUSE = "pause", "p", "pause after the running trial, or at once while none is recorded"
    ARM = "arm", "a", "arm: continue after a pause, or try again at once"
    MARK = "mark", "m", "mark this moment in the recording"
    STOP = "stop", "s", "stop the recording; what is recorded so far is kept"
    SILENCE = "silence", "i", "silence the alarm"
    FINISH = "finish", "f", "finish early: fit, assessment and report of the trials so far"
    END = "end", "e", "end without a report; `station record` resumes the session"
    HELP = "help", "?", "list the commands"


KEYS = {action.key: action for action in Action}
TAKES_A_REASON = (Action.REDO, Action.REDON)
TAKES_A_TRIAL = (*TAKES_A_REASON, Action.SKIP, Action.NEXT)


class UnknownCommand(StationError):
    """A line or key that is not a command."""


@dataclass(frozen=True)
class Command:
    """reason: fault of a recording that is repeated; empty for the reasons of the verdict. trial: its number in the
    plan, from 1; None for the trial that the action refers to by itself.
    """

    action: Action
    reason: str = ""
    trial: int | None = None


def parse_command(line: str) -> Command:
    """Parse a line such as `redo the wearer coughed`, `r the wearer coughed` or `redo #5 the wearer coughed`.

    Raises UnknownCommand.
    """
    word, _, rest = line.strip().partition(" ")
    action = KEYS.get(word.lower()) or next((known for known in Action if known.value == word.lower()), None)
    if action is None:
        figures = {"line": repr(word[:LONGEST_QUOTE]), "known": ", ".join(Action)}
        raise UnknownCommand(Message(CommandCode.UNKNOWN_COMMAND, figures))
    return parse_argument(action, rest)


def parse_argument(action: Action, text: str) -> Command:
    """The command with what was typed after its word or key. Raises UnknownCommand."""
    text, trial = text.strip(), None
    if action in TAKES_A_TRIAL and (found := _TRIAL.match(text)):
        text, trial = text[found.end() :], int(found.group(1))
    if text and action not in TAKES_A_REASON:
        code = CommandCode.TRIAL_NUMBER_EXPECTED if action in TAKES_A_TRIAL else CommandCode.UNEXPECTED_ARGUMENT
        raise UnknownCommand(Message(code, {"action": action.value, "argument": repr(text[:LONGEST_QUOTE])}))
    if action is Action.NEXT and trial is None:
        raise UnknownCommand(Message(CommandCode.TRIAL_NUMBER_EXPECTED, {"action": action.value, "argument": "none"}))
    return Command(action, text, trial)


Request = Command | UnknownCommand | None
"""None: the input has ended, and no further command follows."""


class SessionOutput(Protocol):
    """Shows a session. Must return at once."""

    def show_event(self, event: SessionEvent) -> None: ...

    def show_trial(self, live: LiveTrial | None) -> None:
        """The running trial, several times a second; None while none runs."""
        ...


class CommandQueue:
    """requests are parsed lines or keys; answers, also those that list the plan, go to the output."""

    def __init__(
        self, requests: asyncio.Queue[Request], output: SessionOutput, list_plan: Callable[[], PlanListed]
    ) -> None:
        self._requests, self._output, self._list_plan = requests, output, list_plan
        self.has_ended = False

    @property
    def is_empty(self) -> bool:
        return self._requests.empty()

    async def next(self, within_s: float) -> Command | None:
        """The next valid command; None after within_s seconds, or for an input that is answered here."""
        try:
            request = await asyncio.wait_for(self._requests.get(), within_s)
        except TimeoutError:
            return None
        if request is None:
            self.has_ended = True
            return None
        if isinstance(request, UnknownCommand):
            self.refuse(request)
            return None
        if request.action is Action.HELP:
            self.answer("\n".join(f"{action:8}{action.meaning}" for action in Action))
            return None
        if request.action is Action.TRIALS:
            self._output.show_event(self._list_plan())
            return None
        return request

    def answer(self, sentence: str) -> None:
        self._output.show_event(CommandAnswered(sentence, is_refused=False))

    def refuse(self, error: Exception) -> None:
        self._output.show_event(CommandAnswered(str(error), getattr(error, "code", ""), is_refused=True))

    def refuse_with(self, code: CommandCode, **figures: float | str) -> None:
        self.refuse(CommandRefused(Message(code, figures)))


Post = Callable[[Request], None]
PROMPTS = {Action.REDO: "reason? ", Action.REDON: "reason? ", Action.NEXT: "number of the trial? #"}
"""After these keys, text is typed up to Enter."""


def is_interactive() -> bool:
    """Whether standard input is a terminal in the foreground; a background job may not read it."""
    if not (sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    if not hasattr(os, "tcgetpgrp"):
        return True
    return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()


class KeyParser:
    """Parse keys into commands. After a key of PROMPTS its argument is typed, up to Enter; Escape discards it."""

    def __init__(self, show_typed: Callable[[str | None], None]) -> None:
        self._show_typed = show_typed
        self._action: Action | None = None
        self._typed = ""

    def feed(self, keys: str) -> list[Command | UnknownCommand]:
        """Take keys that were pressed together; keys that send an escape sequence, such as arrows, have no meaning."""
        if keys.startswith(ESCAPE) and len(keys) > 1:
            return []
        return [command for key in keys if (command := self._parse(key)) is not None]

    def _parse(self, key: str) -> Command | UnknownCommand | None:
        if self._action is not None:
            return self._parse_argument(self._action, key)
        action = Action.ARM if key in ENTER else KEYS.get(key.lower())
        if action is None:
            unknown = Message(CommandCode.UNKNOWN_KEY, {"key": repr(key)})
            return UnknownCommand(unknown) if key.isprintable() else None
        if action not in PROMPTS:
            return Command(action)
        self._action = action
        self._type("")
        return None

    def _parse_argument(self, action: Action, key: str) -> Command | UnknownCommand | None:
        if key in ENTER or key == ESCAPE:
            typed = self._typed
            self._action, self._typed = None, ""
            self._show_typed(None)
            text = f"#{typed.lstrip(' #')}" if action is Action.NEXT else typed
            return _or_unknown(parse_argument, action, text) if key in ENTER else None
        self._type(self._typed[:-1] if key in BACKSPACE else self._typed + key if key.isprintable() else self._typed)
        return None

    def _type(self, text: str) -> None:
        self._typed = text
        self._show_typed(PROMPTS[self._action] + text if self._action is not None else text)


def _or_unknown(parse: Callable[..., Command], *arguments: Any) -> Command | UnknownCommand:
    try:
        return parse(*arguments)
    except UnknownCommand as unknown:
        return unknown


def listen_to_lines(post: Post) -> None:
    """Read commands from standard input until it ends; the session continues without them."""

    def read() -> None:
        for line in read_lines(sys.stdin):
            if line.strip():
                post(_or_unknown(parse_command, line))
        post(None)

    threading.Thread(target=read, name="commands", daemon=True).start()


@contextmanager
def listening_to_keys(post: Post, show_typed: Callable[[str | None], None]) -> Iterator[None]:
    """Read commands from the keys of the terminal, without Enter and echo; the terminal is restored afterwards."""
    parser = KeyParser(show_typed)

    def on_keys(keys: str) -> None:
        for command in parser.feed(keys):
            post(command)

    with _windows_keys(on_keys) if sys.platform == "win32" else _posix_keys(on_keys):
        yield


@contextmanager
def _posix_keys(on_keys: Callable[[str], None]) -> Iterator[None]:
    import termios
    import tty

    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)  # keys one by one; Ctrl-C stays a signal

    def read() -> None:
        while data := _read(descriptor):
            on_keys(data.decode("utf-8", errors="ignore"))

    threading.Thread(target=read, name="keys", daemon=True).start()
    try:
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


@contextmanager
def _windows_keys(on_keys: Callable[[str], None]) -> Iterator[None]:
    import msvcrt

    has_ended = threading.Event()

    def read() -> None:  # without a pending read, with which a process may not end
        while not has_ended.wait(POLL_INTERVAL_S):
            while msvcrt.kbhit():  # type: ignore[attr-defined]
                key = msvcrt.getwch()  # type: ignore[attr-defined]
                if key in "\0\xe0":  # an arrow or a function key: its second half follows
                    msvcrt.getwch()  # type: ignore[attr-defined]
                else:
                    on_keys(key)

    reading = threading.Thread(target=read, name="keys", daemon=True)
    reading.start()
    try:
        yield
    finally:
        has_ended.set()
        reading.join(KEY_TIMEOUT_S)


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, READ_SIZE)
    except OSError:  # the terminal was closed
        return b""
