"""Tasks of the simulated NI server: creation, clock, trigger and samples.

Does not imitate: waveforms, scalars and raw codes, logging to a file, reference triggers, pausing.
"""

# ruff: noqa: N802  (the RPCs are called what NI calls them)

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as wire
from nidaqmx.constants import AcquisitionType, FillMode
from session_pb2 import Session

from drivers.simulators.daq_service import DaqService, attribute, rpc
from drivers.simulators.usb6008 import DaqmxError

TIMED_OUT = -200284
EVENT_POLL_S = 0.1


class TaskRpcs(DaqService):
    """Tasks; attributes by NI's numbers (NIDAQmx.h)."""

    @rpc
    def CreateTask(self, request: Any) -> Any:
        task, is_new = self.sessions.create(request.session_name, request.initialization_behavior)
        return wire.CreateTaskResponse(task=Session(name=task.name), new_session_initialized=is_new)

    @rpc
    def CfgSampClkTiming(self, request: Any) -> Any:
        modes = (AcquisitionType.CONTINUOUS.value, AcquisitionType.FINITE.value)
        if request.sample_mode_raw not in modes:
            raise DaqmxError(-200077, "The device has no hardware-timed single point.\n\nProperty: SampQuant.SampMode")
        is_finite = request.sample_mode_raw == AcquisitionType.FINITE.value
        self.task_of(request).set_clock(request.rate, request.samps_per_chan, is_finite=is_finite)
        return wire.CfgSampClkTimingResponse()

    @rpc
    def CfgDigEdgeStartTrig(self, request: Any) -> Any:
        source = request.trigger_source.strip("/").lower()
        if source not in ("pfi0", f"{self.device.name}/pfi0".lower()):
            raise DaqmxError(-200265, f"Invalid terminal: the only trigger is PFI0, found {request.trigger_source}.")
        self.task_of(request).waits_for_trigger = True
        return wire.CfgDigEdgeStartTrigResponse()

    @rpc
    def DisableStartTrig(self, request: Any) -> Any:
        self.task_of(request).waits_for_trigger = False
        return wire.DisableStartTrigResponse()

    @rpc
    def StartTask(self, request: Any) -> Any:
        self.task_of(request).start()
        return wire.StartTaskResponse()

    @rpc
    def StopTask(self, request: Any) -> Any:
        self.task_of(request).stop()
        return wire.StopTaskResponse()

    @rpc
    def ClearTask(self, request: Any) -> Any:
        self.sessions.clear(request.task.name)
        return wire.ClearTaskResponse()

    @rpc
    def IsTaskDone(self, request: Any) -> Any:
        return wire.IsTaskDoneResponse(is_task_done=self.task_of(request).is_done)

    @rpc
    def WaitUntilTaskDone(self, request: Any) -> Any:
        task = self.task_of(request)
        if task.mode == "finite":
            task.wait_until_acquired(task.length, request.time_to_wait)
        if not task.is_done:
            raise DaqmxError(-200560, "Wait Until Done did not indicate that the task was done within the timeout.")
        return wire.WaitUntilTaskDoneResponse()

    # --- Samples

    @rpc
    def ReadAnalogF64(self, request: Any) -> Any:
        task = self.task_of(request)
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
        return wire.ReadAnalogF64Response(
            status=0 if got == count else TIMED_OUT, read_array=values.ravel(), samps_per_chan_read=got
        )

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
    def UnregisterEveryNSamplesEvent(self, request: Any) -> Any:
        self.task_of(request)  # the client ends the stream itself
        return wire.UnregisterEveryNSamplesEventResponse()

    # --- Attributes, by NI's numbers (NIDAQmx.h)

    @rpc
    def GetTaskAttributeString(self, request: Any) -> Any:
        task = self.sessions.find(request.task.name, must_live=False)  # the name does not depend on the device
        names = ", ".join(channel.name for channel in task.inputs)
        value = attribute(request, {0x1276: task.name, 0x1273: names})
        return wire.GetTaskAttributeStringResponse(value=value)

    @rpc
    def GetReadAttributeUInt32(self, request: Any) -> Any:
        task = self.task_of(request)
        questions: dict[int, Callable[[], int]] = {
            0x217B: lambda: len(task.inputs),
            0x1223: task.available,
            0x31E8: task.default_read_count,
        }
        return wire.GetReadAttributeUInt32Response(value=attribute(request, questions)())

    @rpc
    def GetReadAttributeUInt64(self, request: Any) -> Any:
        task = self.task_of(request)
        values = {0x1221: task.position, 0x192A: task.acquired()}  # current read position, total acquired
        return wire.GetReadAttributeUInt64Response(value=attribute(request, values))

    @rpc
    def GetReadAttributeString(self, request: Any) -> Any:
        names = ", ".join(channel.name for channel in self.task_of(request).inputs)
        return wire.GetReadAttributeStringResponse(value=attribute(request, {0x1823: names}))

    @rpc
    def GetTimingAttributeInt32(self, request: Any) -> Any:
        is_finite = self.task_of(request).mode == "finite"
        mode = AcquisitionType.FINITE if is_finite else AcquisitionType.CONTINUOUS
        return wire.GetTimingAttributeInt32Response(value_raw=attribute(request, {0x1300: mode.value}))

    @rpc
    def GetTimingAttributeUInt64(self, request: Any) -> Any:
        task = self.task_of(request)
        return wire.GetTimingAttributeUInt64Response(
            value=attribute(request, {0x1310: task.length or task.buffer_size})
        )

    @rpc
    def GetTimingAttributeDouble(self, request: Any) -> Any:
        return wire.GetTimingAttributeDoubleResponse(value=attribute(request, {0x1344: self.task_of(request).rate_hz}))

    @rpc
    def GetBufferAttributeUInt32(self, request: Any) -> Any:
        return wire.GetBufferAttributeUInt32Response(
            value=attribute(request, {0x186C: self.task_of(request).buffer_size})
        )

    @rpc
    def SetBufferAttributeUInt32(self, request: Any) -> Any:
        task = self.task_of(request)
        attribute(request, {0x186C: None})
        task.buffer_size = request.value
        return wire.SetBufferAttributeUInt32Response()
