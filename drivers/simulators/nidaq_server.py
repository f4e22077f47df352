"""An NI gRPC Device Server with one USB-6008, for unmodified nidaqmx: the wire; usb6008.py is the instrument.

daq_rpcs.py keeps the sessions. The death of a client ends none of them, as in NI's server.

Does not imitate: every other service and instrument of the real server, TLS, RPCs beyond voltage input (they are
answered UNIMPLEMENTED); and what usb6008.py and daq_rpcs.py list.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType

import grpc
from nidaqmx._stubs.nidaqmx_pb2_grpc import add_NiDAQmxServicer_to_server

from drivers.simulators.daq_rpcs import ChannelRpcs, DeviceRpcs, TaskRpcs
from drivers.simulators.settings import DaqClockSettings, EmgWire
from drivers.simulators.usb6008 import ElectricalWorld, Usb6008


class NiDaqSimulator:
    """The server in this process; port 0 takes a free one. start() and stop() may each be called once."""

    def __init__(
        self,
        world: ElectricalWorld,
        *,
        port: int = 0,
        device: str = "Dev1",
        force_channel: str = "ai0",
        sync_channel: str = "ai1",
        emg: Mapping[str, EmgWire] = MappingProxyType({}),
        clock: DaqClockSettings | None = None,
        seed: int = 0,
    ) -> None:
        self._device = Usb6008(
            world,
            name=device,
            force_channel=force_channel,
            sync_channel=sync_channel,
            emg=emg,
            clock=clock or DaqClockSettings(),
            seed=seed,
        )
        self._service = _Service(self._device)  # type: ignore[abstract]  # the others answer UNIMPLEMENTED
        # Without SO_REUSEPORT a second server on the port is refused instead of sharing its calls.
        self._server = grpc.server(ThreadPoolExecutor(max_workers=8), options=[("grpc.so_reuseport", 0)])
        add_NiDAQmxServicer_to_server(self._service, self._server)
        self.port = port

    @property
    def target(self) -> str:
        return f"127.0.0.1:{self.port}"

    @property
    def is_streaming(self) -> bool:
        """Whether a client acquires."""
        return self._device.is_streaming

    def start(self) -> None:
        """Binds and serves. Raises RuntimeError if the port is taken."""
        try:
            self.port = self._server.add_insecure_port(self.target)
        except RuntimeError as error:
            raise RuntimeError(
                f"the NI gRPC device server cannot listen at {self.target}; end what listens there, or take another "
                "port (daq.grpc_target)"
            ) from error
        self._server.start()

    def step(self, now: float) -> None:
        """Nothing to do: clients poll for samples."""

    def sent(self) -> dict[int, int | None]:
        """Nothing: a client has the samples once its call returns."""
        return {}

    @property
    def has_pending_reply(self) -> bool:
        return self._device.world.faults.active("ni", "freeze") is not None

    def find_slow_client(self) -> str | None:
        task = self._device.running
        if task is None or task.may_overrun or not task.is_nearly_full:
            return None
        return f"the DAQ task {task.name}"

    def drop_slow_client(self) -> None:
        """Overwrite its unread samples from now on, as the real device does."""
        if task := self._device.running:
            task.may_overrun = True

    def stop(self) -> None:
        self._service.sessions.clear_all()
        self._server.stop(grace=None).wait()


class _Service(TaskRpcs, ChannelRpcs, DeviceRpcs):
    """The imitated part of NiDAQmx."""
