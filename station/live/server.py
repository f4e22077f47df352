"""Serve updates to any number of views on this computer. A view that does not read loses updates, and nothing waits."""

from __future__ import annotations

import hmac
import json
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from station.live.address import LiveAddress, announce, withdraw
from station.live.published import SETUP, LiveSetup, LiveUpdate, update_line

VIEW_BACKLOG = 50
"""Updates that may wait for a view before the oldest is dropped."""
VIEW_RATE_HZ = 25.0
"""Updates per second that a view gets; file and outlet get all."""
LONGEST_COMMAND = 4096
SEND_BUFFER = 65_536
"""Bytes: updates of a view that does not read wait in its backlog, where they are counted, and not in the system."""

Command = Callable[[dict[str, Any]], None]


def serve_views(stack: ExitStack, setup: LiveSetup, folder: Path, on_command: Command) -> Callable[[LiveUpdate], None]:
    """Serve until the stack is closed, at an address that is announced in the folder; returns publish()."""
    server = stack.enter_context(LiveServer(setup, on_command))
    announce(folder, server.address)
    stack.callback(withdraw, folder, server.address)
    return server.publish


class LiveServer:
    """A context manager. publish() returns at once."""

    def __init__(self, setup: LiveSetup, on_command: Command, rate_hz: float = VIEW_RATE_HZ) -> None:
        """on_command takes a view's command, in a thread of the server."""
        self._setup_line = SETUP.dump_json(setup) + b"\n"
        self._on_command, self._interval_s = on_command, 1.0 / rate_hz
        self._next_s = 0.0
        self._views: list[_View] = []
        self._lock = threading.Lock()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = LiveAddress(self._listener.getsockname()[1], secrets.token_urlsafe(24))

    @property
    def views(self) -> int:
        return len(self._views)

    def publish(self, update: LiveUpdate, *, is_last: bool = False) -> None:
        """Offer the update to all views, at most rate_hz a second; the last one in any case."""
        now_s = time.monotonic()
        if now_s < self._next_s and not is_last:
            return
        self._next_s = now_s + self._interval_s
        with self._lock:
            views = tuple(self._views)
        for view in views:
            view.offer(update)

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, name="live views", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            views = tuple(self._views)
        for view in views:
            view.finish()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # closed
                return
            threading.Thread(target=self._serve, args=(connection,), name="live view", daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        """Let the view in, then read its commands until it goes."""
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        with connection, connection.makefile("rb") as lines, suppress(OSError, ValueError):
            request = json.loads(lines.readline(LONGEST_COMMAND))
            if not hmac.compare_digest(str(request["token"]).encode(), self.address.token.encode()):
                return
            view = _View(connection, self._setup_line)
            with self._lock:
                self._views.append(view)
                view.start()
            try:
                while line := lines.readline(LONGEST_COMMAND):
                    self._on_command(json.loads(line))
            finally:
                with self._lock:
                    self._views.remove(view)
                view.finish()


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
        """Send what waits, then end; a view that does not read ends at once."""
        with self._has_work:
            self._is_over = True
            self._has_work.notify()
        if self._thread is not threading.current_thread():
            self._thread.join(0.5)
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
