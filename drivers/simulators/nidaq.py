"""An NI gRPC Device Server with one USB-6008, for unmodified nidaqmx: the wire; usb6008.py is the instrument.

daq_sessions.py keeps the sessions. The death of a client ends none of them, as in NI's server.

Does not imitate: every other service and instrument of the real server, TLS, RPCs beyond continuous clocked voltage
input (they are answered UNIMPLEMENTED); and what usb6008.py lists.
"""

# ruff: noqa: N802  (the RPCs are called what NI calls them)

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
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
    _TriggerUsageTypes,
)
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.utils import unflatten_channel_string
from session_pb2 import Session

from drivers.simulators.daq_sessions import DaqSessions, SessionRefused
from drivers.simulators.settings import DaqClock
from drivers.simulators.usb6008 import (
    DIFFERENTIAL_INPUTS,
    HIGHEST_RATE_HZ,
    AcquisitionTask,
    DaqmxError,
    ElectricalWorld,
    Usb6008,
)

TIMED_OUT = -200284
EVENT_POLL_S = 0.1
FROZEN_GLANCE_S = 0.002  # wall
DRIVER_VERSION = {0x1272: 25, 0x1923: 0, 0x2F22: 0}  # major, minor, update

Value = TypeVar("Value")


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
        clock: DaqClock | None = None,
        seed: int = 0,
    ) -> None:
        self._device = Usb6008(
            world,
            name=device,
            force_channel=force_channel,
            sync_channel=sync_channel,
            clock=clock or DaqClock(),
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
        """Nothing to do: a client asks for the samples up to now."""

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
        """Its unread samples are overwritten from now on, as on the real device."""
        if task := self._device.running:
            task.may_overrun = True

    def stop(self) -> None:
        self._service.sessions.clear_all()
        self._server.stop(grace=None).wait()


def _rpc(method: Callable[[_Service, Any], Any]) -> Callable[[_Service, Any, grpc.ServicerContext], Any]:
    """Sends a DaqmxError as the real server does: status UNKNOWN with the code in the trailing metadata."""

    @functools.wraps(method)
    def answer(self: _Service, request: Any, context: grpc.ServicerContext) -> Any:
        self.wait_while_frozen(context)
        try:
            return method(self, request)
        except SessionRefused as error:
            return context.abort(error.status, str(error))
        except DaqmxError as error:
            metadata = [("ni-error", str(error.code))]
            if method.__name__.startswith("Read"):
                metadata.append(("ni-samps-per-chan-read", "0"))
            context.set_trailing_metadata(tuple(metadata))
            return context.abort(grpc.StatusCode.UNKNOWN, f"{error}\n\nStatus Code: {error.code}")

    return answer


class _Service(NiDAQmxServicer):
    def __init__(self, device: Usb6008) -> None:
        self._device = device
        self.sessions = DaqSessions(device)

    def wait_while_frozen(self, context: grpc.ServicerContext) -> None:
        """Returns at once unless the server is frozen; a call that its client has given up does not happen later."""
        while self._device.world.faults.active("ni", "freeze"):
            if not context.is_active():
                context.abort(grpc.StatusCode.CANCELLED, "frozen")
            time.sleep(FROZEN_GLANCE_S)

    def _task(self, request: Any) -> AcquisitionTask:
        return self.sessions.find(request.task.name)

    # --- A task's life

    @_rpc
    def CreateTask(self, request: Any) -> Any:
        task, is_new = self.sessions.create(request.session_name, request.initialization_behavior)
        return wire.CreateTaskResponse(task=Session(name=task.name), new_session_initialized=is_new)

    @_rpc
    def CreateAIVoltageChan(self, request: Any) -> Any:
        if request.terminal_config_raw not in (TerminalConfiguration.DIFF.value, TerminalConfiguration.DEFAULT.value):
            raise DaqmxError(
                -200077,
                "Requested value is not a supported value for this property.\n\n"
                f"Property: AI.TermCfg\nRequested Value: {request.terminal_config_raw}",
            )
        task = self._task(request)
        for channel in unflatten_channel_string(request.physical_channel):
            task.inputs.append(self._device.input(channel, request.min_val, request.max_val))
        return wire.CreateAIVoltageChanResponse()

    @_rpc
    def CfgSampClkTiming(self, request: Any) -> Any:
        if request.sample_mode_raw != AcquisitionType.CONTINUOUS.value:
            raise DaqmxError(-200077, "The simulated device samples continuously only.\n\nProperty: SampQuant.SampMode")
        self._task(request).set_clock(request.rate, request.samps_per_chan)
        return wire.CfgSampClkTimingResponse()

    @_rpc
    def CfgDigEdgeStartTrig(self, request: Any) -> Any:
        source = request.trigger_source.strip("/").lower()
        if source not in ("pfi0", f"{self._device.name}/pfi0".lower()):
            raise DaqmxError(-200265, f"Invalid terminal: the only trigger is PFI0, found {request.trigger_source}.")
        self._task(request).waits_for_trigger = True
        return wire.CfgDigEdgeStartTrigResponse()

    @_rpc
    def DisableStartTrig(self, request: Any) -> Any:
        self._task(request).waits_for_trigger = False
        return wire.DisableStartTrigResponse()

    @_rpc
    def StartTask(self, request: Any) -> Any:
        self._task(request).start()
        return wire.StartTaskResponse()

    @_rpc
    def StopTask(self, request: Any) -> Any:
        self._task(request).stop()
        return wire.StopTaskResponse()

    @_rpc
    def ClearTask(self, request: Any) -> Any:
        self.sessions.clear(request.task.name)
        return wire.ClearTaskResponse()

    @_rpc
    def IsTaskDone(self, request: Any) -> Any:
        return wire.IsTaskDoneResponse(is_task_done=not self._task(request).is_running)

    @_rpc
    def ResetDevice(self, request: Any) -> Any:
        self._known_device(request)
        self._device.reset()
        return wire.ResetDeviceResponse()

    # --- Samples

    @_rpc
    def ReadAnalogF64(self, request: Any) -> Any:
        task = self._task(request)
        count = request.num_samps_per_chan
        timeout_s = request.timeout
        if count < 0:
            count, timeout_s = task.available(), 0.0
        volts = task.read(count, timeout_s)
        got = volts.shape[1]
        # A late read is no error of the transport: what there is stands at the start of each channel's place.
        values = np.zeros((len(task.inputs), count))
        values[:, :got] = volts
        if request.fill_mode_raw == FillMode.GROUP_BY_SCAN_NUMBER.value:
            values = values.T
        return wire.ReadAnalogF64Response(
            status=0 if got == count else TIMED_OUT, read_array=values.ravel(), samps_per_chan_read=got
        )

    def RegisterEveryNSamplesEvent(self, request: Any, context: Any) -> Iterator[Any]:
        task = self.sessions.find(request.task.name)
        context.send_initial_metadata(())  # the client blocks on it
        due = request.n_samples
        while context.is_active() and self.sessions.holds(task):
            try:
                has_come = task.wait_until_acquired(due, EVENT_POLL_S)
            except DaqmxError:  # the device is gone, and the client's next call is told so
                return
            if not has_come:
                time.sleep(EVENT_POLL_S / 10)  # it may not have been started yet
            else:
                due += request.n_samples
                yield wire.RegisterEveryNSamplesEventResponse(
                    every_n_samples_event_type_raw=request.every_n_samples_event_type_raw, n_samples=request.n_samples
                )

    @_rpc
    def UnregisterEveryNSamplesEvent(self, request: Any) -> Any:
        self._task(request)  # the client ends the stream itself
        return wire.UnregisterEveryNSamplesEventResponse()

    # --- Attributes, by NI's numbers (NIDAQmx.h)

    @_rpc
    def GetTaskAttributeString(self, request: Any) -> Any:
        task = self.sessions.find(request.task.name, must_live=False)  # what it is called is asked of no device
        names = ", ".join(channel.name for channel in task.inputs)
        value = _attribute(request, {0x1276: task.name, 0x1273: names})
        return wire.GetTaskAttributeStringResponse(value=value)

    @_rpc
    def GetReadAttributeUInt32(self, request: Any) -> Any:
        task = self._task(request)
        questions: dict[int, Callable[[], int]] = {
            0x217B: lambda: len(task.inputs),
            0x1223: task.available,
            0x31E8: task.available,  # what "all available" means to a continuous task
        }
        return wire.GetReadAttributeUInt32Response(value=_attribute(request, questions)())

    @_rpc
    def GetReadAttributeUInt64(self, request: Any) -> Any:
        task = self._task(request)
        values = {0x1221: task.position, 0x192A: task.acquired()}  # current read position, total acquired
        return wire.GetReadAttributeUInt64Response(value=_attribute(request, values))

    @_rpc
    def GetReadAttributeString(self, request: Any) -> Any:
        names = ", ".join(channel.name for channel in self._task(request).inputs)
        return wire.GetReadAttributeStringResponse(value=_attribute(request, {0x1823: names}))

    @_rpc
    def GetChanAttributeInt32(self, request: Any) -> Any:
        values = {0x187F: ChannelType.ANALOG_INPUT.value, 0x0695: UsageTypeAI.VOLTAGE.value}
        return wire.GetChanAttributeInt32Response(value_raw=_attribute(request, values))

    @_rpc
    def GetTimingAttributeDouble(self, request: Any) -> Any:
        return wire.GetTimingAttributeDoubleResponse(value=_attribute(request, {0x1344: self._task(request).rate_hz}))

    @_rpc
    def GetBufferAttributeUInt32(self, request: Any) -> Any:
        return wire.GetBufferAttributeUInt32Response(
            value=_attribute(request, {0x186C: self._task(request).buffer_size})
        )

    @_rpc
    def SetBufferAttributeUInt32(self, request: Any) -> Any:
        task = self._task(request)
        _attribute(request, {0x186C: None})
        task.buffer_size = request.value
        return wire.SetBufferAttributeUInt32Response()

    @_rpc
    def GetSystemInfoAttributeUInt32(self, request: Any) -> Any:
        return wire.GetSystemInfoAttributeUInt32Response(value=_attribute(request, DRIVER_VERSION))

    @_rpc
    def GetSystemInfoAttributeString(self, request: Any) -> Any:
        names = self._device.name if self._device.is_plugged_in else ""
        return wire.GetSystemInfoAttributeStringResponse(value=_attribute(request, {0x193B: names}))

    @_rpc
    def GetDeviceAttributeString(self, request: Any) -> Any:
        name = self._known_device(request)
        values = {
            0x0631: "USB-6008",
            0x231E: ", ".join(f"{name}/ai{number}" for number in range(DIFFERENTIAL_INPUTS)),
            0x2A40: f"/{name}/PFI0",
        }
        return wire.GetDeviceAttributeStringResponse(value=_attribute(request, values))

    @_rpc
    def GetDeviceAttributeUInt32(self, request: Any) -> Any:
        self._known_device(request)
        values = {0x0632: self._device.serial_number, 0x231D: 0x717A}
        return wire.GetDeviceAttributeUInt32Response(value=_attribute(request, values))

    @_rpc
    def GetDeviceAttributeInt32(self, request: Any) -> Any:
        self._known_device(request)
        values = {0x2986: _TriggerUsageTypes.START.value, 0x2326: 12586, 0x29A9: 14646}  # trigger usage, USB, category
        return wire.GetDeviceAttributeInt32Response(value_raw=_attribute(request, values))

    @_rpc
    def GetDeviceAttributeBool(self, request: Any) -> Any:
        self._known_device(request)
        values = {0x2984: False, 0x2985: True, 0x22CA: True}  # analog, digital trigger; is simulated
        return wire.GetDeviceAttributeBoolResponse(value=_attribute(request, values))

    @_rpc
    def GetDeviceAttributeDouble(self, request: Any) -> Any:
        self._known_device(request)
        values = {0x298C: HIGHEST_RATE_HZ, 0x298D: HIGHEST_RATE_HZ}  # of one channel, of all together
        return wire.GetDeviceAttributeDoubleResponse(value=_attribute(request, values))

    @_rpc
    def GetErrorString(self, request: Any) -> Any:
        try:
            text = DAQmxErrors(request.error_code).name.replace("_", " ").capitalize()
        except ValueError:
            text = ""
        return wire.GetErrorStringResponse(error_string=text)

    def _known_device(self, request: Any) -> str:
        self._device.ensure_known(request.device_name)
        return self._device.name


def _attribute(request: Any, values: dict[int, Value]) -> Value:
    if request.attribute_raw not in values:
        raise DaqmxError(-200452, f"Specified property is not supported: 0x{request.attribute_raw:04X}.")
    return values[request.attribute_raw]
