"""An indicator on a serial line served over TCP, as pyserial's socket:// reads it: USB220 or USB520 lines.

Does not imitate: a character device with its baud rate and parity, the indicator's own filter and noise, its commands.
"""

from __future__ import annotations

import socketserver
import sys
import threading
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.faults import Faults
from drivers.simulators.settings import STANDARD_GRAVITY, SerialLine

NEWTONS_PER_POUND = 4.4482216152605
SEND_TIMEOUT_S = 1.0  # wall; a client that takes nothing for so long is left
RUBBISH = b"\x00\xff\x80?;+0.\r\n"


class ForceWorld(Protocol):
    """What a load cell feels of the World, in world seconds."""

    faults: Faults

    @property
    def speed(self) -> float: ...
    def now(self) -> float: ...
    def cell_force(self, t: NDArray[np.float64]) -> NDArray[np.float64]: ...


def encode_usb220(newtons: float) -> bytes:
    """18 bytes, pounds-force in the first 13."""
    return f"{newtons / NEWTONS_PER_POUND:+011.4f}  lbs\r\n".encode("ascii")


def encode_usb520(newtons: float) -> bytes:
    """Grams-force."""
    return f"{newtons / STANDARD_GRAVITY * 1000:.2f} g\r\n".encode("ascii")


ENCODERS = {"usb220": encode_usb220, "usb520": encode_usb520}


class SerialLoadCellSimulator:
    """Sends every client the force on the cell, rate_hz lines per world second; port 0 takes a free one."""

    def __init__(self, world: ForceWorld, *, port: int = 0, line: SerialLine | None = None) -> None:
        self._world = world
        self._line = line or SerialLine()
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
        self._server = _Server(("127.0.0.1", self.port), _talk_to(self._talk))
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), name="serial load cell")
        self._thread.start()

    def stop(self) -> None:
        """Hangs up on every client."""
        self._is_stopping.set()
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._thread.join()
            self._server.server_close()
            self._server = self._thread = None

    def _talk(self, client: Any) -> None:
        client.settimeout(SEND_TIMEOUT_S)
        due = self._world.now()
        while not self._is_stopping.wait(max(0.0, (due - self._world.now()) / self._world.speed)):
            if self._world.faults.active("serial", "unplug", due):
                return
            try:
                client.sendall(self._said(due))
            except OSError:
                return
            due += 1 / self._line.rate_hz

    def _said(self, due: float) -> bytes:
        """The line of that moment, world seconds."""
        if self._world.faults.active("serial", "silence", due):
            return b""
        if self._world.faults.active("serial", "garbage", due):
            return RUBBISH
        return ENCODERS[self._line.line_format](float(self._world.cell_force(np.array([due]))[0]))


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = sys.platform != "win32"  # there it would let two servers share a port
    daemon_threads = False  # server_close() waits for the clients' threads


def _talk_to(talk: Any) -> type[socketserver.BaseRequestHandler]:
    class Handler(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            talk(self.request)

    return Handler
