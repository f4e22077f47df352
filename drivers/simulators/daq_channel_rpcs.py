"""Channels of the simulated NI server's tasks, and their properties.

Does not imitate: inputs that are not differential, properties of a channel beyond its limits, range and place.
"""

# ruff: noqa: N802  (the RPCs are called what NI calls them)

from __future__ import annotations

from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as wire
from nidaqmx.constants import ChannelType, TerminalConfiguration, UsageTypeAI, VoltageUnits
from nidaqmx.utils import unflatten_channel_string

from drivers.simulators.acquisition_task import AcquisitionTask
from drivers.simulators.daq_service import DaqService, attribute, rpc
from drivers.simulators.usb6008 import DaqmxError

HIGHEST, LOWEST = 0x17DD, 0x17DE  # AI.Max, AI.Min


class ChannelRpcs(DaqService):
    """Voltage inputs; attributes by NI's numbers (NIDAQmx.h)."""

    @rpc
    def CreateAIVoltageChan(self, request: Any) -> Any:
        if request.terminal_config_raw not in (TerminalConfiguration.DIFF.value, TerminalConfiguration.DEFAULT.value):
            raise DaqmxError(
                -200077,
                "Requested value is not a supported value for this property.\n\n"
                f"Property: AI.TermCfg\nRequested Value: {request.terminal_config_raw}",
            )
        task = self.task_of(request)
        for channel in unflatten_channel_string(request.physical_channel):
            task.inputs.append(self.device.input(channel, request.min_val, request.max_val))
        return wire.CreateAIVoltageChanResponse()

    @rpc
    def GetChanAttributeInt32(self, request: Any) -> Any:
        values = {
            0x187F: ChannelType.ANALOG_INPUT.value,
            0x0695: UsageTypeAI.VOLTAGE.value,
            0x1097: TerminalConfiguration.DIFF.value,
            0x1094: VoltageUnits.VOLTS.value,
        }
        _named(self.task_of(request), request.channel)
        return wire.GetChanAttributeInt32Response(value_raw=attribute(request, values))

    @rpc
    def GetChanAttributeString(self, request: Any) -> Any:
        task = self.task_of(request)
        names = ", ".join(task.inputs[number].name for number in _named(task, request.channel))
        return wire.GetChanAttributeStringResponse(value=attribute(request, {0x18F5: names}))

    @rpc
    def GetChanAttributeDouble(self, request: Any) -> Any:
        task = self.task_of(request)
        channel = task.inputs[_named(task, request.channel)[0]]
        values = {
            HIGHEST: channel.highest_v,
            LOWEST: channel.lowest_v,
            0x1815: channel.range_v,
            0x1816: -channel.range_v,
        }
        return wire.GetChanAttributeDoubleResponse(value=attribute(request, values))

    @rpc
    def SetChanAttributeDouble(self, request: Any) -> Any:
        task = self.task_of(request)
        attribute(request, {HIGHEST: None, LOWEST: None})
        for number in _named(task, request.channel):
            channel = task.inputs[number]
            is_highest = request.attribute_raw == HIGHEST
            lowest_v = channel.lowest_v if is_highest else request.value
            task.inputs[number] = channel.spanning(lowest_v, request.value if is_highest else channel.highest_v)
        return wire.SetChanAttributeDoubleResponse()


def _named(task: AcquisitionTask, channels: str) -> list[int]:
    """Places of these channels in the task, all for an empty name. Raises DaqmxError for one that is not in it."""
    if not channels:
        return list(range(len(task.inputs)))
    places = {channel.name.lower(): number for number, channel in enumerate(task.inputs)}
    wanted = [name.lower() for name in unflatten_channel_string(channels)]
    if unknown := [name for name in wanted if name not in places]:
        raise DaqmxError(-200486, f"Specified channel is not in the task.\n\nChannel Name: {', '.join(unknown)}")
    return [places[name] for name in wanted]
