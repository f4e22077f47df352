"""Calls to the simulated NI server: errors, frozen state, sessions, attributes."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any, TypeVar

import grpc
from nidaqmx._stubs.nidaqmx_pb2_grpc import NiDAQmxServicer

from drivers.simulators.acquisition_task import AcquisitionTask
from drivers.simulators.daq_sessions import DaqSessions, SessionRefused
from drivers.simulators.usb6008 import DaqmxError, Usb6008

FROZEN_GLANCE_S = 0.002  # wall

Value = TypeVar("Value")
Service = TypeVar("Service", bound="DaqService")


def rpc(method: Callable[[Service, Any], Any]) -> Callable[[Service, Any, grpc.ServicerContext], Any]:
    """Send a DaqmxError as the real server does: status UNKNOWN with the code in the trailing metadata."""

    @functools.wraps(method)
    def answer(self: Service, request: Any, context: grpc.ServicerContext) -> Any:
        self.wait_while_frozen(context)
        try:
            return method(self, request)
        except SessionRefused as error:
            return context.abort(error.status, str(error))
        except DaqmxError as error:
            metadata = [("ni-error", str(error.error_code))]
            if method.__name__.startswith("Read"):
                metadata.append(("ni-samps-per-chan-read", "0"))
            context.set_trailing_metadata(tuple(metadata))
            return context.abort(grpc.StatusCode.UNKNOWN, f"{error}\n\nStatus Code: {error.error_code}")

    return answer


class DaqService(NiDAQmxServicer):
    """Device and sessions, for all RPCs. RPCs that are not imitated answer UNIMPLEMENTED."""

    def __init__(self, device: Usb6008) -> None:
        self.device = device
        self.sessions = DaqSessions(device)

    def wait_while_frozen(self, context: grpc.ServicerContext) -> None:
        """Returns at once unless the server is frozen; a call that its client has cancelled has no effect."""
        while self.device.world.faults.active("ni", "freeze"):
            if not context.is_active():
                context.abort(grpc.StatusCode.CANCELLED, "frozen")
            time.sleep(FROZEN_GLANCE_S)

    def task_of(self, request: Any) -> AcquisitionTask:
        return self.sessions.find(request.task.name)


def attribute(request: Any, values: dict[int, Value]) -> Value:
    """Value of an attribute by NI's number (NIDAQmx.h). Raises DaqmxError for one that is not imitated."""
    if request.attribute_raw not in values:
        raise DaqmxError(-200452, f"Specified property is not supported: 0x{request.attribute_raw:04X}.")
    return values[request.attribute_raw]
