"""The simulated bench: one World, the devices that sample it, and the person who starts its captures."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack
from types import TracebackType
from typing import Protocol

from drivers.simulators.faults import Fault
from drivers.simulators.operator import Operator
from drivers.simulators.qualisys import QualisysSimulator
from drivers.simulators.settings import Settings
from drivers.simulators.world import World


class Bench:
    """A context manager: within it the devices answer on 127.0.0.1, at `ports` by name ("ni", "qtm", "serial").

    A port of None in settings.ports leaves its device out. Raises OSError or RuntimeError where a port is taken.
    What goes wrong follows the plan, and world.faults.inject().
    """

    def __init__(self, settings: Settings, speed: float = 1.0, seed: int = 0, fault_plan: Iterable[Fault] = ()) -> None:
        self.world = World(settings, speed, seed, fault_plan=fault_plan)
        self.ports: dict[str, int] = {}
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
        wanted, settings = self._settings.ports, self._settings
        watched = []
        qtm: QualisysSimulator | None = None
        if wanted.ni is not None:
            from drivers.simulators.nidaq import NiDaqSimulator  # gRPC and nidaqmx take their time to import

            wiring = settings.wiring.model_dump()
            ni = NiDaqSimulator(self.world, port=wanted.ni, clock=settings.daq_clock, seed=self._seed, **wiring)
            self._run("ni", ni)
            watched.append(lambda: ni.is_streaming)
        if wanted.qtm is not None:
            qtm = QualisysSimulator(self.world, port=wanted.qtm)
            self._run("qtm", qtm)
            watched.append(lambda: qtm.is_streaming)
        if wanted.serial is not None:
            from drivers.simulators.serial_load_cell import SerialLoadCellSimulator

            self._run("serial", SerialLoadCellSimulator(self.world, port=wanted.serial, line=settings.serial))
        if qtm is not None and settings.operator.capture == "auto":
            operator = Operator(self.world, settings.operator.delay_s, watched, lambda: qtm.is_controlled)
            operator.start()
            self._running.callback(operator.stop)

    def _run(self, name: str, device: _Simulator) -> None:
        device.start()
        self._running.callback(device.stop)
        self.ports[name] = device.port


class _Simulator(Protocol):
    port: int

    def start(self) -> None: ...

    def stop(self) -> None: ...
