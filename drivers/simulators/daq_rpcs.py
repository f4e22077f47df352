"""An NI gRPC Device Server with one USB-6008, for unmodified nidaqmx: the wire; usb6008.py is the instrument.

A task lives until it is cleared, also if its client dies. As in ni/grpc-device,
source/server/session_repository.cpp, a session has no time-out and outlives its connection.

Does not imitate: every other service and instrument of the real server, TLS, RPCs beyond voltage input (they are
answered UNIMPLEMENTED); inputs that are not differential, properties of a channel beyond its limits, range and place;
waveforms, scalars and raw codes, logging to a file, reference triggers, pausing; and what usb6008.py lists.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType
from typing import Any, TypeVar

import grpc
import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as wire
from nidaqmx._stubs.nidaqmx_pb2_grpc import NiDAQmxServicer, add_NiDAQmxServicer_to_server
from nidaqmx.constants import (
    AcquisitionType,
    ChannelType,
    FillMode,
    TerminalConfiguration,
    UsageTypeAI,
    VoltageUnits,
    _TriggerUsageTypes,
)
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.utils import unflatten_channel_string
from session_pb2 import Session
from session_pb2 import SessionInitializationBehavior as Behavior

from drivers.errors import DeviceError
from drivers.simulators.settings import DaqClockSettings, EmgWire
from drivers.simulators.usb6008 import (
    DIFFERENTIAL_INPUTS,
    HIGHEST_RATE_HZ,
    AcquisitionTask,
    DaqmxError,
    ElectricalWorld,
    Usb6008,
)

Value = TypeVar("Value")
Attributes = dict[int, Any]
NO_SUCH_TASK = (-200088, "Task specified is invalid or does not exist.")
DRIVER_VERSION = {0x1272: 25, 0x1923: 0, 0x2F22: 0}  # major, minor, update
HIGHEST, LOWEST = 0x17DD, 0x17DE  # AI.Max, AI.Min
TIMED_OUT = -200284
EVENT_POLL_S = 0.1
FROZEN_GLANCE_S = 0.002  # wall
# ruff: noqa: N802  (the RPCs are called what NI calls them)


def rpc(method: Callable[[_Service, Any], Any]) -> Callable[[_Service, Any, grpc.ServicerContext], Any]:
    """An RPC, with an empty response if the method returns None. Sends a DaqmxError as the real server does: status
    UNKNOWN with the code in the trailing metadata.
    """

    @functools.wraps(method)
    def answer(self: _Service, request: Any, context: grpc.ServicerContext) -> Any:
        self.wait_while_frozen(context)
        try:
            response = method(self, request)
            return getattr(wire, f"{method.__name__}Response")() if response is None else response
        except SessionRefused as error:
            return context.abort(error.status, str(error))
        except DaqmxError as error:
            metadata = [("ni-error", str(error.error_code))]
            if method.__name__.startswith("Read"):
                metadata.append(("ni-samps-per-chan-read", "0"))
            context.set_trailing_metadata(tuple(metadata))
            return context.abort(grpc.StatusCode.UNKNOWN, f"{error}\n\nStatus Code: {error.error_code}")

    return answer


def attribute_rpc(
    method: Callable[[_Service, Any], Attributes],
) -> Callable[[_Service, Any, grpc.ServicerContext], Any]:
    """An RPC for one of the attributes that the method returns, by NI's numbers (NIDAQmx.h)."""
    field = "value_raw" if method.__name__.endswith("AttributeInt32") else "value"

    @rpc
    @functools.wraps(method)
    def answer(self: _Service, request: Any) -> Any:
        value = attribute(request, method(self, request))
        return getattr(wire, f"{method.__name__}Response")(**{field: value})

    return answer


class SessionRefused(DeviceError):
    """The client expected a session that does not exist, or a new one that exists; not an error of NI-DAQmx."""

    def __init__(self, status: grpc.StatusCode, text: str) -> None:
        super().__init__(text)
        self.status = status


class DaqSessions:
    """The tasks of one server, by the names of their sessions."""

    def __init__(self, device: Usb6008) -> None:
        self._device = device
        self._tasks: dict[str, AcquisitionTask] = {}
        self._unnamed = 0

    def create(self, name: str, behavior: int) -> tuple[AcquisitionTask, bool]:
        """The task of this name, and whether it is new. An empty name makes a new one. Raises SessionRefused."""
        if not name:
            name, self._unnamed = f"_unnamedTask<{self._unnamed}>", self._unnamed + 1
        task = self._tasks.get(name)
        if task is not None and behavior == Behavior.SESSION_INITIALIZATION_BEHAVIOR_INITIALIZE_NEW:
            text = f"Cannot initialize '{name}' when a session already exists."
            raise SessionRefused(grpc.StatusCode.ALREADY_EXISTS, text)
        if task is None and behavior == Behavior.SESSION_INITIALIZATION_BEHAVIOR_ATTACH_TO_EXISTING:
            text = f"Cannot attach to '{name}' because a session has not been initialized."
            raise SessionRefused(grpc.StatusCode.FAILED_PRECONDITION, text)
        if task is not None:
            return task, False
        self._tasks[name] = task = AcquisitionTask(self._device, name)
        return task, True

    def find(self, name: str, *, must_live: bool = True) -> AcquisitionTask:
        """The task of a session. Raises DaqmxError if there is none or, with must_live, if its device was removed."""
        if name not in self._tasks:
            raise DaqmxError(*NO_SUCH_TASK)
        if must_live:
            self._tasks[name].ensure_alive()
        return self._tasks[name]

    def holds(self, task: AcquisitionTask) -> bool:
        """Whether the task has not been cleared."""
        return self._tasks.get(task.name) is task

    def clear(self, name: str) -> None:
        """End the task, also if its device is gone. Raises DaqmxError without a task."""
        task = self.find(name, must_live=False)
        del self._tasks[name]
        task.stop()

    def clear_all(self) -> None:
        """End every task, and the calls that wait for one."""
        for name in list(self._tasks):
            self.clear(name)


class _Service(NiDAQmxServicer):
    """The imitated RPCs of NiDAQmx, attributes by NI's numbers (NIDAQmx.h); the others answer UNIMPLEMENTED."""

    def __init__(self, device: Usb6008) -> None:
        self.device = device
        self.sessions = DaqSessions(device)

    def wait_while_frozen(self, context: grpc.ServicerContext) -> None:
        """Returns at once unless the server is frozen; a call that its client has cancelled has no effect."""
        while self.device.world.faults.active("ni", "freeze"):
            if not context.is_active():
                context.abort(grpc.StatusCode.CANCELLED, "frozen")
            time.sleep(FROZEN_GLANCE_S)

    # --- System and device

    @rpc
    def ResetDevice(self, request: Any) -> None:
        self._known_device(request)
        self.device.reset()

    @attribute_rpc
    def GetSystemInfoAttributeUInt32(self, _request: Any) -> Attributes:
        return DRIVER_VERSION

    @attribute_rpc
    def GetSystemInfoAttributeString(self, _request: Any) -> Attributes:
        return {0x193B: self.device.name if self.device.is_plugged_in else ""}

    @attribute_rpc
    def GetDeviceAttributeString(self, request: Any) -> Attributes:
        name = self._known_device(request)
        return {
            0x0631: "USB-6008",
            0x231E: ", ".join(f"{name}/ai{number}" for number in range(DIFFERENTIAL_INPUTS)),
            0x2A40: f"/{name}/PFI0",
        }

    @attribute_rpc
    def GetDeviceAttributeUInt32(self, request: Any) -> Attributes:
        self._known_device(request)
        return {0x0632: self.device.serial_number, 0x231D: 0x717A}

    @attribute_rpc
    def GetDeviceAttributeInt32(self, request: Any) -> Attributes:
        self._known_device(request)
        return {0x2986: _TriggerUsageTypes.START.value, 0x2326: 12586, 0x29A9: 14646}  # trigger usage, USB, category

    @attribute_rpc
    def GetDeviceAttributeBool(self, request: Any) -> Attributes:
        self._known_device(request)
        return {0x2984: False, 0x2985: True, 0x22CA: True}  # analog, digital trigger; is simulated

    @attribute_rpc
    def GetDeviceAttributeDouble(self, request: Any) -> Attributes:
        self._known_device(request)
        return {0x298C: HIGHEST_RATE_HZ, 0x298D: HIGHEST_RATE_HZ}  # of one channel, of all together

    @rpc
    def GetErrorString(self, request: Any) -> Any:
        names = {error.value: error.name.replace("_", " ").capitalize() for error in DAQmxErrors}
        text = names.get(request.error_code, "")
        return wire.GetErrorStringResponse(error_string=text)

    # --- Voltage inputs

    @rpc
    def CreateAIVoltageChan(self, request: Any) -> None:
        if request.terminal_config_raw not in (TerminalConfiguration.DIFF.value, TerminalConfiguration.DEFAULT.value):
            raise DaqmxError(
                -200077,
                "Requested value is not a supported value for this property.\n\n"
                f"Property: AI.TermCfg\nRequested Value: {request.terminal_config_raw}",
            )
        task = self._task(request)
        for channel in unflatten_channel_string(request.physical_channel):
            task.inputs.append(self.device.input(channel, request.min_val, request.max_val))

    @attribute_rpc
    def GetChanAttributeInt32(self, request: Any) -> Attributes:
        _named(self._task(request), request.channel)
        return {
            0x187F: ChannelType.ANALOG_INPUT.value,
            0x0695: UsageTypeAI.VOLTAGE.value,
            0x1097: TerminalConfiguration.DIFF.value,
            0x1094: VoltageUnits.VOLTS.value,
        }

    @attribute_rpc
    def GetChanAttributeString(self, request: Any) -> Attributes:
        task = self._task(request)
        names = ", ".join(task.inputs[number].name for number in _named(task, request.channel))
        return {0x18F5: names}

    @attribute_rpc
    def GetChanAttributeDouble(self, request: Any) -> Attributes:
        task = self._task(request)
        channel = task.inputs[_named(task, request.channel)[0]]
        return {HIGHEST: channel.highest_v, LOWEST: channel.lowest_v, 0x1815: channel.range_v, 0x1816: -channel.range_v}

    @rpc
    def SetChanAttributeDouble(self, request: Any) -> None:
        task = self._task(request)
        attribute(request, {HIGHEST: None, LOWEST: None})
        for number in _named(task, request.channel):
            channel = task.inputs[number]
            is_highest = request.attribute_raw == HIGHEST
            lowest_v = channel.lowest_v if is_highest else request.value
            task.inputs[number] = channel.spanning(lowest_v, request.value if is_highest else channel.highest_v)

    # --- Tasks

    @rpc
    def CreateTask(self, request: Any) -> Any:
        task, is_new = self.sessions.create(request.session_name, request.initialization_behavior)
        return wire.CreateTaskResponse(task=Session(name=task.name), new_session_initialized=is_new)

    @rpc
    def CfgSampClkTiming(self, request: Any) -> None:
        modes = (AcquisitionType.CONTINUOUS.value, AcquisitionType.FINITE.value)
        if request.sample_mode_raw not in modes:
            raise DaqmxError(-200077, "The device has no hardware-timed single point.\n\nProperty: SampQuant.SampMode")
        is_finite = request.sample_mode_raw == AcquisitionType.FINITE.value
        self._task(request).set_clock(request.rate, request.samps_per_chan, is_finite=is_finite)

    @rpc
    def CfgDigEdgeStartTrig(self, request: Any) -> None:
        source = request.trigger_source.strip("/").lower()
        if source not in ("pfi0", f"{self.device.name}/pfi0".lower()):
            raise DaqmxError(-200265, f"Invalid terminal: the only trigger is PFI0, found {request.trigger_source}.")
        self._task(request).waits_for_trigger = True

    @rpc
    def DisableStartTrig(self, request: Any) -> None:
        self._task(request).waits_for_trigger = False

    @rpc
    def StartTask(self, request: Any) -> None:
        self._task(request).start()

    @rpc
    def StopTask(self, request: Any) -> None:
        self._task(request).stop()

    @rpc
    def ClearTask(self, request: Any) -> None:
        self.sessions.clear(request.task.name)

    @rpc
    def IsTaskDone(self, request: Any) -> Any:
        return wire.IsTaskDoneResponse(is_task_done=self._task(request).is_done)

    @rpc
    def WaitUntilTaskDone(self, request: Any) -> None:
        task = self._task(request)
        if task.mode == "finite":
            task.wait_until_acquired(task.length, request.time_to_wait)
        if not task.is_done:
            raise DaqmxError(-200560, "Wait Until Done did not indicate that the task was done within the timeout.")

    @rpc
    def ReadAnalogF64(self, request: Any) -> Any:
        task = self._task(request)
        count = request.num_samps_per_chan
        timeout_s = request.timeout
        if count < 0:
            count, timeout_s = task.default_read_count(), timeout_s if task.mode == "finite" else 0.0
        volts = task.read(count, timeout_s)
        got = volts.shape[1]
        # An incomplete read is not a transport error: the samples are at the start of each channel's block.
        values = np.zeros((len(task.inputs), count))
        values[:, :got] = volts
        if request.fill_mode_raw == FillMode.GROUP_BY_SCAN_NUMBER.value:
            values = values.T
        status = 0 if got == count else TIMED_OUT
        return wire.ReadAnalogF64Response(status=status, read_array=values.ravel(), samps_per_chan_read=got)

    def RegisterEveryNSamplesEvent(self, request: Any, context: Any) -> Iterator[Any]:
        task = self.sessions.find(request.task.name)
        context.send_initial_metadata(())  # the client waits for it
        due = request.n_samples
        while context.is_active() and self.sessions.holds(task):
            try:
                has_come = task.wait_until_acquired(due, EVENT_POLL_S)
            except DaqmxError:  # the device is gone; the client's next call returns the error
                return
            if not has_come:
                time.sleep(EVENT_POLL_S / 10)  # it may not have been started yet
            else:
                due += request.n_samples
                yield wire.RegisterEveryNSamplesEventResponse(
                    every_n_samples_event_type_raw=request.every_n_samples_event_type_raw, n_samples=request.n_samples
                )

    @rpc
    def UnregisterEveryNSamplesEvent(self, request: Any) -> None:
        self._task(request)  # the client ends the stream itself

    @attribute_rpc
    def GetTaskAttributeString(self, request: Any) -> Attributes:
        task = self.sessions.find(request.task.name, must_live=False)  # the name does not depend on the device
        names = ", ".join(channel.name for channel in task.inputs)
        return {0x1276: task.name, 0x1273: names}

    @rpc
    def GetReadAttributeUInt32(self, request: Any) -> Any:
        task = self._task(request)
        counts = {0x217B: lambda: len(task.inputs), 0x1223: task.available, 0x31E8: task.default_read_count}
        return wire.GetReadAttributeUInt32Response(value=attribute(request, counts)())

    @attribute_rpc
    def GetReadAttributeUInt64(self, request: Any) -> Attributes:
        task = self._task(request)
        return {0x1221: task.position, 0x192A: task.acquired()}  # current read position, total acquired

    @attribute_rpc
    def GetReadAttributeString(self, request: Any) -> Attributes:
        names = ", ".join(channel.name for channel in self._task(request).inputs)
        return {0x1823: names}

    @attribute_rpc
    def GetTimingAttributeInt32(self, request: Any) -> Attributes:
        is_finite = self._task(request).mode == "finite"
        mode = AcquisitionType.FINITE if is_finite else AcquisitionType.CONTINUOUS
        return {0x1300: mode.value}

    @attribute_rpc
    def GetTimingAttributeUInt64(self, request: Any) -> Attributes:
        task = self._task(request)
        return {0x1310: task.length or task.buffer_size}

    @attribute_rpc
    def GetTimingAttributeDouble(self, request: Any) -> Attributes:
        return {0x1344: self._task(request).rate_hz}

    @attribute_rpc
    def GetBufferAttributeUInt32(self, request: Any) -> Attributes:
        return {0x186C: self._task(request).buffer_size}

    @rpc
    def SetBufferAttributeUInt32(self, request: Any) -> None:
        task = self._task(request)
        attribute(request, {0x186C: None})
        task.buffer_size = request.value

    def _task(self, request: Any) -> AcquisitionTask:
        return self.sessions.find(request.task.name)

    def _known_device(self, request: Any) -> str:
        self.device.ensure_known(request.device_name)
        return self.device.name


def attribute(request: Any, values: dict[int, Value]) -> Value:
    """Value of an attribute by NI's number (NIDAQmx.h). Raises DaqmxError for one that is not imitated."""
    if request.attribute_raw not in values:
        raise DaqmxError(-200452, f"Specified property is not supported: 0x{request.attribute_raw:04X}.")
    return values[request.attribute_raw]


def _named(task: AcquisitionTask, channels: str) -> list[int]:
    """Places of these channels in the task, all for an empty name. Raises DaqmxError for one that is not in it."""
    if not channels:
        return list(range(len(task.inputs)))
    places = {channel.name.lower(): number for number, channel in enumerate(task.inputs)}
    wanted = [name.lower() for name in unflatten_channel_string(channels)]
    if unknown := [name for name in wanted if name not in places]:
        raise DaqmxError(-200486, f"Specified channel is not in the task.\n\nChannel Name: {', '.join(unknown)}")
    return [places[name] for name in wanted]


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
        clock = clock or DaqClockSettings()
        self._device = Usb6008(
            world, name=device, force_channel=force_channel, sync_channel=sync_channel, emg=emg, clock=clock, seed=seed
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
