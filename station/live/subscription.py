"""A view's end: the set-up, the updates since the last look, and commands. Nothing here blocks a view.

The address of the live process is a file in the session's folder that its owner alone may read. On Windows it has the
permissions of the folder.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
from collections import deque
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Self

from pydantic import ValidationError

from documents.plain_data import PlainDataError, parse_json
from documents.regular_file import describe_failure, read_regular
from station.errors import StationError
from station.live.published import SETUP, UPDATE, LiveSetup, LiveUpdate
from station.messages.live_messages import LiveCode
from station.messages.message import Message

CONNECT_TIMEOUT_S = 5.0
BACKLOG = 250
"""Updates that may wait for take() before the oldest is dropped: ten seconds."""


class LiveUnreachable(StationError):
    """No live process answers at the address."""


class LiveSubscription:
    """A context manager; take() is to be called as often as the view is drawn. Views may come and go at any time."""

    def __init__(self, address: LiveAddress, backlog: int = BACKLOG) -> None:
        """Raises LiveUnreachable."""
        self._updates: deque[LiveUpdate] = deque(maxlen=backlog)
        self._dropped = 0
        self.is_over = False
        with ExitStack() as undo:
            try:
                self._socket = undo.enter_context(
                    socket.create_connection(("127.0.0.1", address.port), CONNECT_TIMEOUT_S)
                )
                self._lines = undo.enter_context(self._socket.makefile("rb"))
                self._send({"token": address.token})
                self.setup: LiveSetup = SETUP.validate_json(self._lines.readline())
            except (OSError, ValidationError) as error:
                raise LiveUnreachable(Message(LiveCode.UNREACHABLE)) from error
            undo.pop_all()
        self._socket.settimeout(None)
        self._thread = threading.Thread(target=self._receive, name="live updates", daemon=True)
        self._thread.start()

    def take(self) -> list[LiveUpdate]:
        """Updates since the last call, oldest first. Those that were dropped are counted in delivery.not_shown."""
        updates = []
        while self._updates:
            update = self._updates.popleft()
            not_shown = update.delivery.not_shown + self._dropped
            updates.append(replace(update, delivery=replace(update.delivery, not_shown=not_shown)))
        return updates

    def set_rest_length(self, scenario: str, rest_length_m: float) -> None:
        """Ask for another rest length of the cord in this scenario, from the next frame on."""
        with suppress(OSError):  # the live process has ended, and is_over says so
            self._send({"scenario": scenario, "rest_length_m": rest_length_m})

    def wait_until_over(self, timeout_s: float) -> bool:
        """Whether the live process ends within so many wall seconds."""
        self._thread.join(timeout_s)
        return self.is_over

    def close(self) -> None:
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(CONNECT_TIMEOUT_S)
        self._lines.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _send(self, command: dict[str, object]) -> None:
        self._socket.sendall(json.dumps(command).encode() + b"\n")

    def _receive(self) -> None:
        try:
            for line in self._lines:
                if not line.endswith(b"\n"):  # the live process was killed while writing
                    break
                if len(self._updates) == self._updates.maxlen:
                    self._dropped += 1
                self._updates.append(UPDATE.validate_json(line))
        except OSError:  # closed
            return
        finally:
            self.is_over = True


ADDRESS_FILE = ".live.json"
LARGEST = 4096  # bytes


@dataclass(frozen=True)
class LiveAddress:
    """Port on 127.0.0.1. token must be sent first: the port is open to every user of this computer."""

    port: int
    token: str


def announce(folder: Path, address: LiveAddress) -> None:
    path = folder / ADDRESS_FILE
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        json.dump(asdict(address), file)


def withdraw(folder: Path, address: LiveAddress) -> None:
    """Remove the announcement, if it is still the one of this address."""
    if find_address(folder) == address:
        with suppress(OSError):
            (folder / ADDRESS_FILE).unlink(missing_ok=True)


def find_address(folder: Path) -> LiveAddress | None:
    """None where no live process has announced itself; one that was killed leaves an address that refuses.

    A file that is no announcement is ignored, and named on stderr once.
    """
    path = folder / ADDRESS_FILE
    try:
        found = parse_json(read_regular(path, LARGEST))
    except FileNotFoundError:
        return None
    except (OSError, PlainDataError) as error:
        return _ignored(path, describe_failure(error))
    port, token = (found.get("port"), found.get("token")) if isinstance(found, dict) else (None, None)
    if isinstance(port, int) and 0 < port < 65536 and isinstance(token, str):
        return LiveAddress(port, token)
    return _ignored(path, "it has no port from 1 to 65535 with a token")


@cache
def _ignored(path: Path, reason: str) -> None:
    print(Message(LiveCode.WRONG_ADDRESS, {"path": str(path), "reason": reason}), file=sys.stderr, flush=True)
