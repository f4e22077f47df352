"""System and device RPCs of the simulated NI server with its USB-6008."""

# ruff: noqa: N802  (the RPCs are called what NI calls them)

from __future__ import annotations

from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as wire
from nidaqmx.constants import _TriggerUsageTypes
from nidaqmx.error_codes import DAQmxErrors

from drivers.simulators.daq_service import DaqService, attribute, rpc
from drivers.simulators.usb6008 import DIFFERENTIAL_INPUTS, HIGHEST_RATE_HZ

DRIVER_VERSION = {0x1272: 25, 0x1923: 0, 0x2F22: 0}  # major, minor, update


class DeviceRpcs(DaqService):
    """System and device; attributes by NI's numbers (NIDAQmx.h)."""

    @rpc
    def ResetDevice(self, request: Any) -> Any:
        self._known_device(request)
        self.device.reset()
        return wire.ResetDeviceResponse()

    @rpc
    def GetSystemInfoAttributeUInt32(self, request: Any) -> Any:
        return wire.GetSystemInfoAttributeUInt32Response(value=attribute(request, DRIVER_VERSION))

    @rpc
    def GetSystemInfoAttributeString(self, request: Any) -> Any:
        names = self.device.name if self.device.is_plugged_in else ""
        return wire.GetSystemInfoAttributeStringResponse(value=attribute(request, {0x193B: names}))

    @rpc
    def GetDeviceAttributeString(self, request: Any) -> Any:
        name = self._known_device(request)
        values = {
            0x0631: "USB-6008",
            0x231E: ", ".join(f"{name}/ai{number}" for number in range(DIFFERENTIAL_INPUTS)),
            0x2A40: f"/{name}/PFI0",
        }
        return wire.GetDeviceAttributeStringResponse(value=attribute(request, values))

    @rpc
    def GetDeviceAttributeUInt32(self, request: Any) -> Any:
        self._known_device(request)
        values = {0x0632: self.device.serial_number, 0x231D: 0x717A}
        return wire.GetDeviceAttributeUInt32Response(value=attribute(request, values))

    @rpc
    def GetDeviceAttributeInt32(self, request: Any) -> Any:
        self._known_device(request)
        values = {0x2986: _TriggerUsageTypes.START.value, 0x2326: 12586, 0x29A9: 14646}  # trigger usage, USB, category
        return wire.GetDeviceAttributeInt32Response(value_raw=attribute(request, values))

    @rpc
    def GetDeviceAttributeBool(self, request: Any) -> Any:
        self._known_device(request)
        values = {0x2984: False, 0x2985: True, 0x22CA: True}  # analog, digital trigger; is simulated
        return wire.GetDeviceAttributeBoolResponse(value=attribute(request, values))

    @rpc
    def GetDeviceAttributeDouble(self, request: Any) -> Any:
        self._known_device(request)
        values = {0x298C: HIGHEST_RATE_HZ, 0x298D: HIGHEST_RATE_HZ}  # of one channel, of all together
        return wire.GetDeviceAttributeDoubleResponse(value=attribute(request, values))

    @rpc
    def GetErrorString(self, request: Any) -> Any:
        try:
            text = DAQmxErrors(request.error_code).name.replace("_", " ").capitalize()
        except ValueError:
            text = ""
        return wire.GetErrorStringResponse(error_string=text)

    def _known_device(self, request: Any) -> str:
        self.device.ensure_known(request.device_name)
        return self.device.name
