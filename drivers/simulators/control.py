"""The clock's port of the simulated bench: lines of JSON over TCP, each request answered by one line.

It is no part of the device wires, which show a server nothing of its reader. A station that attaches says here how far
it has handled what the devices sent; the world goes no farther than it allows:

    {"attach": "recorder", "speed": 30}      from now on the world waits for this connection; speed is optional
    {"advance_to": 12.5, "ports": [50112]}   all before is handled: go on to that world time [s]. The world moves once
                                             the connections from these local ports are known to the devices

The answer to advance_to comes when the devices have sent all up to that time: "sent" tells by device and local port how
many bytes that is since the connection began (null: closed from here); "owing" names the devices that owe a client an
answer which comes only as the world goes on. An advance_to of now moves nothing, and asks for just that.
The other requests are those of requests.py. The end of the connection detaches. Only 127.0.0.1 is served.
"""

from __future__ import annotations

import json
import socketserver
import sys
import threading
import time
from contextlib import ExitStack, suppress
from typing import Any

from drivers.simulators.requests import ServedBench, answer, speed_from
from drivers.simulators.world_clock import ClockStopped, Station

CONNECTION_KNOWN_S = 5.0  # wall; a connection takes that long at most from the kernel to the device's server
GLANCE_S = 0.001  # wall


class ControlServer:
    """Serves one bench; port 0 takes a free one."""

    def __init__(self, bench: ServedBench, port: int = 0) -> None:
        self._bench = bench
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None
        self.port = port

    def start(self) -> None:
        """Binds and serves. Raises OSError if the port is taken."""
        self._server = _Server(("127.0.0.1", self.port), _handler(self._bench))
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), name="clock port", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._thread.join()
            self._server.server_close()
            self._server = self._thread = None


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = sys.platform != "win32"  # there it would let two servers share a port
    daemon_threads = True
    block_on_close = False


def _handler(bench: ServedBench) -> type[socketserver.StreamRequestHandler]:
    class Handler(socketserver.StreamRequestHandler):
        disable_nagle_algorithm = True

        def handle(self) -> None:
            with ExitStack() as attached, suppress(OSError):  # the station is gone
                talk = _Conversation(bench, attached)
                for line in self.rfile:
                    self.wfile.write(json.dumps(talk.answer(line)).encode() + b"\n")

    return Handler


class _Conversation:
    def __init__(self, bench: ServedBench, attached: ExitStack) -> None:
        self._bench = bench
        self._attached = attached
        self._station: Station | None = None

    def answer(self, line: bytes) -> dict[str, Any]:
        try:
            request = json.loads(line)
            if not isinstance(request, dict):
                raise ValueError(f"expected a JSON object, found {request!r}")
            match request:
                case {"attach": str(name)}:
                    return self._attach(name, request)
                case {"advance_to": int() | float() as until}:
                    return self._advance(float(until), request.get("ports", []))
                case _:
                    return answer(self._bench, request)
        except (ValueError, RecursionError, ClockStopped) as error:
            return {"error": str(error)}

    def _attach(self, name: str, request: dict[str, Any]) -> dict[str, Any]:
        if self._station is not None:
            raise ValueError(f"{self._station.name} is attached already on this connection")
        if "speed" in request:
            self._bench.clock.speed = speed_from(request["speed"])
        self._station = self._attached.enter_context(self._bench.clock.attach(name))
        clock = self._bench.clock
        return {"now": clock.now(), "speed": clock.speed, "start_utc_ns": self._bench.start_utc_ns}

    def _advance(self, until: float, ports: list[int]) -> dict[str, Any]:
        if self._station is None:
            raise ValueError("expected attach before advance_to")
        self._wait_until_known(set(ports))
        now = self._station.advance_to(until)
        sent, owing = self._bench.sent(), self._bench.owing()
        return {"now": now, "sent": sent, "owing": owing}

    def _wait_until_known(self, ports: set[int]) -> None:
        give_up_s = time.monotonic() + CONNECTION_KNOWN_S
        while not ports <= {port for sent in self._bench.sent().values() for port in sent}:
            if time.monotonic() > give_up_s:
                raise ValueError(f"no device of this bench has a connection from port {min(ports)}")
            time.sleep(GLANCE_S)
