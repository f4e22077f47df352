"""Live updates from the live process to any number of views on this computer, and commands from them.

A view has the set-up and the updates since the last look, and nothing blocks it. One that does not read loses updates,
and the live process waits for none. Its address is a file in the session's folder that its owner alone may read; on
Windows it has the permissions of the folder.
"""

from __future__ import annotations

import hmac
import json
import os
import secrets
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pydantic import ValidationError

from documents.message import Message, because
from documents.plain_data import PlainDataError, parse_json
from documents.regular_file import read_regular
from station.errors import StationError
from station.live.published import SETUP, UPDATE, LiveSetup, LiveUpdate, update_line
from station.messages.live_messages import LiveCode

VIEW_BACKLOG = 50
"""Updates that may wait for a view before the oldest is dropped."""
VIEW_RATE_HZ = 25.0
"""Updates per second that a view gets; file and outlet get all."""
DRAIN_S = 2.0  # a busy computer may not run the sender for half a second
LONGEST_COMMAND = 4096
TOKEN_TIMEOUT_S = 5.0
"""Wall seconds for a connection to send the token."""
MOST_STRANGERS = 16
"""Connections that have not sent the token; the oldest is closed for a further one."""
ACCEPT_PAUSE_S = 0.1
SEND_BUFFER = 65_536
"""Bytes: updates of a view that does not read wait in its backlog, where they are counted, and not in the system."""

Command = Callable[[dict[str, Any]], None]
CONNECT_TIMEOUT_S = 5.0
BACKLOG = 250
"""Updates that may wait for take() before the oldest is dropped: ten seconds."""
ADDRESS_FILE = ".live.json"
LARGEST = 4096  # bytes


def serve_views(stack: ExitStack, setup: LiveSetup, folder: Path, on_command: Command) -> Callable[[LiveUpdate], None]:
    """Serve until the stack is closed, at an address that is announced in the folder; returns publish()."""
    server = stack.enter_context(LiveServer(setup, on_command))
    try:
        announce(folder, server.address)
    except OSError as error:  # the values are written all the same
        figures = {"path": str(folder / ADDRESS_FILE), **because(error)}
        print(Message(LiveCode.NOT_ANNOUNCED, figures), file=sys.stderr, flush=True)
    else:
        stack.callback(withdraw, folder, server.address)
    return server.publish


class LiveServer:
    """A context manager. publish() returns at once."""

    def __init__(self, setup: LiveSetup, on_command: Command, rate_hz: float = VIEW_RATE_HZ) -> None:
        """on_command takes a view's command, in a thread of the server."""
        self._setup_line = SETUP.dump_json(setup) + b"\n"
        self._on_command, self._interval_s = on_command, 1.0 / rate_hz
        self._next_s, self._is_closed = 0.0, False
        self._waiting: LiveUpdate | None = None
        self._views: list[_View] = []
        self._lock = threading.Lock()
        self._strangers: deque[socket.socket] = deque()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = LiveAddress(self._listener.getsockname()[1], secrets.token_urlsafe(24))

    @property
    def views(self) -> int:
        return len(self._views)

    def publish(self, update: LiveUpdate) -> None:
        """Offer the update to all views, at most rate_hz a second; the newest values wait for the next, or the end."""
        if update.values is None and self._waiting is not None:
            update = replace(update, values=self._waiting.values)
        now_s = time.perf_counter()
        if now_s < self._next_s:
            self._waiting = update
            return
        self._next_s, self._waiting = now_s + self._interval_s, None
        self._offer(update)

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, name="live views", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_closed = True
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        if self._waiting is not None:
            self._offer(self._waiting)
        for view in self._all_views():
            view.finish()

    def _offer(self, update: LiveUpdate) -> None:
        for view in self._all_views():
            view.offer(update)

    def _all_views(self) -> tuple[_View, ...]:
        with self._lock:
            return tuple(self._views)

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                if self._is_closed:
                    return
                time.sleep(ACCEPT_PAUSE_S)  # out of descriptors
                continue
            with self._lock:
                self._strangers.append(connection)
                oldest = self._strangers.popleft() if len(self._strangers) > MOST_STRANGERS else None
            if oldest is not None:
                with suppress(OSError):
                    oldest.shutdown(socket.SHUT_RDWR)  # its thread then closes it
            threading.Thread(target=self._serve, args=(connection,), name="live view", daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        """Let the view in, then read its commands until it goes."""
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        with connection, connection.makefile("rb") as lines, suppress(OSError, ValueError):
            try:
                is_admitted = self._has_token(connection)
            finally:
                with self._lock, suppress(ValueError):
                    self._strangers.remove(connection)
            if not is_admitted:
                return
            view = _View(connection, self._setup_line)
            with self._lock:
                self._views.append(view)
                view.start()
            try:
                while line := lines.readline(LONGEST_COMMAND):
                    if isinstance(command := parse_json(line), dict):
                        self._on_command(command)
            finally:
                with self._lock:
                    self._views.remove(view)
                view.finish()

    def _has_token(self, connection: socket.socket) -> bool:
        """Whether the first line of a connection has the token. Reads no byte of the commands behind it."""
        connection.settimeout(TOKEN_TIMEOUT_S)
        end_s, line = time.perf_counter() + TOKEN_TIMEOUT_S, bytearray()
        while not line.endswith(b"\n"):
            received = connection.recv(1)
            if not received or len(line) == LONGEST_COMMAND or time.perf_counter() > end_s:
                return False
            line += received
        connection.settimeout(None)
        request = parse_json(bytes(line))
        token = request.get("token") if isinstance(request, dict) else None
        return hmac.compare_digest(str(token).encode(errors="replace"), self.address.token.encode())


class _View:
    """The backlog of one view, and the thread that sends it."""

    def __init__(self, connection: socket.socket, setup_line: bytes) -> None:
        self._connection, self._setup_line = connection, setup_line
        self._backlog: deque[LiveUpdate] = deque()
        self._has_work = threading.Condition()
        self._dropped = 0
        self._is_over = False
        self._thread = threading.Thread(target=self._send, name="live view sender", daemon=True)

    def start(self) -> None:
        """Begin to send, once publish() serves the view: after the set-up it misses no update uncounted."""
        self._thread.start()

    def offer(self, update: LiveUpdate) -> None:
        with self._has_work:
            if len(self._backlog) == VIEW_BACKLOG:
                self._backlog.popleft()
                self._dropped += 1
            self._backlog.append(update)
            self._has_work.notify()

    def finish(self) -> None:
        """Send what waits, then end; a view that does not read ends after DRAIN_S."""
        with self._has_work:
            self._is_over = True
            self._has_work.notify()
        if self._thread is not threading.current_thread():
            self._thread.join(DRAIN_S)
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def _send(self) -> None:
        with suppress(OSError):
            self._connection.sendall(self._setup_line)
            while True:
                with self._has_work:
                    self._has_work.wait_for(lambda: self._backlog or self._is_over)
                    if not self._backlog:
                        return
                    update, dropped = self._backlog.popleft(), self._dropped
                delivery = replace(update.delivery, not_shown=dropped)
                self._connection.sendall(update_line(replace(update, delivery=delivery)))


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


@dataclass(frozen=True)
class LiveAddress:
    """Port on 127.0.0.1. token must be sent first: the port is open to every user of this computer."""

    port: int
    token: str


def announce(folder: Path, address: LiveAddress) -> None:
    """Write the address, in place of what has its name. Raises OSError."""
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
        return _ignored(path, **because(error))
    port, token = (found.get("port"), found.get("token")) if isinstance(found, dict) else (None, None)
    if isinstance(port, int) and 0 < port < 65536 and isinstance(token, str):
        return LiveAddress(port, token)
    return _ignored(path, **because(Message(LiveCode.NO_PORT)))


@cache
def _ignored(path: Path, **cause: float | str) -> None:
    print(Message(LiveCode.WRONG_ADDRESS, {"path": str(path), **cause}), file=sys.stderr, flush=True)
