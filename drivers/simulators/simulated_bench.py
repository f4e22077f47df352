"""The simulated bench: one World, the devices that sample it, and the operator who starts its captures.

The clock has a port: lines of JSON over TCP, each request answered by one line. It is separate from the devices'
protocols, by which a server cannot know what its client has processed. An attached station reports here how far it has
processed the data; the world does not advance beyond that time:

    {"attach": "recorder", "speed": 30}      from now on the world waits for this connection, at this pace at most
    {"advance_to": 12.5, "ports": [50112]}   all earlier data are processed: advance to that world time [s], once the
                                             devices know the connections from these local ports

The answer to advance_to comes when the devices have sent all data up to that time. "sent" has, by device and local
port, the number of bytes since the connection began (null: closed by the simulator); "pending" names the devices whose
answer to a client waits for the world to advance. An advance_to of the present time only asks for this. The other
requests are those of requests.py. The end of the connection detaches the station. Only 127.0.0.1 is served.

The operator at the mocap PC starts a capture some seconds after all devices stream, unless a client has control.
"""

from __future__ import annotations

import json
import math
import socket
import socketserver
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict
from types import TracebackType
from typing import Any, Protocol
from weakref import WeakSet

from drivers.simulators.errors import SimulatorCode, SimulatorError, refusal
from drivers.simulators.faults import Fault, fault_from_dict
from drivers.simulators.qtm_discovery import QtmDiscovery
from drivers.simulators.qtm_server import QualisysSimulator
from drivers.simulators.requests import ServedBench, answer, request_from_json, seconds_from, speed_from
from drivers.simulators.settings import Settings, settings_from_dict
from drivers.simulators.world import World
from drivers.simulators.world_clock import Attachment, ClockStopped, Follower

CONNECTION_KNOWN_S = 60.0  # wall; longest time from the acceptance of a connection by the kernel to the device's server
POLL_INTERVAL_S = 0.001  # wall


class Bench:
    """A context manager: within it the devices answer on 127.0.0.1, at `ports` by name ("ni", "qtm", "serial"), and
    the world's clock at ports["clock"].

    A port of None in settings.ports leaves its device out. Raises OSError or RuntimeError where a port is taken.
    With a speed the world keeps that pace at most; with None it moves where an attached station or clock.advance()
    moves it. Faults come from the plan and from world.faults.inject().
    """

    def __init__(
        self, settings: Settings, speed: float | None = 1.0, seed: int = 0, fault_plan: Iterable[Fault] = ()
    ) -> None:
        self.world = World(settings, speed, seed, fault_plan=fault_plan)
        self.clock = self.world.clock
        self.ports: dict[str, int] = {}
        self.start_utc_ns = time.time_ns()  # UTC at world time 0, for clients of the world's clock
        self._devices: dict[str, _Simulator] = {}
        self._settings = settings
        self._seed = seed
        self._running = ExitStack()

    def __enter__(self) -> Bench:
        try:
            self._start()
        except BaseException:
            self._running.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._running.close()

    def _start(self) -> None:
        try:
            self._start_devices()
        finally:
            self._running.callback(self.clock.stop)  # first, so that no thread waits for a world that has stopped

    def _start_devices(self) -> None:
        wanted, settings = self._settings.ports, self._settings
        watched: list[Callable[[], object]] = []
        qtm: QualisysSimulator | None = None
        if wanted.ni is not None:
            from drivers.simulators.daq_rpcs import NiDaqSimulator  # gRPC and nidaqmx take their time to import

            wiring = dict(settings.wiring)
            ni = NiDaqSimulator(self.world, port=wanted.ni, clock=settings.daq_clock, seed=self._seed, **wiring)
            self._run("ni", ni)
            watched.append(lambda: ni.is_streaming)
        if wanted.qtm is not None:
            qtm = QualisysSimulator(self.world, port=wanted.qtm)
            self._run("qtm", qtm)
            watched.append(lambda: qtm.streaming_client)
            if wanted.discovery is not None:
                self._start_discovery(wanted.discovery, qtm.port)
        if wanted.serial is not None:
            from drivers.simulators.load_cell_port import SerialLoadCellSimulator

            serial = SerialLoadCellSimulator(self.world, port=wanted.serial, line=settings.serial)
            self._run("serial", serial)
        if qtm is not None and settings.operator.capture == "auto":
            self._follow(Operator(self.world, settings.operator.delay_s, watched, lambda: qtm.is_controlled))
        if wanted.clock is not None:
            control = ControlServer(self, wanted.clock)
            control.start()
            self._running.callback(control.stop)
            self.ports["clock"] = control.port

    def _start_discovery(self, port: int, qtm_port: int) -> None:
        discovery = QtmDiscovery(qtm_port, port)
        discovery.start()
        self._running.callback(discovery.stop)
        self.ports["discovery"] = discovery.port

    def sent(self) -> dict[str, dict[int, int | None]]:
        """Bytes that each device has sent unasked, by the client's port; None where the connection was closed."""
        return {name: device.sent() for name, device in self._devices.items()}

    def pending(self) -> list[str]:
        """Devices whose answer to a client waits for the world to advance."""
        return [name for name, device in self._devices.items() if device.has_pending_reply]

    def _run(self, name: str, device: _Simulator) -> None:
        device.start()
        self._running.callback(device.stop)
        self._follow(device)
        self._devices[name] = device
        self.ports[name] = device.port

    def _follow(self, follower: Follower) -> None:
        self.clock.follow(follower)
        self._running.callback(self.clock.unfollow, follower)


def bench_from_options(options: dict[str, Any]) -> Bench:
    """A bench from its settings (settings.py) with "speed", "seed" and "faults" (a list, faults.py) beside them.

    Raises ValueError or TypeError if they cannot be used.
    """
    settings = dict(options)
    speed, seed = speed_from(settings.pop("speed", None)), int(settings.pop("seed", 0))
    plan = [fault_from_dict(entry) for entry in settings.pop("faults", [])]
    return Bench(settings_from_dict(settings), speed, seed, plan)


def describe_bench(bench: Bench) -> dict[str, Any]:
    """Ports, labels, the trial that is set up, and the true parameters of every cuff, as plain data."""
    world = bench.world
    return {"ports": bench.ports, "labels": world.labels, "trial": asdict(world.trial), "truth": world.truth()}


class _Simulator(Follower, Protocol):
    port: int

    @property
    def has_pending_reply(self) -> bool: ...

    def sent(self) -> dict[int, int | None]: ...

    def start(self) -> None: ...

    def stop(self) -> None: ...


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


class Operator:
    """One capture for each time that all devices begin to stream; a client that takes control is left alone.

    A new capture starts at least delay_s after the end of the previous one. clients: functions that return the client
    of each device, false without one. Another client begins anew, also one that came between two steps.
    """

    def __init__(
        self, world: World, delay_s: float, clients: Sequence[Callable[[], object]], is_controlled: Callable[[], bool]
    ) -> None:
        self._world = world
        self._delay_s = delay_s
        self._clients = clients
        self._found: list[object] = []
        self._is_controlled = is_controlled
        self._since: float | None = None  # when everything began to stream, world time
        self._is_done = False

    def step(self, now: float) -> None:
        found = [client() for client in self._clients]
        if found != self._found:
            self._found, self._since, self._is_done = found, None, False
        if not all(found):
            return
        if self._is_controlled():
            self._is_done = True
        elif self._since is None:
            self._since = now
        elif not self._is_done and now >= max(self._since, self._last_end()) + self._delay_s:
            with suppress(ValueError):  # a fault or a request began one meanwhile
                self._world.start_capture()
                self._is_done = True

    def _last_end(self) -> float:
        """When the latest capture ended or will end, world time; −∞ before the first."""
        capture = self._world.capture
        return -math.inf if capture is None else capture.end

    def find_slow_client(self) -> str | None:
        return None

    def drop_slow_client(self) -> None: ...
