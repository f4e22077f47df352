"""The simulated bench: one World, the devices that sample it, and the operator who starts its captures."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import asdict
from types import TracebackType
from typing import Any, Protocol

from drivers.simulators.control import ControlServer
from drivers.simulators.faults import Fault, fault_from_dict
from drivers.simulators.operator import Operator
from drivers.simulators.qtm_discovery import QtmDiscovery
from drivers.simulators.qualisys import QualisysSimulator
from drivers.simulators.requests import speed_from
from drivers.simulators.settings import Settings, settings_from_dict
from drivers.simulators.world import World
from drivers.simulators.world_clock import Follower


class Bench:
    """A context manager: within it the devices answer on 127.0.0.1, at `ports` by name ("ni", "qtm", "serial"), and
    the world's clock at ports["clock"] (control.py).

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
            from drivers.simulators.nidaq import NiDaqSimulator  # gRPC and nidaqmx take their time to import

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
            from drivers.simulators.serial_load_cell import SerialLoadCellSimulator

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
