"""The clock's port of the simulated bench: lines of JSON over TCP, each request answered by one line.

It is separate from the devices' protocols, by which a server cannot know what its client has processed. An attached
station reports here how far it has processed the data; the world does not advance beyond that time:

    {"attach": "recorder", "speed": 30}      from now on the world waits for this connection, at this pace at most
    {"advance_to": 12.5, "ports": [50112]}   all earlier data are processed: advance to that world time [s], once the
                                             devices know the connections from these local ports

The answer to advance_to comes when the devices have sent all data up to that time. "sent" has, by device and local
port, the number of bytes since the connection began (null: closed by the simulator); "pending" names the devices whose
answer to a client waits for the world to advance. An advance_to of the present time only asks for this. The other
requests are those of requests.py. The end of the connection detaches the station. Only 127.0.0.1 is served.
"""

from __future__ import annotations

import json
import socket
import socketserver
import sys
import threading
import time
from contextlib import ExitStack, suppress
from typing import Any
from weakref import WeakSet

from drivers.simulators.errors import SimulatorCode, SimulatorError, refusal
from drivers.simulators.requests import ServedBench, answer, request_from_json, seconds_from, speed_from
from drivers.simulators.world_clock import Attachment, ClockStopped

CONNECTION_KNOWN_S = 60.0  # wall; longest time from the acceptance of a connection by the kernel to the device's server
POLL_INTERVAL_S = 0.001  # wall


class ControlServer:
    """Serves one bench; port 0 takes a free one."""

    def __init__(self, bench: ServedBench, port: int = 0) -> None:
        self._bench = bench
        self._connections: WeakSet[socket.socket] = WeakSet()
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None
        self.port = port

    def start(self) -> None:
        """Binds and serves. Raises OSError if the port is taken."""
        self._server = _Server(("127.0.0.1", self.port), _handler(self._bench, self._connections))
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), name="clock port", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._thread.join()
            self._server.server_close()
            for connection in tuple(self._connections):
                with suppress(OSError):  # the station closed it first
                    connection.shutdown(socket.SHUT_RDWR)
            self._server = self._thread = None


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = sys.platform != "win32"  # there it would let two servers share a port
    daemon_threads = True
    block_on_close = False


def _handler(bench: ServedBench, connections: WeakSet[socket.socket]) -> type[socketserver.StreamRequestHandler]:
    class RequestHandler(socketserver.StreamRequestHandler):
        disable_nagle_algorithm = True

        def handle(self) -> None:
            connections.add(self.connection)
            with ExitStack() as attached, suppress(OSError):  # the station has disconnected
                talk = _ClockConnection(bench, attached)
                for line in self.rfile:
                    self.wfile.write(json.dumps(talk.answer(line)).encode() + b"\n")

    return RequestHandler


class _ClockConnection:
    def __init__(self, bench: ServedBench, attached: ExitStack) -> None:
        self._bench = bench
        self._attached = attached
        self._station: Attachment | None = None

    def answer(self, line: bytes) -> dict[str, Any]:
        try:
            match request := request_from_json(line):
                case {"attach": str(name)}:
                    return self._attach(name, request)
                case {"advance_to": until}:
                    return self._advance(seconds_from("advance_to", until), request.get("ports", []))
                case {"pause_s": _} if self._station is not None:
                    raise SimulatorError(
                        f"{self._station.name} is attached, and pauses by advance_to", SimulatorCode.ATTACHED
                    )
                case _:
                    return answer(self._bench, request)
        except (ValueError, RecursionError, ClockStopped) as error:
            return refusal(error)

    def _attach(self, name: str, request: dict[str, Any]) -> dict[str, Any]:
        if self._station is not None:
            raise SimulatorError(f"{self._station.name} is attached already on this connection", SimulatorCode.ATTACHED)
        speed = speed_from(request.get("speed"))
        self._station = self._attached.enter_context(self._bench.clock.attach(name, speed))
        clock = self._bench.clock
        return {"now": clock.now(), "speed": clock.speed, "start_utc_ns": self._bench.start_utc_ns}

    def _advance(self, until: float, ports: Any) -> dict[str, Any]:
        if self._station is None:
            raise SimulatorError("expected attach before advance_to", SimulatorCode.NOT_ATTACHED)
        if not isinstance(ports, list) or not all(isinstance(port, int) for port in ports):
            raise SimulatorError(f"ports is {ports!r}, expected a list of numbers", SimulatorCode.WRONG_VALUE)
        self._wait_until_known(set(ports))
        now = self._station.advance_to(until)
        sent, pending = self._bench.sent(), self._bench.pending()
        return {"now": now, "sent": sent, "pending": pending}

    def _wait_until_known(self, ports: set[int]) -> None:
        give_up_s = time.perf_counter() + CONNECTION_KNOWN_S
        while not ports <= {port for sent in self._bench.sent().values() for port in sent}:
            if time.perf_counter() > give_up_s:
                raise SimulatorError(
                    f"no device of this bench has a connection from port {min(ports)}", SimulatorCode.UNKNOWN_PORT
                )
            time.sleep(POLL_INTERVAL_S)
