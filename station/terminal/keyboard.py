"""Sources of commands: keys on a terminal, lines on a pipe.

A thread reads, because no asynchronous read of a terminal works on all systems.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from station.messages.codes import CommandCode
from station.messages.message import Message
from station.standard_input import POLL_INTERVAL_S, READ_SIZE, read_lines
from station.terminal.commands import KEYS, Action, Command, UnknownCommand, parse_argument, parse_command

Post = Callable[[Command | UnknownCommand], None]
KEY_TIMEOUT_S = 1.0
"""On Windows, for the key that is being read at the end: kbhit() may announce one that getwch() waits for."""
ENTER, ESCAPE, BACKSPACE = "\r\n", "\x1b", "\x7f\b"
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
            return _parse_typed(action, typed) if key in ENTER else None
        self._type(self._typed[:-1] if key in BACKSPACE else self._typed + key if key.isprintable() else self._typed)
        return None

    def _type(self, text: str) -> None:
        self._typed = text
        self._show_typed(PROMPTS[self._action] + text if self._action is not None else text)


def _parse_typed(action: Action, typed: str) -> Command | UnknownCommand:
    try:
        return parse_argument(action, f"#{typed.lstrip(' #')}" if action is Action.NEXT else typed)
    except UnknownCommand as unknown:
        return unknown


def listen_to_lines(post: Post) -> None:
    """Read commands from standard input until it ends; the session continues without them."""

    def read() -> None:
        for line in read_lines(sys.stdin):
            if line.strip():
                post(_parse_line(line))

    threading.Thread(target=read, name="commands", daemon=True).start()


def _parse_line(line: str) -> Command | UnknownCommand:
    try:
        return parse_command(line)
    except UnknownCommand as unknown:
        return unknown


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
