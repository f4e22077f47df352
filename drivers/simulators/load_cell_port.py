"""An indicator on a serial line served over TCP, as pyserial's socket:// reads it: USB220 or USB520 lines.

Does not imitate: a character device with its baud rate and parity, the indicator's own filter and noise, its commands.
"""

from __future__ import annotations

import logging
import socket
import socketserver
import sys
import threading
from collections import deque
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.faults import Faults
from drivers.simulators.settings import SerialLineSettings
from recordings.standard_gravity import g

logger = logging.getLogger(__name__)

NEWTONS_PER_POUND = 4.4482216152605
SEND_TIMEOUT_S = 1.0  # wall; a client that reads nothing for this time is disconnected
MOST_CLIENTS = 100  # that are remembered
RUBBISH = b"\x00\xff\x80?;+0.\r\n"


class ForceWorld(Protocol):
    """Interface of the World to a load cell, in world seconds."""

    faults: Faults

    def now(self) -> float: ...
    def cell_force(self, t: NDArray[np.float64]) -> NDArray[np.float64]: ...


def encode_usb220(newtons: float) -> bytes:
    """18 bytes, pounds-force in the first 13."""
    return f"{newtons / NEWTONS_PER_POUND:+011.4f}  lbs\r\n".encode("ascii")


def encode_usb520(newtons: float) -> bytes:
    """Grams-force."""
    return f"{newtons / g * 1000:.2f} g\r\n".encode("ascii")


ENCODERS = {"usb220": encode_usb220, "usb520": encode_usb520}


class SerialLoadCellSimulator:
    """Sends every client the force on the cell, rate_hz lines per world second; port 0 takes a free one."""

    def __init__(self, world: ForceWorld, *, port: int = 0, line: SerialLineSettings | None = None) -> None:
        self._world = world
        self._line = line or SerialLineSettings()
        self._clients: deque[_Client] = deque(maxlen=MOST_CLIENTS)
        self._is_stopping = threading.Event()
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None
        self.port = port

    @property
    def url(self) -> str:
        """The port as pyserial takes it."""
        return f"socket://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Binds and serves. Raises OSError if the port is taken."""
        self._is_stopping.clear()
        self._server = _Server(("127.0.0.1", self.port), _line_handler(self._serve_client))
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), name="serial load cell")
        self._thread.start()

    def stop(self) -> None:
        """Close the connection of every client."""
        self._is_stopping.set()
        for client in tuple(self._clients):
            client.close()
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._thread.join()
            self._server.server_close()
            self._server = self._thread = None

    def step(self, now: float) -> None:
        """Sends every client the lines that were due up to now [world s]."""
        for client in tuple(self._clients):
            if not client.is_closed and not self._send_lines(client, now):
                client.close()

    def sent(self) -> dict[int, int | None]:
        """Bytes sent so far on each connection, by the client's port; None where the connection was closed."""
        return {client.port: None if client.is_closed else client.sent for client in tuple(self._clients)}

    @property
    def has_pending_reply(self) -> bool:
        return False

    def find_slow_client(self) -> str | None:
        return None  # step() drops it

    def drop_slow_client(self) -> None: ...

    def _serve_client(self, connection: socket.socket) -> None:
        """Keep the connection open until the simulator closes it; the clock's thread sends."""
        connection.settimeout(SEND_TIMEOUT_S)
        client = _Client(connection, self._world.now())
        self._clients.append(client)
        if self._is_stopping.is_set():
            client.close()
        client.ended.wait()

    def _send_lines(self, client: _Client, now: float) -> bool:
        """Whether the client took them."""
        while client.due <= now:
            if self._world.faults.active("serial", "unplug", client.due):
                return False
            line = self._line_at(client.due)
            client.due += 1 / self._line.rate_hz
            try:
                client.connection.sendall(line)
            except OSError as error:
                if isinstance(error, TimeoutError):
                    logger.warning(
                        "simulated bench: the indicator's client at port %d has read nothing for %g s and is dropped",
                        client.port,
                        SEND_TIMEOUT_S,
                    )
                return False
            client.sent += len(line)
        return True

    def _line_at(self, due: float) -> bytes:
        """The line of that moment, world seconds."""
        if self._world.faults.active("serial", "silence", due):
            return b""
        if self._world.faults.active("serial", "garbage", due):
            return RUBBISH
        return ENCODERS[self._line.line_format](float(self._world.cell_force(np.array([due]))[0]))


class _Client:
    """One connection, and the world time at which its next line is due."""

    def __init__(self, connection: socket.socket, due: float) -> None:
        self.connection = connection
        self.port = int(connection.getpeername()[1])
        self.due = due
        self.sent = 0  # bytes
        self.ended = threading.Event()

    @property
    def is_closed(self) -> bool:
        return self.ended.is_set()

    def close(self) -> None:
        """Close: the server closes the connection of a handler that returns."""
        self.ended.set()


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = sys.platform != "win32"  # there it would let two servers share a port
    daemon_threads = False  # server_close() waits for the clients' threads


def _line_handler(serve: Any) -> type[socketserver.BaseRequestHandler]:
    class LineHandler(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            serve(self.request)

    return LineHandler
