"""Where commands come from: keys on a terminal, lines on a pipe.

A thread reads, because a read of a terminal cannot be waited for in one way on all systems; it reads the descriptor
itself, so that it holds no lock of the interpreter's streams when the process ends.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from station.terminal.commands import KEYS, TAKES_A_REASON, Action, Command, UnknownCommand, parse_command

Post = Callable[[Command | UnknownCommand], None]
READ_SIZE = 4096
LONGEST_LINE = 10_000
ENTER, ESCAPE, BACKSPACE = "\r\n", "\x1b", "\x7f\b"


def is_interactive() -> bool:
    """Whether a person has this terminal before him: a job in the background may not read it."""
    if not (sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    if not hasattr(os, "tcgetpgrp"):
        return True
    return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()


class KeyParser:
    """Keys to commands. After the key of a redo its reason is typed, up to Enter; Escape drops it."""

    def __init__(self, show_typed: Callable[[str | None], None]) -> None:
        self._show_typed = show_typed
        self._action: Action | None = None
        self._typed = ""

    def feed(self, keys: str) -> list[Command | UnknownCommand]:
        """What was pressed at once; keys that send an escape sequence, as arrows do, mean nothing."""
        if keys.startswith(ESCAPE) and len(keys) > 1:
            return []
        return [command for key in keys if (command := self._take(key)) is not None]

    def _take(self, key: str) -> Command | UnknownCommand | None:
        if self._action is not None:
            return self._take_reason(self._action, key)
        action = Action.ARM if key in ENTER else KEYS.get(key.lower())
        if action is None:
            return UnknownCommand(f"no key is {key!r}; ? lists them") if key.isprintable() else None
        if action not in TAKES_A_REASON:
            return Command(action)
        self._action = action
        self._type("")
        return None

    def _take_reason(self, action: Action, key: str) -> Command | None:
        if key in ENTER or key == ESCAPE:
            command = Command(action, self._typed.strip()) if key in ENTER else None
            self._action, self._typed = None, ""
            self._show_typed(None)
            return command
        self._type(self._typed[:-1] if key in BACKSPACE else self._typed + key if key.isprintable() else self._typed)
        return None

    def _type(self, text: str) -> None:
        self._typed = text
        self._show_typed(text)


class LineParser:
    """Bytes of a pipe to commands, a line each."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Command | UnknownCommand]:
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-LONGEST_LINE:]
        return [_parsed(line.decode("utf-8", errors="replace")) for line in lines if line.strip()]


def _parsed(line: str) -> Command | UnknownCommand:
    try:
        return parse_command(line.lstrip("\ufeff"))  # which PowerShell sends first
    except UnknownCommand as unknown:
        return unknown


def listen_to_lines(post: Post) -> None:
    """Commands from standard input, until it ends: the session goes on without them."""
    if sys.stdin is None:  # a service without one
        return
    descriptor, parser = sys.stdin.fileno(), LineParser()

    def read() -> None:
        while data := _read(descriptor):
            for command in parser.feed(data):
                post(command)

    threading.Thread(target=read, name="commands", daemon=True).start()


@contextmanager
def listening_to_keys(post: Post, show_typed: Callable[[str | None], None]) -> Iterator[None]:
    """Commands from the terminal's keys, without Enter and without echo; the terminal is set back afterwards."""
    parser = KeyParser(show_typed)

    def take(keys: str) -> None:
        for command in parser.feed(keys):
            post(command)

    with _windows_keys(take) if sys.platform == "win32" else _posix_keys(take):
        yield


@contextmanager
def _posix_keys(take: Callable[[str], None]) -> Iterator[None]:
    import termios
    import tty

    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)  # keys one by one; Ctrl-C stays a signal

    def read() -> None:
        while data := _read(descriptor):
            take(data.decode("utf-8", errors="ignore"))

    threading.Thread(target=read, name="keys", daemon=True).start()
    try:
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


@contextmanager
def _windows_keys(take: Callable[[str], None]) -> Iterator[None]:
    import msvcrt

    def read() -> None:
        while True:
            key = msvcrt.getwch()  # type: ignore[attr-defined]
            if key in "\0\xe0":  # an arrow or a function key: its second half follows
                msvcrt.getwch()  # type: ignore[attr-defined]
            else:
                take(key)

    threading.Thread(target=read, name="keys", daemon=True).start()
    yield


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, READ_SIZE)
    except OSError:  # the terminal was closed
        return b""
